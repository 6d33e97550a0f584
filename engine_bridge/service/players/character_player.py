"""One character: its performer, its calibrations and mapping, and when its motion changes what it follows.

Every change (a performer arrives, leaves or is calibrated again, or mirroring is switched) changes what handles and
bones follow. They ease from where they were last shown, see `CharacterMotion`.
"""

import math
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture.events import TICK_SECONDS
from capture.sensor_tilt import MIN_TILT_CHANGE, SensorTilt, estimate_tilt
from capture.skeleton import SkeletonFrame
from capture.smoothing import JointFilter
from engine_bridge.performance.calibration import Calibration, places_of, rows_of
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.idle import idle_motion
from engine_bridge.performance.motion import Motion
from engine_bridge.performance.pose import Pose, TargetPose
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.puppet_document import PuppetDocument
from engine_bridge.service.players.appearance import Appearance
from engine_bridge.service.players.automatic_calibration import AutomaticCalibration, PreparedCalibration
from engine_bridge.service.players.player_settings import PlayerSettings
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.states import State
from puppetline.errors import ServiceError
from solver.motion.deformer import Deformer

MAX_REMEMBERED = 16
"""Maximum number of performers whose calibration is kept after they have left."""


class CharacterPlayer:
    """A character and its performer.

    A calibration takes time to compute. It waits in `next_calibration` until `begin` is called, so that the caller
    decides when, and a take can record when it was.

    Parameters
    ----------
    character : StreamedCharacter
    settings : PlayerSettings
    executor : Executor
        Computes calibrations while the stream continues.
    idle : Path, optional
        Idle recording: the character's motion without a performer; its rest pose by default.

    Attributes
    ----------
    document : PuppetDocument
        The puppet file that it was loaded from, assigned by the loader.
    with_puppet : callable
        Returns a player of the same character with another puppet, assigned by the loader. Its model is computed.
    follows_take : bool
        Whether a take drives the character instead of a performer.
    motion : CharacterMotion
    sequence : int
        Number of frames so far.
    shown : Appearance or None
        That of the last frame.

    Raises
    ------
    PuppetlineError
        The recording cannot be read, or the character cannot be solved.
    """

    document: PuppetDocument
    with_puppet: Callable[[Puppet], "CharacterPlayer"]

    def __init__(
        self, character: StreamedCharacter, settings: PlayerSettings, executor: Executor, idle: Path | None = None
    ) -> None:
        prepared = character.prepared
        self.character = character
        self.user: int | None = None
        self.state: State = "waiting"
        self.follows_take = False
        self._settings, self._executor = settings, executor
        self.motion = CharacterMotion(prepared, ease=settings.ease)
        self.motion.precompile()
        self._idle_log = idle
        self.motion.idle = self.make_idle()
        self.sequence = 0
        self.shown: Appearance | None = None
        self.next_calibration: PreparedCalibration | None = None
        self._current: PreparedCalibration | None = None
        self._watched = JointFilter(prepared.puppet.smoothing.parameters)  # before the calibration
        self._automatic = AutomaticCalibration(settings.calibrate)
        self._sensor = SensorTilt(settings.tilt or 0.0, settings.height or 0.0)
        self._floor: SensorTilt | None = None  # measured from the floor in the image
        self._remembered: dict[int, tuple[Calibration, float]] = {}

    @property
    def calibration(self) -> Calibration | None:
        """The calibration in use; None without a performer."""
        return None if self._current is None else self._current.calibration

    @property
    def sensor(self) -> SensorTilt:
        """Position of the sensor; values that are not known are zero."""
        return self._sensor

    def enter(self, user: int, time: float) -> None:
        """Assign a performer to the character."""
        self.user, self.state = user, "calibrating"
        self._watched.reset()
        calibration, left = self._remembered.pop(user, (None, 0.0))
        if calibration is not None and time - left > self._settings.remember:
            calibration = None
        if calibration is not None and self._floor is not None:
            stands = self._with_settings(self._floor)
            calibration = calibration if calibration.sensor.near(stands, *MIN_TILT_CHANGE) else None  # it was moved
        self._automatic.enter(returning=calibration is not None)
        if calibration is not None:
            self._prepare(calibration, time)

    def leave(self, time: float) -> None:
        """Remove the performer; the character eases into its idle motion."""
        self.remember(self.remembered())
        self.state = "waiting"
        if self._current is not None or self.motion.held is not None:
            self.state = "leaving"
            self.motion.follow(time, None)
        self.user = self._current = None
        self._drop_next()

    def begin_again(self, time: float) -> None:
        """Ease to where the performer is next, because a recording begins again."""
        self._automatic.forget()
        self._watched.reset()
        if self._current is None:
            self.motion.ease(time)
        else:
            self.motion.follow(time, self._current.retargeting())

    def set_sensor(self, sensor: SensorTilt, time: float) -> None:
        """Set the position of the sensor, which was measured from the floor in the image.

        It applies immediately without a calibration, otherwise with the next one. If the first measurement differs from
        the position in the present calibration, that calibration is prepared again.
        """
        first, self._floor, sensor = self._floor is None, sensor, self._with_settings(sensor)
        calibrated = self.next_calibration or self._current
        if first and calibrated is not None and not sensor.near(calibrated.calibration.sensor, *MIN_TILT_CHANGE):
            rest = calibrated.calibration.rest
            self._prepare(Calibration(rest, sensor.above_floor(rest)), time)
        if self._current is None:
            self._sensor = sensor
            self._watched.reset()

    def calibrate(self, time: float) -> bool:
        """Calibrate with the performer's present pose; return False if too little of it is known."""
        pose = None if self.user is None else self._automatic.present_pose()
        if pose is None:
            return False
        self._calibrate(pose, time)
        return True

    def set_mirror(self, mirror: bool, time: float) -> None:
        """Turn mirroring on or off."""
        self.motion.mirror = mirror
        self._prepare_again(time)

    def remap(self, puppet: Puppet, time: float) -> None:
        """Apply the mapping of another puppet with the same handles, as soon as it is computed.

        The idle motion is not computed here: see `make_idle` and `take_idle`.
        """
        self.character = self.character.remapped(puppet)
        self.motion.remap(self.character.prepared)
        self._prepare_again(time)

    def make_idle(self) -> Motion[TargetPose] | None:
        """Compute the idle motion with the present mapping, which may take a second."""
        prepared, idle = self.character.prepared, self.motion.idle
        if self._idle_log is None or (idle is not None and idle.prepared is prepared):
            return idle
        return idle_motion(self._idle_log, prepared, self.motion.deformer)

    def take_idle(self, idle: Motion[TargetPose] | None, time: float) -> None:
        """Ease into a new idle motion, unless the mapping has changed since it was computed."""
        present = self.motion.idle
        if (
            idle is None
            or idle.prepared is not self.character.prepared
            or (present is not None and present.prepared is idle.prepared)
        ):
            return  # several edits in a row are computed and eased once
        self.motion.idle = idle
        if self._current is None:
            self.motion.ease(time)

    @property
    def settled(self) -> bool:
        """Whether the mapping is applied: for a moment after an edit, the character still moves as before."""
        prepared = self.character.prepared
        return all(each is None or each.prepared is prepared for each in (self._current, self.motion.idle))

    def begin(self, time: float, recorded: Mapping[str, Any] | None = None) -> None:
        """Use the calibration that was requested last, after waiting for it if necessary.

        Parameters
        ----------
        time : float
        recorded : mapping, optional
            `PreparedCalibration.to_json` of the calibration in a take, used instead of the one that was requested.

        Raises
        ------
        ServiceError
            It could not be computed; nothing changes.
        """
        if recorded is not None and self.user is not None:
            self._take_recorded(recorded, time)
        calibrated, self.next_calibration = self.next_calibration, None
        if calibrated is None:
            return
        try:
            retargeting = calibrated.retargeting()
        except Exception as error:  # an impossible pose; the next second without motion gives another one
            raise ServiceError(
                self.character.name,
                found=f"a performer who cannot be calibrated ({type(error).__name__}: {error})",
                expected="the pose of a body",
                fix="Stand still again, completely in view.",
            ) from error
        self._current, self._sensor = calibrated, calibrated.calibration.sensor
        self.state = "performing"
        self.motion.follow(time, retargeting)

    def _take_recorded(self, recorded: Mapping[str, Any], time: float) -> None:
        """Prepare the calibration of a take, unless it is the one that is already prepared."""
        if self.next_calibration is not None and self.next_calibration.to_json() == recorded:
            return
        try:
            calibrated = self._recorded_calibration(recorded, time)
        except (KeyError, TypeError, ValueError) as error:
            raise ServiceError(
                self.character.name,
                found=f"a damaged calibration in a take ({type(error).__name__}: {error})",
                expected="a take as it was recorded",
                fix="Remove this cue from the take.",
            ) from error
        self._drop_next()
        self.next_calibration = calibrated

    def perform(self, frame: SkeletonFrame, received: int) -> Frame:
        """Return the character's frame for a frame of the performer.

        Parameters
        ----------
        frame : SkeletonFrame
            Later than the one before; sensor coordinates.
        received : int
            `puppetline.clock.now_ns` at which it arrived.
        """
        self._automatic.add(frame)
        if self.next_calibration is None:
            rest = None if self._current is None else self._current.calibration.rest
            standing = self._automatic.due(rest, self._directs)
            if standing is not None:
                self._calibrate(standing, frame.time)
        levelled, performer = self._sensor.levelled(frame), self.motion.performer
        pose = self.motion.step(levelled, ease_cuts=True)
        if performer is None:
            joints = self._watched.step(frame.time, levelled.positions, frame.confidence)
        else:
            joints = performer.joints
        return self._frame(frame.time, received, pose, self.user, replace(levelled, positions=joints))

    def pass_time(self, time: float, received: int) -> Frame | None:
        """Return a frame without a performer; None while there is one, or if it is too early for another frame."""
        if self.user is not None or self.follows_take or time - self.motion.easing.shown_at < 0.75 * TICK_SECONDS:
            return None
        if self.state == "leaving" and self.motion.easing.finished(time):
            self.state = "waiting"
        return self._frame(time, received, self.motion.wait(time))

    def follow_take(self, time: float) -> None:
        """Ease into a take, or into another moment of it; until `release`, only `show_take` returns frames."""
        self.follows_take = True
        self.motion.ease(time)

    def show_take(self, time: float, received: int, wanted: Appearance, solved: tuple[Deformer, Pose]) -> Frame:
        """Return the frame of a take's appearance, see `CharacterMotion.show`."""
        self.state, time = wanted.state, max(time, self.motion.easing.shown_at)
        pose = self.motion.show(time, wanted.target, wanted.channels, solved)
        return self._frame(time, received, pose, wanted.user, wanted.seen)

    def release(self, time: float) -> None:
        """Ease from a take into the idle motion."""
        self.follows_take, self.state, self.motion.idle_since = False, "leaving", time
        self.motion.ease(time)

    def another(self) -> "CharacterPlayer":
        """Return a player of the same character, idle motion and settings, without a performer.

        It calibrates at once.
        """
        other = CharacterPlayer(self.character, replace(self._settings, calibrate="at_once"), self._executor)
        other.motion.idle = self.motion.idle
        return other

    @property
    def _directs(self) -> bool:
        """Whether limbs follow directions, which need no rest pose."""
        return any(limb.follow == "direction" for limb in self.character.prepared.puppet.limb)

    def _calibrate(self, rest: NDArray[np.float64], time: float) -> None:
        found = self._floor.above_floor(rest) if self._floor else estimate_tilt(rest) or self._sensor
        self._prepare(Calibration(rest, self._with_settings(found)), time)

    def _with_settings(self, found: SensorTilt) -> SensorTilt:
        """Return the position of the sensor; the settings override what was detected."""
        tilt, height = self._settings.tilt, self._settings.height
        return SensorTilt(found.tilt if tilt is None else tilt, found.height if height is None else height, found.roll)

    def _prepare(self, calibration: Calibration, time: float) -> None:
        """Start to compute a retargeting, in place of one that is not in use yet; the stream continues meanwhile."""
        self._drop_next()
        self.next_calibration = self._preparing(calibration, self.motion.mirror, time)

    def _prepare_again(self, time: float) -> None:
        """Apply a changed setting to the calibration, if there is one."""
        calibrated = self.next_calibration or self._current
        if calibrated is not None:
            self._prepare(calibrated.calibration, time)

    def _drop_next(self) -> None:
        if self.next_calibration is not None:
            self.next_calibration.working.cancel()
        self.next_calibration = None

    def _preparing(self, calibration: Calibration, mirror: bool, asked: float) -> PreparedCalibration:
        rest = calibration.sensor.upright(calibration.rest)
        working = self._executor.submit(self.motion.retargeting, rest, mirror)
        return PreparedCalibration(calibration, mirror, asked, self.character.prepared, working)

    def _frame(
        self, time: float, received: int, pose: Pose, user: int | None = None, seen: SkeletonFrame | None = None
    ) -> Frame:
        """Return the frame of a pose."""
        self.sequence += 1
        self.shown = Appearance(self.motion.easing.shown, pose.channels, self.state, user, seen)
        place = self.character, self.sequence, time, received
        return Frame(*place, self.state, user, pose, seen)

    def remembered(self) -> dict[int, tuple[Calibration, float]]:
        """Return the calibrations of present and former performers, and when each was last shown."""
        calibrated = self._current or self.next_calibration
        if self.user is None or calibrated is None:
            return self._remembered
        return self._remembered | {self.user: (calibrated.calibration, self.motion.easing.shown_at)}

    def remember(self, known: dict[int, tuple[Calibration, float]]) -> None:
        """Keep calibrations, up to the last `MAX_REMEMBERED`."""
        self._remembered = dict(list(known.items())[-MAX_REMEMBERED:])

    def succeed(self, other: "CharacterPlayer") -> None:
        """Take over the performer, the calibrations and the shown pose from the player that this one replaces."""
        if self.character.prepared.puppet.retarget.mirror == other.character.prepared.puppet.retarget.mirror:
            self.motion.mirror = other.motion.mirror
        self.remember(other.remembered())
        self._sensor, self._floor = other._sensor, other._floor
        self.sequence = other.sequence
        self.motion.succeed(other.motion)
        self.state = "leaving" if other.user is None else "waiting"
        if other.user is not None:
            playing = other._current is not None
            self.enter(other.user, self.motion.easing.shown_at)
            self.motion.held = self.motion.easing.shown if playing and self.next_calibration is not None else None

    def snapshot(self) -> dict[str, Any]:
        """Return the performer and the calibrations as values of JSON's types, for `resume`.

        Filters are not included.
        """
        return {
            "user": self.user,
            "state": self.state,
            "mirror": self.motion.mirror,
            "manner": asdict(self._settings),
            "sensor": asdict(self._sensor),
            "floor": None if self._floor is None else asdict(self._floor),
            "calibration": None if self._current is None else self._current.to_json(),
            "standing": [] if self.motion.performer is None else rows_of(self.motion.performer.standing),
            "next_calibration": None if self.next_calibration is None else self.next_calibration.to_json(),
            "remembered": [
                {"user": user, "left": left, **known.to_json()} for user, (known, left) in self._remembered.items()
            ],
            "shown_at": _finite(self.motion.easing.shown_at),
            "idle_since": _finite(self.motion.idle_since),
            "eased_since": _finite(self.motion.easing.since),
        }

    def resume(self, snapshot: Mapping[str, Any], time: float, shift: float) -> None:
        """Continue from a value of `snapshot`; filters start again.

        Parameters
        ----------
        snapshot : mapping
        time : float
        shift : float
            Seconds to add to the times of the snapshot.

        Raises
        ------
        KeyError, TypeError, ValueError
            The value is not a snapshot.
        """
        state: State = "waiting" if snapshot["user"] is None else "calibrating"
        calibrated = (
            None if snapshot["calibration"] is None else self._recorded_calibration(snapshot["calibration"], time)
        )
        performer = None if calibrated is None else calibrated.retargeting()
        if performer is not None:
            performer.stand(places_of(snapshot["standing"]))
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
        self._settings = PlayerSettings(**snapshot["manner"])
        motion = self.motion
        motion.easing.seconds, self._automatic.calibrate = self._settings.ease, self._settings.calibrate
        self._sensor = SensorTilt.of_json(snapshot["sensor"])
        self._floor = None if snapshot["floor"] is None else SensorTilt.of_json(snapshot["floor"])
        motion.mirror, self.user, self.state = bool(snapshot["mirror"]), snapshot["user"], state
        self._drop_next()
        self._current = calibrated
        self.next_calibration = None if following is None else self._recorded_calibration(following, time)
        self._watched.reset()
        self._automatic.forget()
        self.remember(remembered)
        motion.follow(time, performer)
        if not self.sequence:  # nothing is shown yet that it could ease from
            motion.easing.since = eased_since
        motion.easing.shown_at, motion.idle_since = shown_at, idle_since

    def _recorded_calibration(self, recorded: Mapping[str, Any], asked: float) -> PreparedCalibration:
        return self._preparing(Calibration.of_json(recorded), bool(recorded["mirror"]), asked)


def _finite(time: float) -> float | None:
    """Return a time; None for infinity, which JSON cannot represent."""
    return time if math.isfinite(time) else None
