"""Assignment of several sensors' observations to performers, and correction of swapped sides; no clocks or sockets."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from capture.body import LIMB_ROOTS
from capture.events import Lost
from capture.fusion.joints import MAX_AGE_SECONDS, Observation, fuse, is_swapped
from capture.fusion.walking import MAX_WALK_METRES, Walk
from capture.skeleton import JOINT_INDEX, LOST, OPPOSITE, SkeletonFrame

MAX_SAME_METRES, MIN_OTHER_METRES = 0.45, 0.8
"""Distances between two sensors' positions of a body: maximum to assign it to a performer, minimum to separate it."""
MAX_OBSERVATION_SECONDS = 0.5
"""Maximum age of an observation that determines a performer's position and sides."""
MAX_ABSENCE_SECONDS = 2.0
"""Maximum absence after which a body at the performer's last position is the same performer."""
LEADER_TIMEOUT_SECONDS = 0.1
"""Time without a frame after which the next sensor determines the times of a performer's frames."""
SIDE_DECISION_SECONDS = 1.0
"""Time after a performer's first frame in which the most confident sensor determines which side is left."""
FORGET_SECONDS = 30.0
"""Time for which a performer without observations keeps the user number."""

_TRUNK = [JOINT_INDEX[name] for name in ("hip_center", "spine", "shoulder_center", *LIMB_ROOTS)]


@dataclass
class _Performer:
    """A performer, with the user numbers and last observations of the sensors."""

    user: int
    since: float
    users: dict[int, int] = field(default_factory=dict)
    observations: dict[int, Observation] = field(default_factory=dict)
    last_frame: SkeletonFrame | None = None
    walk: Walk = field(default_factory=Walk)

    @property
    def last_seen(self) -> float:
        return max((observation.time for observation in self.observations.values()), default=-math.inf)

    def recent_others(self, sensor: int, time: float) -> dict[int, Observation]:
        """Return the recent observations of the other sensors."""
        return {
            other: observation
            for other, observation in self.observations.items()
            if other != sensor and time - observation.time < MAX_OBSERVATION_SECONDS
        }

    def frame(self, time: float) -> SkeletonFrame:
        """Return the fused frame at a time; swap the sides if the performer seems to walk backwards."""
        before = self.last_frame
        recent = before.positions if before is not None and time - before.time <= MAX_AGE_SECONDS else None
        frame = SkeletonFrame(time, self.user, *fuse(list(self.observations.values()), time, recent))
        self.walk.follow(frame)
        if self.walk.forwards < -MAX_WALK_METRES and time - self.since >= SIDE_DECISION_SECONDS:
            self.walk.forwards *= -1
            self.observations = {sensor: observation.swapped() for sensor, observation in self.observations.items()}
            frame = _swapped(frame)
        self.last_frame = frame
        return frame


