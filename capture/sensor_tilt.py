"""Tilt and height of a sensor, and the conversion of its skeletons to upright coordinates from the floor."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import astuple, dataclass, fields, replace
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from capture.body import ANKLE_HEIGHT_METRES
from capture.clip import SkeletonClip
from capture.orientations import rotated
from capture.sensor_pose import SensorPose
from capture.skeleton import JOINT_INDEX, SkeletonFrame

MIN_STRAIGHT_COSINE = math.cos(math.radians(20))
"""Cosine of the largest angle between thigh and shin, and between legs and trunk, of a performer who stands upright."""

MIN_TILT_DEGREES = 5.0
"""Minimum tilt that is detected; performers do not stand straighter than this."""

MAX_TILT_DEGREES = 50.0
"""Maximum tilt that is detected; with a larger one, the performer does not stand."""

MIN_TILT_CHANGE = 2.0, 0.06
"""Minimum change, in degrees and metres, of a sensor that was moved; smaller changes are measurement errors."""

MIN_UPRIGHT_FRAMES, MAX_UPRIGHT_FRAMES = 15, 2000
"""Number of frames with an upright performer that determine the tilt in a recording, and of those that are examined."""

_Seen = TypeVar("_Seen", SkeletonFrame, SkeletonClip)


@dataclass(frozen=True, slots=True)
class SensorTilt:
    """Tilt, height and roll of a sensor.

    Attributes
    ----------
    tilt : float
        Degrees by which the sensor looks down; negative if it looks up.
    height : float
        Metres above the floor, 0 if unknown.
    roll : float
        Degrees about the viewing direction, as in `capture.sensor_pose.SensorPose.of_degrees`.
    """

    tilt: float = 0.0
    height: float = 0.0
    roll: float = 0.0

    @classmethod
    def of_json(cls, values: Mapping[str, Any]) -> Self:
        """Convert the arguments of a cue ``level`` or a saved state.

        Raises
        ------
        ValueError
            A value is missing, not a number or not finite.
        """
        try:
            tilt = cls(**{each.name: float(values[each.name]) for each in fields(cls)})
        except (KeyError, TypeError, OverflowError) as error:
            raise ValueError(f"no tilt, height and roll: {error}") from error
        if not all(map(math.isfinite, astuple(tilt))):
            raise ValueError("tilt, height and roll must be finite")
        return tilt

    def __str__(self) -> str:
        looks = f"looks {abs(self.tilt):.0f}° {'down' if self.tilt > 0 else 'up'}" if abs(self.tilt) >= 1 else "level"
        leans = f", leans by {abs(self.roll):.0f}°" if abs(self.roll) >= 1 else ""
        height = f"{self.height:.2f} m above the floor, " if self.height else ""
        return f"{height}{looks}{leans}"

    def near(self, other: "SensorTilt", degrees: float, metres: float) -> bool:
        """Return whether another tilt differs by at most these degrees and, if both heights are known, metres."""
        angle = max(abs(self.tilt - other.tilt), abs(self.roll - other.roll))
        known = self.height and other.height
        return angle <= degrees and (not known or abs(self.height - other.height) <= metres)

    def upright(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return (..., 3) positions with y straight up, measured from the floor if the height is known."""
        return positions if self == SensorTilt() else self._pose.apply(positions)

    def above_floor(self, pose: NDArray[np.float64]) -> "SensorTilt":
        """Return the same with a height, if it has none: above the floor on which a performer (20, 3) stands."""
        if self.height:
            return self
        ankles = (pose[JOINT_INDEX["ankle_left"]] + pose[JOINT_INDEX["ankle_right"]]) / 2
        height = ANKLE_HEIGHT_METRES - float(replace(self, height=0.0).upright(ankles)[1])
        return replace(self, height=height) if math.isfinite(height) else self

    def levelled(self, seen: _Seen) -> _Seen:
        """Return a frame or clip whose positions and orientations have y straight up."""
        if self == SensorTilt():
            return seen
        orientations = None if seen.orientations is None else rotated(seen.orientations, self._pose.rotation)
        return replace(seen, positions=self.upright(seen.positions), orientations=orientations)

    @property
    def _pose(self) -> SensorPose:
        return SensorPose.of_degrees(self.tilt, 0.0, self.roll, np.array([0.0, self.height, 0.0]))


def estimate_tilt(pose: NDArray[np.float64]) -> SensorTilt | None:
    """Estimate the tilt and height of a sensor from a performer who stands upright.

    Parameters
    ----------
    pose : (20, 3) float64
        Metres, sensor coordinates; NaN for unknown joints.

    Returns
    -------
    SensorTilt or None
        None if legs or trunk are unknown or bent.
    """
    joint = {name: pose[index] for name, index in JOINT_INDEX.items()}
    hips, top = joint["hip_center"], joint["shoulder_center"]
    ankles = (joint["ankle_left"] + joint["ankle_right"]) / 2
    bends = [
        (joint[f"knee_{side}"] - joint[f"hip_{side}"], joint[f"ankle_{side}"] - joint[f"knee_{side}"])
        for side in ("left", "right")
    ]
    if not all(_cosine(*bend) > MIN_STRAIGHT_COSINE for bend in [*bends, (top - hips, hips - ankles)]):
        return None
    _, up, forward = top - ankles
    tilt = math.degrees(math.atan2(-forward, up))
    if abs(tilt) > MAX_TILT_DEGREES:
        return None
    return SensorTilt(tilt if abs(tilt) > MIN_TILT_DEGREES else 0.0).above_floor(pose)


def tilt_of_recording(clips: Iterable[SkeletonClip]) -> SensorTilt:
    """Estimate the tilt of a recording's sensor: the median over the frames in which performers stand upright.

    Returns
    -------
    SensorTilt
        Without a height; level if performers stand upright in fewer than `MIN_UPRIGHT_FRAMES` of the frames.
    """
    found = []
    for clip in clips:
        step = max(1, len(clip.positions) // MAX_UPRIGHT_FRAMES)
        found += [tilt.tilt for pose in clip.positions[::step] if (tilt := estimate_tilt(pose)) is not None]
    return SensorTilt(float(np.median(found)) if len(found) >= MIN_UPRIGHT_FRAMES else 0.0)


def _cosine(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Return the cosine of the angle between two vectors; NaN if one is unknown."""
    return float(a @ b / (np.linalg.norm(a) * np.linalg.norm(b)))
