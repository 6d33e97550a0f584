"""One character on stage: who plays it, since when, and how it comes to rest when they leave.

Every change (a performer found, lost, calibrated anew, mirrored) is a change of what handles and bones follow. They
ease from where they were shown last to what they follow now, so that nothing ever jumps.
"""

import math
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from capture.events import TICK
from capture.sensor_tilt import MOVED, Level, level_of
from capture.skeleton import JOINTS, TRACKED, SkeletonFrame
from capture.smoothing import JointFilter
from engine_bridge.performance.calibration import NOW, LastSecond, same_body
from engine_bridge.performance.idle import Idle, Places
from engine_bridge.performance.performance import make_deformer
from engine_bridge.performance.retargeting import PERFORMER, Retargeting, legs_of
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.service.easing import MAX_STEP_SECONDS, Easing
from engine_bridge.service.performer_calibration import Calibration, PreparedCalibration, places_of, rows_of
from engine_bridge.service.protocol.frame import Frame, StreamedCharacter
from engine_bridge.service.states import State
from puppetline.errors import ServiceError
from solver.motion.feet import Feet
from solver.motion.limb_motion import LimbMotion
from solver.motion.motion_blend import difference, moved_by
from solver.motion.retarget import SmoothReturn, soft_limit

Calibrate = Literal["still", "at_once", "command"]
"""After the first still second; after a moment, in whatever pose; or when somebody says so."""

MAX_REMEMBERED = 16
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


