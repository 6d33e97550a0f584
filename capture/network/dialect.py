"""The interface of a dialect of OSC: it reads messages as parts of a performer's frame, and parts as a pose.

A dialect does not handle times and does not decide when a frame is complete; `capture.network.assembly` does.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from capture.network.osc import Message
from capture.skeleton import JOINT_INDEX, JOINTS, LOST

Units = Literal["m", "cm", "mm", "screen"]
"""Unit of a sender's coordinates; *screen* is the scale described in `capture.network.osceleton`."""
UNITS: tuple[Units, ...] = get_args(Units)
METRES_PER_UNIT: dict[Units, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001}

MAX_METRES = 20.0
"""Maximum coordinate in metres: no sensor reaches further, and a pose in millimetres has a larger number."""

Values = tuple[float, ...]
PerformerPose = tuple[NDArray[np.float64], NDArray[np.float32]]
"""Positions (20, 3) in metres in sensor coordinates, NaN for lost joints, and confidence (20,)."""


@dataclass(frozen=True, slots=True)
class Part:
    """One joint or bone of one performer.

    Attributes
    ----------
    user : int
    name : str
        A name from the dialect's closed set.
    values : tuple of float
        Numbers as the sender sent them.
    stamp : float or None
        The sender's time, equal in all parts of a frame; None if the dialect sends none.
    """

    user: int
    name: str
    values: Values
    stamp: float | None = None


@dataclass(frozen=True, slots=True)
class PerformerLost:
    """The sender reports that it has lost a performer."""

    user: int


@dataclass(frozen=True, slots=True)
class FrameEnd:
    """The sender reports that the frames of all performers are complete."""


@dataclass(frozen=True, slots=True)
class ChannelValues:
    """Values from 0 to 1 of channels (`capture.channels`), for all performers."""

    values: Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Ignored:
    """A message of the dialect that is not needed."""


Refusal = Literal["unknown message", "unknown joint", "unknown channel", "channel outside 0 to 1", "wrong arguments"]
"""Reasons to refuse a well-formed message."""

AcceptedReading = Part | PerformerLost | FrameEnd | ChannelValues | Ignored
Reading = AcceptedReading | Refusal


_PLAIN_TAGS = str.maketrans("dhS", "fis")


def has_types(message: Message, *layouts: str, more: bool = False) -> bool:
    """Return whether a message's arguments are as one of some layouts of f, i and s: float, integer and string.

    A script that imitates a program may send a double where the program sends a float32, or a whole number where it
    sends a float. With `more`, further arguments may follow.
    """
    tags = message.tags.translate(_PLAIN_TAGS)
    return any(
        (len(tags) == len(layout) or (more and len(tags) > len(layout)))
        and all(tag == wanted or (tag, wanted) == ("i", "f") for tag, wanted in zip(tags, layout, strict=False))
        for layout in layouts
    )


class Dialect(Protocol):
    """The messages with which a program sends skeletons.

    Attributes
    ----------
    bundle_is_frame : bool
        Whether the end of a bundle ends the frames of the performers in it.
    mirrors : bool
        Whether the program mirrors performers by default: x negated, the names of the sides swapped.
    sends_positions : bool
        Whether parts begin with measured positions; a joint at exactly (0, 0, 0), or that does not move while others
        do, is then lost.
    """

    bundle_is_frame: bool
    mirrors: bool
    sends_positions: bool

    def read(self, message: Message) -> Reading | None:
        """Read a message; return None if it belongs to another dialect."""

    def pose(self, parts: Mapping[str, Values], units: Units | None) -> PerformerPose:
        """Convert the parts of one frame to a pose, which may still be mirrored.

        Parameters
        ----------
        parts : mapping of str to tuple of float
            Values of each part by its name; at least one part.
        units : str or None
            The sender's units as configured by the user; None for the program's default.
        """


_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_MIDDLE = {"head": "head", "neck": "shoulder_center", "torso": "spine", "waist": "hip_center", "pelvis": "hip_center"}
_SIDED = ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "foot")
_UNUSED = ("collar", "fingertip", "finger", "thumb")
JOINT_NAMES: dict[str, str | None] = {
    **_MIDDLE,
    "chest": None,
    **{f"{prefix}_{part}": f"{part}_{side}" for prefix, side in _SIDES.items() for part in _SIDED},
    **{f"{prefix}_{part}": None for prefix in _SIDES for part in _UNUSED},
}
"""Joint of each name, in lower case, of OSCeleton, its descendants and NI mate; None for joints that are not needed."""


def joint_part(name: Any, user: Any, values: tuple[Any, ...], stamp: Any = None) -> Reading:
    """Return the part for a joint of `JOINT_NAMES`. The caller has checked the types with `has_types`."""
    joint = JOINT_NAMES.get(name.lower(), "")
    if joint == "":
        return "unknown joint"
    return Ignored() if joint is None else Part(user, joint, values, stamp)


def to_metres(values: NDArray[np.float64], units: Units | None, small: Units) -> tuple[NDArray[np.float64], Units]:
    """Convert the coordinates of a frame to metres.

    Parameters
    ----------
    values : (J, 3) float64
        NaN for coordinates that were not sent.
    units : str or None
        None to detect them by size: `small` if all numbers are within `MAX_METRES`, otherwise millimetres.
    small : str

    Returns
    -------
    values : (J, 3) float64
        Metres, or unchanged screen units.
    units : str
        Units of the input.
    """
    found = units or ("mm" if np.nanmax(np.abs(values)) > MAX_METRES else small)
    return values * METRES_PER_UNIT.get(found, 1.0), found


def kinect20(
    names: Mapping[str, object], positions: NDArray[np.float64], confidence: NDArray[np.float32] | float
) -> PerformerPose:
    """Put joints into the order of `capture.skeleton.JOINTS`.

    Parameters
    ----------
    names : mapping
        The keys are names of `capture.skeleton.JOINTS`, in the order of the rows.
    positions : (J, 3) float64
        Metres, sensor coordinates.
    confidence : (J,) float32 or float
    """
    rows = [JOINT_INDEX[name] for name in names]
    all_positions = np.full((len(JOINTS), 3), np.nan)
    all_confidence = np.full(len(JOINTS), LOST, dtype=np.float32)
    all_positions[rows] = positions
    all_confidence[rows] = confidence
    all_positions[all_confidence == LOST] = np.nan
    return all_positions, all_confidence