class Performers:
    """All performers in view of several sensors.

    The first sensor that sees a performer determines the times of the performer's frames. The observations of the other
    sensors are extrapolated to these times. If a sensor sends no more frames, the next one replaces it.
    """

    def __init__(self) -> None:
        self._performers: list[_Performer] = []
        self._last_user = 0

    def observe(self, sensor: int, frame: SkeletonFrame) -> SkeletonFrame | None:
        """Add a sensor's frame, and return the performer's fused frame if the sensor determines its time.

        Parameters
        ----------
        sensor : int
            Index of the sensor. The lowest index determines the times of frames.
        frame : SkeletonFrame
            In common coordinates, on the common clock, with the sensor's own user number.
        """
        if not (frame.confidence > LOST).any():
            return None
        performer = self._performer(sensor, frame)
        if performer is None:
            return None
        frame = self._with_correct_sides(performer, sensor, frame)
        observations = performer.observations
        observations[sensor] = Observation.after(observations.get(sensor), frame)
        earliest = frame.time - LEADER_TIMEOUT_SECONDS
        has_leader = any(each.time > earliest and other < sensor for other, each in observations.items())
        if has_leader or (performer.last_frame is not None and frame.time <= performer.last_frame.time):
            return None
        return performer.frame(frame.time)

    def lose(self, sensor: int, user: int, time: float) -> list[Lost]:
        """Remove a sensor's user; return the performers whom all sensors have lost."""
        for performer in self._performers:
            if performer.users.get(sensor) == user:
                del performer.users[sensor]
                performer.observations.pop(sensor, None)
        return self._remove([each for each in self._performers if not each.users], time)

    def forget(self, time: float) -> list[Lost]:
        """Remove and return the performers without an observation for `FORGET_SECONDS`."""
        return self._remove([each for each in self._performers if time - each.last_seen > FORGET_SECONDS], time)

    def _remove(self, removed: list[_Performer], time: float) -> list[Lost]:
        self._performers = [each for each in self._performers if each not in removed]
        return [Lost(time, each.user) for each in removed if each.last_frame is not None]

    def _performer(self, sensor: int, frame: SkeletonFrame) -> _Performer | None:
        """Return the performer of a sensor's frame.

        None while the sensor has another user at the same performer, so that two performers cannot be distinguished.
        """
        position = _position(frame)
        known = next((each for each in self._performers if each.users.get(sensor) == frame.user), None)
        if known is not None:
            others = [_position(each) for each in known.recent_others(sensor, frame.time).values()]
            if not others or min(math.dist(position, other) for other in others) < MIN_OTHER_METRES:
                return known
            del known.users[sensor]  # the sensor has confused two performers
            known.observations.pop(sensor, None)
        candidates = [
            (math.dist(position, _position(observation)), each)
            for each in self._performers
            for observation in each.observations.values()
            if frame.time - observation.time < MAX_ABSENCE_SECONDS
        ]
        distance, nearest = min(candidates, key=lambda candidate: candidate[0], default=(math.inf, None))
        if nearest is None or distance > MAX_SAME_METRES:
            self._last_user += 1
            nearest = _Performer(self._last_user, frame.time)
            self._performers.append(nearest)
        else:
            own = nearest.observations.get(sensor)
            if own is not None and frame.time - own.time < MAX_OBSERVATION_SECONDS:
                return None
        nearest.users[sensor] = frame.user
        return nearest

    def _with_correct_sides(self, performer: _Performer, sensor: int, frame: SkeletonFrame) -> SkeletonFrame:
        """Return a frame with the sides as in the frames before, because many trackers mistake a back for a front."""
        others = performer.recent_others(sensor, frame.time)
        if frame.time - performer.since < SIDE_DECISION_SECONDS:
            best = max(others.values(), key=_mean_confidence, default=None)
            if best is None or _mean_confidence(frame) > _mean_confidence(best):
                wrong = {k: each for k, each in others.items() if _has_other_sides(frame, each)}
                performer.observations |= {k: each.swapped() for k, each in wrong.items()}
                return frame
            return _swapped(frame) if _has_other_sides(frame, best) else frame
        before = performer.last_frame
        if before is None or abs(frame.time - before.time) > MAX_OBSERVATION_SECONDS:
            return frame
        return _swapped(frame) if _has_other_sides(frame, before) else frame


def _mean_confidence(seen: Observation | SkeletonFrame) -> float:
    return float(seen.confidence.mean())


def _has_other_sides(one: SkeletonFrame, other: Observation | SkeletonFrame) -> bool:
    return is_swapped(one.positions, one.confidence, other.positions, other.confidence)


def _swapped(frame: SkeletonFrame) -> SkeletonFrame:
    return replace(frame, positions=frame.positions[OPPOSITE], confidence=frame.confidence[OPPOSITE])


def _position(seen: Observation | SkeletonFrame) -> NDArray[np.float64]:
    """Return the position of a body: the mean of its trunk, or of all known joints."""
    known = seen.confidence > LOST
    trunk = [joint for joint in _TRUNK if known[joint]]
    return seen.positions[trunk or known].mean(axis=0)
