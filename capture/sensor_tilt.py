"""A sensor that looks up or down, at some height: its skeletons turned upright and put on the floor."""

import math
from collections.abc import Mapping
from dataclasses import astuple, dataclass, fields, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from capture.body import ANKLE_HEIGHT_METRES
from capture.orientations import rotated
from capture.pose import Pose
from capture.skeleton import JOINT_INDEX, SkeletonFrame

STRAIGHT = math.cos(math.radians(20))
"""Thigh and shin, and legs and trunk, that enclose less than this are those of somebody who stands upright."""

DEAD_ZONE = 5.0
"""Degrees. People do not stand straighter than this, so less is no tilt of the sensor."""

STEEPEST = 50.0
"""Degrees of tilt beyond which a pose is taken for something else than standing."""


MIN_TILT_CHANGE = 2.0, 0.06
"""Degrees and metres by which a sensor that was moved stands otherwise; less is how it was measured."""


@dataclass(frozen=True, slots=True)
class SensorTilt:
    """How a sensor stands.

    Attributes
    ----------
    tilt : float
        Degrees that it looks down; negative where it looks up.
    height : float
        Metres above the floor, 0 where that is not known.
    roll : float
        Degrees that it leans, as of `capture.pose.Pose.of_degrees`.
    """

    tilt: float = 0.0
    height: float = 0.0
    roll: float = 0.0

    @classmethod
    def of_json(cls, values: Mapping[str, Any]) -> Self:
        """Make one of what a cue ``level`` or a memory says.

        Raises
        ------
        ValueError
            It says something else.
        """
        try:
            level = cls(**{each.name: float(values[each.name]) for each in fields(cls)})
        except (KeyError, TypeError, OverflowError) as error:
            raise ValueError(f"no tilt, height and roll: {error}") from error
        if not all(map(math.isfinite, astuple(level))):
            raise ValueError("neither tilt, height nor roll can be endless")
        return level

    def __str__(self) -> str:
        looks = f"looks {abs(self.tilt):.0f}° {'down' if self.tilt > 0 else 'up'}" if abs(self.tilt) >= 1 else "level"
        leans = f", leans by {abs(self.roll):.0f}°" if abs(self.roll) >= 1 else ""
        return f"{self.height:.2f} m above the floor, {looks}{leans}"

    def near(self, other: "SensorTilt", degrees: float, metres: float) -> bool:
        """Tell whether another sensor stands about the same."""
        turned = max(abs(self.tilt - other.tilt), abs(self.roll - other.roll))
        return turned <= degrees and abs(self.height - other.height) <= metres

    def __call__(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., 3) positions with y straight up, from the floor where its height is known."""
        return positions if self == SensorTilt() else self._pose.apply(positions)

    def frame(self, frame: SkeletonFrame) -> SkeletonFrame:
        """Return a frame with y straight up, and its bones turned with it."""
        if self == SensorTilt():
            return frame
        turns = None if frame.orientations is None else rotated(frame.orientations, self._pose.rotation)
        return replace(frame, positions=self(frame.positions), orientations=turns)

    @property
    def _pose(self) -> Pose:
        return Pose.of_degrees(self.tilt, 0.0, self.roll, np.array([0.0, self.height, 0.0]))


def estimate_tilt(pose: NDArray[np.float64]) -> SensorTilt | None:
    """Find out from somebody who stands upright how the sensor stands.

    Parameters
    ----------
    pose : (20, 3) float64
        Metres, sensor frame; NaN for unknown joints.

    Returns
    -------
    SensorTilt or None
        None where legs or trunk are unknown or bent, so that nothing can be said.
    """
    joint = {name: pose[index] for name, index in JOINT_INDEX.items()}
    hips, top = joint["hip_center"], joint["shoulder_center"]
    ankles = (joint["ankle_left"] + joint["ankle_right"]) / 2
    bends = [
        (joint[f"knee_{side}"] - joint[f"hip_{side}"], joint[f"ankle_{side}"] - joint[f"knee_{side}"])
        for side in ("left", "right")
    ]
    if not all(_along(*bend) > STRAIGHT for bend in [*bends, (top - hips, hips - ankles)]):
        return None
    _, up, forward = top - ankles
    tilt = math.degrees(math.atan2(-forward, up))
    if abs(tilt) > STEEPEST:
        return None
    upright = SensorTilt(tilt if abs(tilt) > DEAD_ZONE else 0.0)
    return SensorTilt(upright.tilt, ANKLE_HEIGHT_METRES - float(upright(ankles)[1]))


def _along(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the cosine between two directions; NaN, which is above nothing, where one is unknown."""
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
