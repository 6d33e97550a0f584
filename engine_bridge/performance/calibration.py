"""Detection of a performer who stands still, and measurement of the pose."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.sensor_tilt import SensorTilt
from capture.skeleton import JOINT_INDEX, JOINTS, LOST, SkeletonFrame

STILL_SECONDS = 1.0
"""Time for which a performer must stand still, in seconds."""

POSE_SECONDS = 0.4
"""Time over which the median is the present pose, in seconds."""

MAX_FRAMES = 240
"""Maximum number of stored frames."""

MAX_DRIFT_METRES = 0.03
"""Maximum distance between the mean positions of a joint in the first and second half of the time, in metres.

Means are compared because noise averages out.
"""

MAX_MOVING_SHARE = 0.1
"""Maximum share of joints that move more; hands and feet may, because sensors measure them imprecisely."""

MIN_FRAMES, MIN_JOINTS = 8, 6
"""Minimum numbers of frames, and of joints known in both halves, that determine a pose."""

MAX_LENGTH_DIFFERENCE = 0.12
"""Maximum mean relative difference of bone lengths of the same person."""


@dataclass(frozen=True)
class Calibration:
    """A performer's calibration pose, which corresponds to the character's rest pose.

    Attributes
    ----------
    rest : (20, 3) float64
        Joint positions in metres, sensor coordinates.
    sensor : SensorTilt
        Position of the sensor at that time.
    """

    rest: NDArray[np.float64]
    sensor: SensorTilt

    @property
    def height(self) -> float:
        """Height of the performer in metres."""
        return body.height(self.rest)

    @property
    def reach(self) -> float:
        """Distance from the performer's shoulders to the hands in metres, mean of both sides."""
        return float(body.reach(self.rest)[[JOINT_INDEX["hand_left"], JOINT_INDEX["hand_right"]]].mean())

    def to_json(self) -> dict[str, Any]:
        """Return values of JSON's types, from which `of_json` restores the calibration bit for bit."""
        return {"rest": rows_of(self.rest), "sensor": asdict(self.sensor)}

    @classmethod
    def of_json(cls, value: Mapping[str, Any]) -> "Calibration":
        """Restore a calibration from the values of `to_json`.

        Raises
        ------
        KeyError, TypeError, ValueError
            The values are not those of a calibration.
        """
        rest = places_of(value["rest"])
        if rest.shape != (len(JOINTS), 3):
            raise ValueError(f"a pose of shape {rest.shape}")
        return cls(rest, SensorTilt.of_json(value["sensor"]))


def rows_of(places: NDArray[np.float64]) -> list[list[float] | None]:
    """Return positions (n, 3) as lists for JSON; None for those that are not finite."""
    return [place.tolist() if np.isfinite(place).all() else None for place in places]


def places_of(places: Iterable[Sequence[float] | None]) -> NDArray[np.float64]:
    """Return the positions (n, 3) of a value of `rows_of`; NaN for None."""
    rows = [(np.nan,) * 3 if place is None else place for place in places]
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


class RecentFrames:
    """The frames of a performer's last second."""

    def __init__(self) -> None:
        self._frames: deque[SkeletonFrame] = deque(maxlen=MAX_FRAMES)

    def add(self, frame: SkeletonFrame) -> None:
        """Add the next frame."""
        self._frames.append(frame)
        while frame.time - self._frames[0].time > STILL_SECONDS:
            self._frames.popleft()

    def clear(self) -> None:
        """Forget all frames."""
        self._frames.clear()

    def is_still(self) -> bool:
        """Return whether the performer has stood still for the whole last second."""
        if len(self._frames) < MIN_FRAMES or self._frames[-1].time - self._frames[0].time < 0.9 * STILL_SECONDS:
            return False
        positions, confidence = self._stacked(STILL_SECONDS)
        seen = np.where((confidence > LOST)[..., None], positions, np.nan)
        half = len(seen) // 2
        known = (confidence[:half] > LOST).any(axis=0) & (confidence[half:] > LOST).any(axis=0)
        if np.count_nonzero(known) < MIN_JOINTS:
            return False
        before, after = np.nanmean(seen[:half, known], axis=0), np.nanmean(seen[half:, known], axis=0)
        moved = np.linalg.norm(after - before, axis=1) > MAX_DRIFT_METRES
        return bool(moved.mean() <= MAX_MOVING_SHARE)

    def pose(self, seconds: float = STILL_SECONDS) -> NDArray[np.float64]:
        """Return the median pose (20, 3) of the last `seconds`, NaN for joints that were always lost."""
        positions, confidence = self._stacked(seconds)
        return body.resting_pose(positions, confidence, 0, len(positions))

    def cover(self, seconds: float) -> bool:
        """Return whether there are two frames or more, and they cover this time."""
        return len(self._frames) > 1 and self._frames[-1].time - self._frames[0].time >= seconds

    def _stacked(self, seconds: float) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        end = self._frames[-1].time if self._frames else 0.0
        frames = [frame for frame in self._frames if end - frame.time <= seconds]
        if not frames:
            return np.empty((0, len(JOINTS), 3)), np.empty((0, len(JOINTS)), dtype=np.float32)
        return np.stack([frame.positions for frame in frames]), np.stack([frame.confidence for frame in frames])


def same_body(one: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    """Return whether two poses (20, 3) may be of one person, by the lengths of their bones."""
    first, second = (np.array(list(body.bone_lengths(pose).values())) for pose in (one, other))
    return bool(np.mean(np.abs(first - second)) <= MAX_LENGTH_DIFFERENCE * np.mean(first))
