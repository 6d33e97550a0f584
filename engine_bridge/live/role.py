"""One character on stage: who plays it, since when, and how it comes to rest when they leave.

Every change (a performer found, lost, calibrated anew, mirrored) is a change of what the handles follow. They ease from
where they were shown last to what they follow now, so that nothing ever jumps.
"""

import math
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from capture.events import TICK
from capture.skeleton import JOINTS, SkeletonFrame
from engine_bridge.live.calibration import NOW, LastSecond, same_body
from engine_bridge.live.frame import Frame, StreamedCharacter
from engine_bridge.live.idle import Idle
from engine_bridge.live.level import Level, level_of
from engine_bridge.performance import make_deformer
from engine_bridge.retargeting import Retargeting

Calibrate = Literal["still", "at_once", "command"]
"""After the first still second; after a moment, in whatever pose; or when somebody says so."""

State = Literal["waiting", "calibrating", "performing", "leaving"]

PREPARATION = 0.3
"""Seconds on the source's clock from a calibration to its use: longer than it takes to work out, so that nobody waits
for it, and always the same, so that a take plays as it was."""

MOST_REMEMBERED = 16
"""Performers whose calibration is kept after they have left."""


@dataclass(frozen=True)
class Manner:
    """How a role treats its performers.

    Attributes
    ----------
    calibrate : {"still", "at_once", "command"}
    ease : float
        Seconds in which a character goes over from one thing to another.
    remember : float
        Seconds for which somebody who left can come back without being calibrated.
    tilt, height : float or None
        Of the sensor, see `Level`; None to find them out from performers who stand upright.
    """

    calibrate: Calibrate = "still"
    ease: float = 0.8
    remember: float = 30.0
    tilt: float | None = None
    height: float | None = None


@dataclass(frozen=True)
class Calibration:
    """What a performer looked like in the pose that stands for the character's rest pose.

    Attributes
    ----------
    rest : (20, 3) float64
        Metres, sensor frame.
    level : Level
        How the sensor stood.
    """

    rest: NDArray[np.float64]
    level: Level

    @property
    def memory(self) -> list[Any]:
        """All of it, for `engine_bridge.live.memory`."""
        return [self.rest, [self.level.tilt, self.level.height]]

    @classmethod
    def of_memory(cls, memory: list[Any]) -> "Calibration":
        """Make one of what `memory` was.

        Raises
        ------
        ValueError
            It was something else.
        """
        rest, (tilt, height) = memory
        if np.shape(rest) != (len(JOINTS), 3):
            raise ValueError(f"a pose of shape {np.shape(rest)}")
        return cls(rest, Level(float(tilt), float(height)))


@dataclass(frozen=True)
class _Part:
    """A calibrated performer: from when on, and how, they move the character."""

    calibration: Calibration
    mirror: bool
    since: float
    working: Future[Retargeting]

    @property
    def retargeting(self) -> Retargeting:
        """Worked out by now, as a rule; waited for if not."""
        return self.working.result()


