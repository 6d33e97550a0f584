"""What a dialect of OSC is to the source that hears it: messages become parts of bodies, parts become a pose.

A dialect never keeps time and never decides when a frame is whole; `capture.network.assembly` does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from capture.network.osc import Message
from capture.skeleton import JOINT_INDEX, JOINTS, LOST

Units = Literal["m", "cm", "mm", "screen"]
"""Of a sender's coordinates; *screen* is OSCeleton's own scale, see `capture.network.osceleton`."""
UNITS: tuple[Units, ...] = get_args(Units)
METRES: dict[Units, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}

LARGEST_IN_METRES = 20.0
"""No sensor sees a body farther away in metres, and no body's every joint is nearer to it in millimetres."""

Values = tuple[float, ...]
Pose = tuple[NDArray[np.float64], NDArray[np.float32]]
"""(20, 3) metres in the sensor frame, NaN where lost, and (20,) confidence."""


@dataclass(frozen=True, slots=True)
class Part:
    """One joint or bone of one performer.

    Attributes
    ----------
    user : int
    name : str
        One of a dialect's closed set.
    values : tuple of float
        As they were sent.
    stamp : float or None
        The same in all parts of a frame, where the dialect has such a thing.
    """

    user: int
    name: str
    values: Values
    stamp: float | None = None


@dataclass(frozen=True, slots=True)
class Gone:
    """The sender says that it has lost a performer."""

    user: int


@dataclass(frozen=True, slots=True)
class FrameEnd:
    """The frames of all performers are whole."""


@dataclass(frozen=True, slots=True)
class Nothing:
    """A message that belongs to the dialect and tells nothing that is needed."""


Refusal = Literal["unknown message", "unknown joint", "wrong arguments"]
"""Why a well-formed message can be refused."""

Reading = Part | Gone | FrameEnd | Nothing | Refusal


def shape(message: Message) -> str:
    """Return a message's type tags with f for every float, i for every int and s for every text.

    What a program sends as float32 comes as a double where a script stands in for it.
    """
    return message.tags.translate(_PLAIN)


_PLAIN = str.maketrans("dhS", "fis")


class Dialect(Protocol):
    """One program's way to send skeletons.

    Attributes
    ----------
    bundle_is_frame : bool
        Whether the end of a bundle ends the frames of the performers in it.
    mirrors : bool
        Whether the program, as it comes, shows performers in a mirror: x and the names of the sides exchanged.
    """

    bundle_is_frame: bool
    mirrors: bool

    def read(self, message: Message) -> Reading | None:
        """Understand a message; None if it is another dialect's."""

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> Pose:
        """Make the parts of one frame into a pose, not minding whether it is a mirror's.

        Parameters
        ----------
        parts : mapping of str to tuple of float
            From the name of a part to its values; at least one.
        units : str or None
            What the user says about the sender's units; None for what the program sends by itself.
        """


_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_MIDDLE = {"head": "head", "neck": "shoulder_center", "torso": "spine", "waist": "hip_center", "pelvis": "hip_center"}
_SIDED = ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "foot")
_UNUSED = ("collar", "fingertip", "finger", "thumb")
NAMES: dict[str, str | None] = {
    **_MIDDLE,
    "chest": None,
    **{f"{prefix}_{part}": f"{part}_{side}" for prefix, side in _SIDES.items() for part in _SIDED},
    **{f"{prefix}_{part}": None for prefix in _SIDES for part in _UNUSED},
}
"""Our joint for each name that OSCeleton, its descendants and NI mate use, in lower case; None for those not needed."""


def joint(name: Any, user: Any, values: tuple[Any, ...], stamp: Any = None) -> Reading:
    """Return a joint of `NAMES` as a part of a body; the arguments' types are those that `shape` has told."""
    ours = NAMES.get(name.lower(), "")
    if ours == "":
        return "unknown joint"
    return Nothing() if ours is None else Part(user, ours, values, stamp)


def in_metres(values: NDArray[np.float64], units: Units | None, small: Units) -> tuple[NDArray[np.float64], Units]:
    """Find the units of a frame's coordinates.

    Parameters
    ----------
    values : (J, 3) float64
        NaN where a coordinate was not sent.
    units : str or None
        None to tell by the size: millimetres, or `small` where no number is as large as `LARGEST_IN_METRES`.
    small : str

    Returns
    -------
    values : (J, 3) float64
        In metres, unless they are in screen units.
    units : str
        What they were in.
    """
    found = units or ("mm" if np.nanmax(np.abs(values)) > LARGEST_IN_METRES else small)
    return values * METRES.get(found, 1.0), found


def kinect20(
    names: Mapping[str, object], positions: NDArray[np.float64], confidence: NDArray[np.float32] | float
) -> Pose:
    """Put joints that carry our names into the order of `capture.skeleton.JOINTS`.

    Parameters
    ----------
    names : mapping
        Its keys are the joints' names, in the order of the rows.
    positions : (J, 3) float64
        Metres, sensor frame.
    confidence : (J,) float32 or float
    """
    places = [JOINT_INDEX[name] for name in names]
    ours = np.full((len(JOINTS), 3), np.nan)
    sure = np.full(len(JOINTS), LOST, dtype=np.float32)
    ours[places] = positions
    sure[places] = confidence
    ours[sure == LOST] = np.nan
    return ours, sure