class CharacterPlayer:
    """A character and whoever plays it.

    A calibration takes time to work out. It waits in `next_part` until `begin` is called, so that whoever gives the
    stage its events decides when, and a take can say when it was.

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
        self._idle_log = idle
        self._idle: Idle | None = None
        self._idle = self.make_idle()
        self.next_part: PreparedCalibration | None = None
        self._part: PreparedCalibration | None = None
        self._held: Places | None = None
        self._watched = JointFilter(rig.puppet.smoothing.parameters)  # of who is not calibrated yet
        self._last_second = LastSecond()
        self._look_again = False  # somebody who came back may be somebody else
        self._in_passing = False  # calibrated before they stood still
        self._level = Level(manner.tilt or 0.0, manner.height or 0.0)
        self._floor: Level | None = None  # how the sensor stands by the floor that it sees
        self._remembered: dict[int, tuple[Calibration, float]] = {}
        self._sequence = 0
        self._idle_since = -math.inf
        self._rest = Places(
            self._deformer.handles, np.tile(np.eye(4, 3), (len(self._deformer.bones), 1, 1)), np.zeros(3)
        )
        self._easing = Easing(self._deformer.bones, self._rest, manner.ease)
        self._rehearse()

    def _rehearse(self) -> None:
        """Do once what a frame does, so that no first frame waits for code to be compiled: that takes 15 seconds."""
        self._watched.step(0.0, np.zeros((len(JOINTS), 3)), np.full(len(JOINTS), TRACKED, dtype=np.float32))
        self._watched.reset()
        SmoothReturn(1).step(0.0, np.zeros((1, 3)), np.ones(1, dtype=bool))
        soft_limit(np.zeros((1, 3)), np.ones((1, 3, 2)))
        unknown, lost = np.full((len(JOINTS), 3), np.nan), np.zeros(len(JOINTS), dtype=np.float32)
        puppet = self.character.rig.puppet
        motions = LimbMotion(puppet.limbs, PERFORMER, unknown).step(0.0, unknown, lost)
        if legs := legs_of(puppet):
            Feet(self._deformer.bones, legs, 1.0).step(0.0, unknown, lost, motions, np.zeros(3))
        easing = Easing(self._deformer.bones, self._rest, 1.0)
        easing.begin(0.0)
        easing.show(MAX_STEP_SECONDS, self._rest)
        self._deformer.solve(self._deformer.handles)
        self._deformer.reset()

    @property
    def calibration(self) -> Calibration | None:
        """Of who performs; None while nobody does."""
        return None if self._part is None else self._part.calibration

    @property
    def level(self) -> Level:
        """How the sensor stands, as far as is known."""
        return self._level

    def enter(self, user: int, time: float) -> None:
        """Give the character to somebody."""
        self.user, self.state, self._in_passing = user, "calibrating", False
        self._last_second.forget()
        self._watched.reset()
        calibration, left = self._remembered.pop(user, (None, 0.0))
        if calibration is not None and self._floor is not None:
            stands = self._as_told(self._floor)
            calibration = calibration if calibration.level.near(stands, *MOVED) else None  # or is seen from elsewhere
        self._look_again = calibration is not None and time - left <= self._manner.remember
        if calibration is not None and self._look_again:
            self._prepare(calibration, time)

    def leave(self, time: float) -> None:
        """Take the character from whoever plays it; it goes back to what it does by itself."""
        self.remember(self.remembered())
        self.state = "waiting"
        if self._part is not None or self._held is not None:
            self.state = "leaving"
            self._idle_since = time
            self._easing.begin(time)
        self.user = self._part = self._held = None
        self._drop_next()

    def set_level(self, level: Level, time: float) -> None:
        """Take over how the sensor stands: at once, or with the next calibration of who performs while it is moved."""
        first, self._floor, level = self._floor is None, level, self._as_told(level)
        part = self.next_part or self._part
        if first and part is not None and not level.near(part.calibration.level, *MOVED):
            self._prepare(Calibration(part.calibration.rest, level), time)  # which was taken without
        if self._part is None:
            self._level = level
            self._watched.reset()

    def calibrate(self, time: float) -> bool:
        """Take the performer's pose of this moment for the character's rest pose; False if nothing of it is known."""
        if self.user is None or not self._last_second.enough(0.0):
            return False
        self._calibrate(self._last_second.pose(NOW), time)
        return True

    def set_mirror(self, mirror: bool, time: float) -> None:
        """Let the character be the performer's mirror image, or not."""
        self.mirror = mirror
        part = self.next_part or self._part
        if part is not None:
            self._prepare(part.calibration, time)

    def remap(self, puppet: Puppet, time: float) -> None:
        """Have the handles moved as another puppet with the same ones says, as soon as that is worked out.

        What the character does by itself is not worked out here: see `make_idle` and `take_idle`.
        """
        self.character = self.character.remapped(puppet)
        part = self.next_part or self._part
        if part is not None:
            self._prepare(part.calibration, time)

    def make_idle(self) -> Idle | None:
        """Work out what the character does by itself under its mapping as it is, which may take a second."""
        rig = self.character.rig
        if self._idle_log is None or (self._idle is not None and self._idle.puppet is rig.puppet):
            return self._idle
        return Idle(self._idle_log, rig, self._deformer)

    def take_idle(self, idle: Idle | None, time: float) -> None:
        """Go over to what the character does by itself, unless its mapping has changed since that was worked out."""
        if self._idle is None or idle is None or idle.puppet is self._idle.puppet:
            return  # several edits in a row are worked out once, and eased over to once
        if idle.puppet is self.character.rig.puppet:
            self._idle = idle
            if self._part is None:
                self._easing.begin(time)

    @property
    def settled(self) -> bool:
        """Whether the character moves as its puppet says: for a moment after an edit it moves as it did before."""
        return all(each is None or each.puppet is self.character.rig.puppet for each in (self._part, self._idle))

    def begin(self, time: float, recorded: Mapping[str, Any] | None = None) -> None:
        """Go over to the calibration that was asked for last, waiting for it if need be.

        Parameters
        ----------
        time : float
        recorded : mapping, optional
            `PreparedCalibration.to_json` of the calibration in a take, used instead of the one that was requested.

        Raises
        ------
        ServiceError
            It could not be worked out; what was before stays.
        """
        if recorded is not None and self.user is not None:
            self._take_recorded(recorded, time)
        part, self.next_part = self.next_part, None
        if part is None:
            return
        try:
            part.working.result()
        except Exception as error:  # a pose that no body has; the next still second gives another one
            raise ServiceError(
                self.character.name,
                found=f"a performer who cannot be calibrated ({type(error).__name__}: {error})",
                expected="the pose of a body",
                fix="Stand still once more, wholly in view.",
            ) from error
        self._part, self._held = part, None
        self._level = part.calibration.level
        self.state = "performing"
        self._easing.begin(time)

    def _take_recorded(self, recorded: Mapping[str, Any], time: float) -> None:
        """Have the next part be that of a take, if it is another one."""
        if self.next_part is not None and self.next_part.to_json() == recorded:
            return
        try:
            part = self._recorded_part(recorded, time)
        except (KeyError, TypeError, ValueError) as error:
            raise ServiceError(
                self.character.name,
                found=f"a damaged calibration in a take ({type(error).__name__}: {error})",
                expected="a take as it was recorded",
                fix="Remove this cue from the take.",
            ) from error
        self._drop_next()
        self.next_part = part

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
        if self.next_part is None:
            self._calibrate_when_due(frame.time)
        levelled = replace(frame, positions=self._level(frame.positions))
        if self._part is None:
            seen = replace(levelled, positions=self._watched.step(frame.time, levelled.positions, frame.confidence))
            return self._show(frame.time, received, self._by_itself(frame.time), seen)
        aim = self._part.retargeting.step(levelled)
        places = Places(aim.targets, aim.motions, aim.root)
        return self._show(frame.time, received, places, replace(levelled, positions=aim.joints))

    def pass_time(self, time: float, received: int) -> Frame | None:
        """Let time pass without a performer; None while there is one, or if it is too early for another frame."""
        if self.user is not None or time - self._easing.shown_at < 0.75 * TICK:
            return None
        if self.state == "leaving" and self._easing.finished(time):
            self.state = "waiting"
        return self._show(time, received, self._by_itself(time), None)

    def _calibrate_when_due(self, time: float) -> None:
        """Calibrate a new performer by themselves, and one who came back as somebody else.

        A limb that follows directions needs no rest pose: with such limbs a performer is the character after a moment,
        and is calibrated again when they first stand still, for everything else.
        """
        manner, last = self._manner.calibrate, self._last_second
        if self._part is not None and self._in_passing:
            if last.still():
                self._in_passing = False
                self._calibrate(last.pose(), time)
        elif self._part is not None:
            if self._look_again and last.still():
                self._look_again = False
                if not same_body(last.pose(), self._part.calibration.rest):
                    self._calibrate(last.pose(), time)
        elif manner == "still" and last.still():
            self._calibrate(last.pose(), time)
        elif (manner == "at_once" or (manner == "still" and self._directs)) and last.enough(NOW):
            self._in_passing = manner == "still"
            self._calibrate(last.pose(NOW), time)

    @property
    def _directs(self) -> bool:
        """Whether limbs follow directions, which need no rest pose."""
        return any(limb.follow == "direction" for limb in self.character.rig.puppet.limb)

    def _calibrate(self, rest: NDArray[np.float64], time: float) -> None:
        found = self._floor or level_of(rest) or self._level
        self._prepare(Calibration(rest, self._as_told(found)), time)

    def _as_told(self, found: Level) -> Level:
        """Return how the sensor stands: what the settings say counts more than what was found out."""
        tilt, height = self._manner.tilt, self._manner.height
        return Level(found.tilt if tilt is None else tilt, found.height if height is None else height, found.roll)

    def _prepare(self, calibration: Calibration, time: float) -> None:
        """Have a retargeting worked out beside the stream, in place of one that is still waiting for its turn."""
        self._drop_next()
        self.next_part = self._new_part(calibration, self.mirror, time)

    def _drop_next(self) -> None:
        if self.next_part is not None:
            self.next_part.working.cancel()
        self.next_part = None

    def _new_part(self, calibration: Calibration, mirror: bool, asked: float) -> PreparedCalibration:
        puppet = self.character.rig.puppet
        return PreparedCalibration(
            calibration, mirror, asked, puppet, self._executor.submit(self._retarget, puppet, calibration, mirror)
        )

    def _retarget(self, puppet: Puppet, calibration: Calibration, mirror: bool) -> Retargeting:
        retarget = puppet.retarget.model_copy(update={"mirror": mirror})
        puppet = puppet.model_copy(update={"retarget": retarget})
        return Retargeting(puppet, self.character.rig.mesh, self._deformer, calibration.level(calibration.rest))

    def _by_itself(self, time: float) -> Places:
        """Return what the character does while nobody plays it."""
        if self._held is not None:
            return self._held
        if self._idle is None:
            return self._rest
        if math.isinf(self._idle_since):
            self._idle_since = time
        return self._idle.at(time - self._idle_since)

    def _show(self, time: float, received: int, places: Places, seen: SkeletonFrame | None) -> Frame:
        places = self._easing.show(time, places)
        self._sequence += 1
        return Frame(
            character=self.character,
            sequence=self._sequence,
            time=time,
            received=received,
            state=self.state,
            user=self.user,
            R=self._deformer.solve(places.targets, places.motions),
            root=places.root,
            targets=places.targets + places.root,
            motions=places.motions,
            joints=None if seen is None else seen.positions,
            confidence=None if seen is None else seen.confidence,
        )

    def remembered(self) -> dict[int, tuple[Calibration, float]]:
        """Return the calibrations of those who play or have played, and when they were last shown."""
        part = self._part or self.next_part
        if self.user is None or part is None:
            return self._remembered
        return self._remembered | {self.user: (part.calibration, self._easing.shown_at)}

    def remember(self, known: dict[int, tuple[Calibration, float]]) -> None:
        """Take over calibrations, those last in the dict first."""
        self._remembered = dict(list(known.items())[-MAX_REMEMBERED:])

    def succeed(self, other: "CharacterPlayer") -> None:
        """Go on for the same character as it was before it was loaded anew, as if nothing had been."""
        if self.character.rig.puppet.retarget.mirror == other.character.rig.puppet.retarget.mirror:
            self.mirror = other.mirror
        self.remember(other.remembered())
        self._level, self._floor, self._sequence = other._level, other._floor, other._sequence
        self._idle_since = other._idle_since
        self._easing.shown, self._easing.shown_at = self._places_of(other), other._easing.shown_at
        self._easing.begin(other._easing.shown_at)
        self.state = "leaving" if other.user is None else "waiting"
        if other.user is not None:
            playing = other._part is not None
            self.enter(other.user, other._easing.shown_at)
            self._held = self._easing.shown if playing and self.next_part is not None else None

    def _places_of(self, other: "CharacterPlayer") -> Places:
        """Return where another role's handles and limbs are shown, by name; a new one is where it rests."""
        names = [handle.name for handle in other.character.rig.puppet.handle]
        moved = dict(zip(names, other._easing.shown.targets - other._deformer.handles, strict=True))
        ours = [handle.name for handle in self.character.rig.puppet.handle]
        targets = self._rest.targets + np.reshape([moved.get(name, np.zeros(3)) for name in ours], (-1, 3))
        motions, theirs = self._rest.motions, other.character.rig.puppet.limbs
        if [(limb.name, len(limb.points)) for limb in self.character.rig.puppet.limbs] == [
            (limb.name, len(limb.points)) for limb in theirs
        ]:
            apart = difference(other._deformer.bones, other._rest.motions, other._easing.shown.motions)
            motions = moved_by(self._deformer.bones, motions, apart, 1.0)
        return Places(targets, motions, other._easing.shown.root)

    def snapshot(self) -> dict[str, Any]:
        """Return who plays the character and how, as values of JSON's types, for `resume`.

        Filters are not part of it.
        """
        return {
            "user": self.user,
            "state": self.state,
            "mirror": self.mirror,
            "manner": asdict(self._manner),
            "sensor": asdict(self._level),
            "floor": None if self._floor is None else asdict(self._floor),
            "calibration": None if self._part is None else self._part.to_json(),
            "standing": [] if self._part is None else rows_of(self._part.retargeting.standing),
            "next_calibration": None if self.next_part is None else self.next_part.to_json(),
            "remembered": [
                {"user": user, "left": left, **known.to_json()} for user, (known, left) in self._remembered.items()
            ],
            "shown_at": _finite(self._easing.shown_at),
            "idle_since": _finite(self._idle_since),
            "eased_since": _finite(self._easing.since),
        }

    def resume(self, snapshot: Mapping[str, Any], time: float, shift: float) -> None:
        """Continue as `snapshot` says; filters start again.

        Parameters
        ----------
        snapshot : mapping
        time : float
        shift : float
            Seconds to add to the times of the snapshot.

        Raises
        ------
        KeyError, TypeError, ValueError
            Values that are no snapshot.
        """
        state: State = "waiting" if snapshot["user"] is None else "calibrating"
        part = None if snapshot["calibration"] is None else self._recorded_part(snapshot["calibration"], time)
        if part is not None:
            part.retargeting.stand(places_of(snapshot["standing"]))
            state = "performing"
        elif snapshot["state"] == "leaving":
            state = "leaving"
        following = snapshot["next_calibration"]
        remembered = {
            int(each["user"]): (Calibration.of_json(each), float(each["left"]) + shift)
            for each in snapshot["remembered"]
        }
        shown_at, idle_since, eased_since = (
            -math.inf if snapshot[name] is None else float(snapshot[name]) + shift
            for name in ("shown_at", "idle_since", "eased_since")
        )
        self._manner = Manner(**snapshot["manner"])
        self._easing.seconds = self._manner.ease
        self._level = Level.of_json(snapshot["sensor"])
        self._floor = None if snapshot["floor"] is None else Level.of_json(snapshot["floor"])
        self.mirror, self.user, self.state = bool(snapshot["mirror"]), snapshot["user"], state
        self._drop_next()
        self._part, self.next_part = part, None if following is None else self._recorded_part(following, time)
        self._held = None
        self._watched.reset()
        self._last_second.forget()
        self.remember(remembered)
        self._easing.begin(time)
        if not self._sequence:  # nothing is shown yet that it could ease from
            self._easing.since = eased_since
        self._easing.shown_at, self._idle_since = shown_at, idle_since

    def _recorded_part(self, recorded: Mapping[str, Any], asked: float) -> PreparedCalibration:
        return self._new_part(Calibration.of_json(recorded), bool(recorded["mirror"]), asked)


def _finite(time: float) -> float | None:
    """Return a time as JSON has it."""
    return time if math.isfinite(time) else None