_Places = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Where the handles go (h, 3), without the root's motion, and the root's translation (3,)."""


class Role:
    """A character and whoever plays it.

    Parameters
    ----------
    character : StreamedCharacter
    manner : Manner
    executor : Executor
        Works calibrations out beside the stream.
    idle : Path, optional
        A skeleton log of what the character does while nobody plays it; it rests if left out.

    Raises
    ------
    PuppetlineError
        The log cannot be read, or the character cannot be solved for.
    """

    def __init__(
        self, character: StreamedCharacter, manner: Manner, executor: Executor, idle: Path | None = None
    ) -> None:
        rig = character.rig
        self.character = character
        self.user: int | None = None
        self.state: State = "waiting"
        self.mirror = rig.puppet.retarget.mirror
        self._manner, self._executor = manner, executor
        self._deformer = make_deformer(rig.puppet, rig.mesh, rig.model)
        self._idle = None if idle is None else Idle(idle, rig, self._deformer)
        self._part: _Part | None = None
        self._next_part: _Part | None = None
        self._last_second = LastSecond()
        self._look_again = False  # somebody who came back may be somebody else
        self._level = Level(manner.tilt or 0.0, manner.height or 0.0)
        self._remembered: dict[int, tuple[Calibration, float]] = {}
        self._sequence = 0
        self._shown_at = self._idle_since = self._eased_since = -math.inf
        self._shown = self._eased_from = self._deformer.handles, np.zeros(3)

    def enter(self, user: int, time: float) -> None:
        """Give the character to somebody."""
        self.user, self.state = user, "calibrating"
        self._last_second.forget()
        calibration, left = self._remembered.pop(user, (None, 0.0))
        self._look_again = calibration is not None and time - left <= self._manner.remember
        if calibration is not None and self._look_again:
            self._prepare(calibration, time)

    def leave(self, time: float) -> None:
        """Take the character from whoever plays it; it goes back to what it does by itself."""
        self.remember(self.remembered())
        self.state = "waiting"
        if self._part is not None:
            self.state = "leaving"
            self._idle_since = time
            self._ease(time)
        self.user = self._part = self._next_part = None

    def calibrate(self, time: float) -> bool:
        """Take the performer's pose of this moment for the character's rest pose; False if nothing of it is known."""
        if self.user is None or not self._last_second.enough(0.0):
            return False
        self._calibrate(self._last_second.pose(NOW), time)
        return True

    def set_mirror(self, mirror: bool, time: float) -> None:
        """Let the character be the performer's mirror image, or not."""
        self.mirror = mirror
        part = self._next_part or self._part
        if part is not None:
            self._prepare(part.calibration, time)

    def perform(self, frame: SkeletonFrame, received: int) -> Frame:
        """Take a frame of the performer.

        Parameters
        ----------
        frame : SkeletonFrame
            Later than the one before; sensor frame.
        received : int
            `time.monotonic_ns` at which it came.
        """
        self._last_second.add(frame)
        if self._next_part is None:
            self._calibrate_when_due(frame.time)
        if self._next_part is not None and frame.time >= self._next_part.since:
            self._begin(self._next_part, frame.time)
        levelled = replace(frame, positions=self._level(frame.positions))
        if self._part is None:
            return self._show(frame.time, received, self._by_itself(frame.time), levelled)
        aim = self._part.retargeting.step(levelled)
        return self._show(frame.time, received, (aim.targets, aim.root), replace(levelled, positions=aim.joints))

    def pass_time(self, time: float, received: int) -> Frame | None:
        """Let time pass without a performer; None while there is one, or if it is too early for another frame."""
        if self.user is not None or time - self._shown_at < 0.75 * TICK:
            return None
        if self.state == "leaving" and time - self._eased_since >= self._manner.ease:
            self.state = "waiting"
        return self._show(time, received, self._by_itself(time), None)

    def _calibrate_when_due(self, time: float) -> None:
        """Calibrate a new performer by themselves, and one who came back as somebody else."""
        manner, last = self._manner.calibrate, self._last_second
        if self._part is not None:
            if self._look_again and last.still():
                self._look_again = False
                if not same_body(last.pose(), self._part.calibration.rest):
                    self._calibrate(last.pose(), time)
        elif manner == "still" and last.still():
            self._calibrate(last.pose(), time)
        elif manner == "at_once" and last.enough(NOW):
            self._calibrate(last.pose(NOW), time)

    def _calibrate(self, rest: NDArray[np.float64], time: float) -> None:
        found = level_of(rest) or self._level
        tilt, height = self._manner.tilt, self._manner.height
        level = Level(found.tilt if tilt is None else tilt, found.height if height is None else height)
        self._prepare(Calibration(rest, level), time)

    def _prepare(self, calibration: Calibration, time: float) -> None:
        """Have a retargeting worked out, to be used a moment later."""
        working = self._executor.submit(self._retarget, calibration, self.mirror)
        self._next_part = _Part(calibration, self.mirror, time + PREPARATION, working)

    def _retarget(self, calibration: Calibration, mirror: bool) -> Retargeting:
        rig = self.character.rig
        retarget = rig.puppet.retarget.model_copy(update={"mirror": mirror})
        puppet = rig.puppet.model_copy(update={"retarget": retarget})
        return Retargeting(puppet, rig.mesh, self._deformer, calibration.level(calibration.rest))

    def _begin(self, part: _Part, time: float) -> None:
        self._next_part = None
        part.working.result()  # were it to fail, the performer would be calibrated again
        self._part = part
        self._level = part.calibration.level
        self.state = "performing"
        self._ease(time)

    def _by_itself(self, time: float) -> _Places:
        """Return what the character does while nobody plays it."""
        if self._idle is None:
            return self._deformer.handles, np.zeros(3)
        if math.isinf(self._idle_since):
            self._idle_since = time
        return self._idle.at(time - self._idle_since)

    def _ease(self, time: float) -> None:
        """Go over from where the handles are shown to what they follow from now on."""
        self._eased_from, self._eased_since = self._shown, time

    def _show(self, time: float, received: int, places: _Places, seen: SkeletonFrame | None) -> Frame:
        share = min((time - self._eased_since) / self._manner.ease, 1.0) if self._manner.ease > 0 else 1.0
        if share < 1.0:
            share = share * share * (3.0 - 2.0 * share)
            (targets, root), (to_targets, to_root) = self._eased_from, places
            places = targets + share * (to_targets - targets), root + share * (to_root - root)
        self._shown, self._shown_at = places, time
        targets, root = places
        self._sequence += 1
        return Frame(
            character=self.character,
            sequence=self._sequence,
            time=time,
            received=received,
            state=self.state,
            user=self.user,
            R=self._deformer.solve(targets),
            root=root,
            targets=targets + root,
            joints=None if seen is None else seen.positions,
            confidence=None if seen is None else seen.confidence,
        )

    def remembered(self) -> dict[int, tuple[Calibration, float]]:
        """Return the calibrations of those who play or have played, and when they were last shown."""
        if self.user is None or self._part is None:
            return self._remembered
        return self._remembered | {self.user: (self._part.calibration, self._shown_at)}

    def remember(self, known: dict[int, tuple[Calibration, float]]) -> None:
        """Take over calibrations, those last in the dict first."""
        self._remembered = dict(list(known.items())[-MOST_REMEMBERED:])

    def succeed(self, other: "Role") -> None:
        """Take over the performer of the same character as it was before it was loaded anew."""
        self.remember(other.remembered())
        self._sequence = other._sequence
        if other.user is not None:
            self.enter(other.user, other._shown_at)

    @property
    def memory(self) -> dict[str, Any]:
        """What is carried from frame to frame; setting it goes on where another role of the same puppet was."""
        return {
            "user": self.user,
            "state": self.state,
            "mirror": self.mirror,
            "look_again": self._look_again,
            "level": [self._level.tilt, self._level.height],
            "part": _part_memory(self._part),
            "retargeting": None if self._part is None else self._part.retargeting.memory,
            "next_part": _part_memory(self._next_part),
            "times": [self._shown_at, self._idle_since, self._eased_since],
            "shown": list(self._shown),
            "eased_from": list(self._eased_from),
            "last_second": self._last_second.memory,
            "deformer": self._deformer.memory,
            "remembered": [[user, known.memory, left] for user, (known, left) in self._remembered.items()],
        }

    @memory.setter
    def memory(self, memory: dict[str, Any]) -> None:
        self.user, self.state, self.mirror = memory["user"], memory["state"], memory["mirror"]
        self._look_again = memory["look_again"]
        self._level = Level(*memory["level"])
        self._part, self._next_part = self._part_of(memory["part"]), self._part_of(memory["next_part"])
        if self._part is not None:
            self._part.retargeting.memory = memory["retargeting"]
        self._shown_at, self._idle_since, self._eased_since = memory["times"]
        targets, root = memory["shown"]
        self._shown = targets, root
        targets, root = memory["eased_from"]
        self._eased_from = targets, root
        self._last_second.memory = memory["last_second"]
        self._deformer.memory = memory["deformer"]
        self._remembered = {user: (Calibration.of_memory(known), left) for user, known, left in memory["remembered"]}

    def _part_of(self, memory: list[Any] | None) -> _Part | None:
        if memory is None:
            return None
        calibration, mirror, since = Calibration.of_memory(memory[0]), memory[1], memory[2]
        return _Part(calibration, mirror, since, self._executor.submit(self._retarget, calibration, mirror))


def _part_memory(part: _Part | None) -> list[Any] | None:
    return None if part is None else [part.calibration.memory, part.mirror, part.since]
