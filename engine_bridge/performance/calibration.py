"""Calibrations of performers: when somebody stands still, the pose, its conversion to JSON, and those in a take."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.clip import SkeletonClip
from capture.events import Cue
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


MAX_METRES = 100.0
"""Maximum coordinate of a calibration pose and maximum height of its sensor, in metres; beyond it, it is damaged."""

IN_VIEW_SECONDS = 1.0
"""Time before a calibration within which a performer must have been tracked to be its performer, in seconds."""


@dataclass(frozen=True)
class TakeCalibration:
    """A calibration with which a performer drove a character in a take.

    Attributes
    ----------
    time : float
        Time from which it was used, the clock of the clip; that of the clip's first frame for the first one.
    calibration : Calibration
    mirror : bool or None
        Whether the performer's left moved the character's right; None in takes of an earlier version.
    """

    time: float
    calibration: Calibration
    mirror: bool | None


@dataclass(frozen=True)
class _Made:
    """A calibration in a take, None if it is damaged; `user` is the performer according to the cues, if known."""

    time: float
    user: int | None
    opening: bool
    calibration: Calibration | None
    mirror: bool | None = None


def of_performer(
    clips: Sequence[SkeletonClip], clip: SkeletonClip
) -> tuple[tuple[TakeCalibration, ...], tuple[str, ...]]:
    """Return the calibrations with which a performer drove a character in a take, in their order.

    The first is the one in use when the performer's clip begins, otherwise the first that was made later. Switching the
    mirror repeats a calibration.

    Parameters
    ----------
    clips : sequence of SkeletonClip
        Performers of the recording.
    clip : SkeletonClip
        The chosen performer, one of them.

    Returns
    -------
    calibrations : tuple of TakeCalibration
        Empty if the take has none of the performer.
    notes : tuple of str
        Sentences for the user about the origin of the calibration, and about damaged calibrations.
    """
    made = list(_made(clip.cues))
    damaged = sum(each.calibration is None for each in made)
    notes = (_about_damaged(damaged),) if damaged else ()
    own = [each for each in made if each.calibration is not None and _owner(each, clips) == clip.user]
    if not own:
        return (), notes
    used = next((each for each in reversed(own) if each.opening or each.time <= clip.times[0]), own[0])
    when = "was in use when the take began" if used.opening else f"was made at {used.time - clip.times[0]:.2f} s"
    notes = (*notes, f"The performer's calibration pose is the one in the take, which {when}.")
    found = [TakeCalibration(clip.times[0], _of(used), used.mirror)]
    for each in own[own.index(used) + 1 :]:
        last, again = found[-1], TakeCalibration(each.time, _of(each), each.mirror)
        if (last.calibration.to_json(), last.mirror) != (again.calibration.to_json(), again.mirror):
            found.append(again)  # not one that is repeated, as after a change of the mapping
    if len(found) > 1:
        times = ", ".join(f"{each.time - clip.times[0]:.2f}" for each in found[1:])
        notes = (*notes, f"It was calibrated or mirrored again at {times} s.")
    return tuple(found), notes


def _of(made: _Made) -> Calibration:
    assert made.calibration is not None  # noqa: S101 - damaged ones have been sorted out
    return made.calibration


def _made(cues: Sequence[Cue]) -> Iterator[_Made]:
    """Yield the calibrations of a take in its order, damaged ones without their values."""
    users: dict[str, int | None] = {}
    for cue in cues:
        character = cue.arguments.get("character")
        if cue.do == "stage":
            for name, state in _states(cue).items():
                users[name] = _number(state.get("user"))
                if state.get("calibration") is not None:
                    yield _Made(cue.time, users[name], True, *_valid(state["calibration"]))
        elif cue.do == "choose_user" and isinstance(character, str):
            users[character] = _number(cue.arguments.get("user"))
        elif cue.do == "begin":
            user = users.get(character) if isinstance(character, str) else None
            yield _Made(cue.time, user, False, *_valid(cue.arguments.get("calibration")))


def _states(cue: Cue) -> dict[str, dict[str, Any]]:
    """Return the states of the characters in a cue ``stage``."""
    states = cue.arguments.get("characters")
    if not isinstance(states, dict):
        return {}
    return {name: state for name, state in states.items() if isinstance(state, dict)}


def _valid(value: Any) -> tuple[Calibration | None, bool | None]:
    """Return the calibration of a cue and its mirroring; None if it is damaged."""
    try:
        found = Calibration.of_json(value)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return None, None
    mirror = value.get("mirror")
    extent = np.abs(np.append(found.rest, found.sensor.height))
    known = np.isfinite(found.rest).all(axis=1)
    if not known.any() or np.isinf(extent).any() or np.nanmax(extent) > MAX_METRES:
        return None, None
    is_body = max(body.bone_lengths(found.rest).values()) > 0
    return (found, mirror if isinstance(mirror, bool) else None) if is_body else (None, None)


def _number(user: Any) -> int | None:
    return user if type(user) is int else None


def _owner(made: _Made, clips: Sequence[SkeletonClip]) -> int | None:
    """Return the user number of a calibration's performer.

    It is the one in the cue at the beginning of the take, or the only one of the recording. Otherwise, it is the one
    according to the cues if in view, else the one whose pose is nearest to the calibration pose.
    """
    if made.opening or made.calibration is None:
        return made.user
    if len(clips) == 1:
        return clips[0].user
    distances = {}
    for clip in clips:
        recent = (made.time - IN_VIEW_SECONDS <= clip.times) & (clip.times <= made.time)
        apart = np.linalg.norm(clip.positions[recent] - made.calibration.rest, axis=-1)
        if np.isfinite(apart).any():
            distances[clip.user] = float(np.nanmedian(apart))
    return made.user if made.user in distances else min(distances, key=distances.__getitem__, default=None)


def _about_damaged(count: int) -> str:
    if count == 1:
        return "A calibration in the take is damaged and was ignored."
    return f"{count} calibrations in the take are damaged and were ignored."
