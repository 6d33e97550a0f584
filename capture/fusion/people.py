"""Who is who among what several sensors see, and which way round; pure bookkeeping, without clocks or sockets."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from capture.body import LIMB_ROOTS
from capture.events import Lost
from capture.fusion.joints import OLDEST, Sight, fuse, other_way_round
from capture.fusion.walking import ENOUGH, Walk
from capture.skeleton import JOINT_INDEX, LOST, OPPOSITE, SkeletonFrame

NEAR, FAR = 0.45, 0.8
"""Metres between two sensors' ideas of where a body is, up to which it is one performer's, and from which it is not."""
FRESH = 0.5
"""Seconds for which what was seen tells where somebody is, and which way round."""
RETURN = 2.0
"""Seconds within which who appears where somebody was is the same one."""
LEAD = 0.1
"""Seconds of silence after which the next sensor sets the pace of a performer."""
FOUNDING = 1.0
"""Seconds after a performer's first frame in which the surest sensor says which side is left."""
REMEMBERED = 30.0
"""Seconds for which a performer whom nobody sees keeps the number."""

_MIDDLE = [JOINT_INDEX[name] for name in ("hip_center", "spine", "shoulder_center", *LIMB_ROOTS)]


@dataclass
class _Performer:
    """Somebody whom sensors see: by each of them under a number of its own."""

    user: int
    since: float
    users: dict[int, int] = field(default_factory=dict)
    sights: dict[int, Sight] = field(default_factory=dict)
    given: SkeletonFrame | None = None
    walk: Walk = field(default_factory=Walk)

    @property
    def seen(self) -> float:
        return max((sight.time for sight in self.sights.values()), default=-math.inf)

    def frame(self, moment: float) -> SkeletonFrame:
        """Make the frame of a moment; from where walking tells that left is right, they are exchanged."""
        before = self.given
        recent = before.positions if before is not None and moment - before.time <= OLDEST else None
        given = SkeletonFrame(moment, self.user, *fuse(list(self.sights.values()), moment, recent))
        self.walk.follow(given)
        if self.walk.forwards < -ENOUGH and moment - self.since >= FOUNDING:
            self.walk.forwards *= -1
            self.sights = {sensor: sight.swapped() for sensor, sight in self.sights.items()}
            given = _swapped(given)
        self.given = given
        return given


class People:
    """All performers before a number of sensors.

    A performer's frames come at the pace of the first sensor that sees the performer; what the others saw is carried
    on, or back, to that moment. So the pace is even, and a sensor that falls silent is replaced by the next.
    """

    def __init__(self) -> None:
        self._performers: list[_Performer] = []
        self._number = 0

    def see(self, sensor: int, frame: SkeletonFrame) -> SkeletonFrame | None:
        """Take in what a sensor sees, and return the performer's frame if it is time for one.

        Parameters
        ----------
        sensor : int
            Its place among the sensors: the first one sets the pace.
        frame : SkeletonFrame
            In the common frame, on the common clock, by the sensor's own number.
        """
        if not (frame.confidence > LOST).any():
            return None
        performer = self._performer(sensor, frame)
        if performer is None:
            return None
        frame = self._right_way_round(performer, sensor, frame)
        performer.sights[sensor] = Sight.after(performer.sights.get(sensor), frame)
        led = any(sight.time > frame.time - LEAD and before < sensor for before, sight in performer.sights.items())
        if led or (performer.given is not None and frame.time <= performer.given.time):
            return None
        return performer.frame(frame.time)

    def lose(self, sensor: int, user: int, time: float) -> list[Lost]:
        """Take in that a sensor has lost somebody; return who is gone for all of them."""
        for performer in self._performers:
            if performer.users.get(sensor) == user:
                del performer.users[sensor]
                performer.sights.pop(sensor, None)
        return self._leave([each for each in self._performers if not each.users], time)

    def forget(self, time: float) -> list[Lost]:
        """Return who has not been seen for too long; they are gone."""
        return self._leave([each for each in self._performers if time - each.seen > REMEMBERED], time)

    def _leave(self, gone: list[_Performer], time: float) -> list[Lost]:
        self._performers = [each for each in self._performers if each not in gone]
        return [Lost(time, each.user) for each in gone if each.given is not None]

    def _performer(self, sensor: int, frame: SkeletonFrame) -> _Performer | None:
        """Find whom a sensor sees; None while two performers are too close to tell."""
        place = _place(frame)
        known = next((each for each in self._performers if each.users.get(sensor) == frame.user), None)
        if known is not None:
            others = [
                _place(sight)
                for other, sight in known.sights.items()
                if other != sensor and frame.time - sight.time < FRESH
            ]
            if not others or min(math.dist(place, other) for other in others) < FAR:
                return known
            del known.users[sensor]  # the sensor has taken two people for each other
            known.sights.pop(sensor, None)
        there = [
            (math.dist(place, _place(sight)), each)
            for each in self._performers
            for sight in each.sights.values()
            if frame.time - sight.time < RETURN
        ]
        distance, nearest = min(there, key=lambda found: found[0], default=(math.inf, None))
        if nearest is None or distance > NEAR:
            self._number += 1
            nearest = _Performer(self._number, frame.time)
            self._performers.append(nearest)
        elif (sight := nearest.sights.get(sensor)) is not None and frame.time - sight.time < FRESH:
            return None
        nearest.users[sensor] = frame.user
        return nearest

    def _right_way_round(self, performer: _Performer, sensor: int, frame: SkeletonFrame) -> SkeletonFrame:
        """Return a frame with the sides as they were before, for many trackers take a back for a front."""
        others = {k: each for k, each in performer.sights.items() if k != sensor and frame.time - each.time < FRESH}
        if frame.time - performer.since < FOUNDING:
            surest = max(others.values(), key=_certainty, default=None)
            if surest is None or _certainty(frame) > _certainty(surest):
                performer.sights |= {k: each.swapped() for k, each in others.items() if _unlike(frame, each)}
                return frame
            return _swapped(frame) if _unlike(frame, surest) else frame
        before = performer.given
        if before is None or abs(frame.time - before.time) > FRESH or not _unlike(frame, before):
            return frame
        return _swapped(frame)


def _certainty(seen: Sight | SkeletonFrame) -> float:
    return float(seen.confidence.mean())


def _unlike(one: SkeletonFrame, other: Sight | SkeletonFrame) -> bool:
    return other_way_round(one.positions, one.confidence, other.positions, other.confidence)


def _swapped(frame: SkeletonFrame) -> SkeletonFrame:
    return replace(frame, positions=frame.positions[OPPOSITE], confidence=frame.confidence[OPPOSITE])


def _place(seen: Sight | SkeletonFrame) -> NDArray[np.float64]:
    """Return where a body is: the middle of its trunk, or of all that is known."""
    known = seen.confidence > LOST
    trunk = [joint for joint in _MIDDLE if known[joint]]
    return seen.positions[trunk or known].mean(axis=0)
