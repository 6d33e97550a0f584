"""What is shown of a character: poses that ease from one motion into the next, its idle motion, and its frames."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINTS, LOST, SkeletonFrame
from engine_bridge.performance.easing import MAX_STEP_SECONDS, Easing, TargetPose
from engine_bridge.performance.idle import IdleRecording
from engine_bridge.performance.performance import make_deformer
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.performance.rig import Rig
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.states import State
from solver.motion.deformer import Deformer
from solver.motion.motion_blend import difference, moved_by


class Appearance(NamedTuple):
    """What a frame shows: a pose before channels move it, one of `states.STATES`, and the performer."""

    pose: TargetPose
    state: State
    user: int | None = None
    seen: SkeletonFrame | None = None

    @property
    def channels(self) -> Mapping[str, float] | None:
        """The performer's channels; None without a performer."""
        return None if self.seen is None else self.seen.channels


class PoseDisplay:
    """Shows the poses of one character.

    Parameters
    ----------
    rig : Rig
    seconds : float
        Duration of easing.
    idle : Path, optional
        Idle recording; the rest pose by default.

    Attributes
    ----------
    deformer : Deformer
        Its state is that of the last frame.
    easing : Easing
    rest : TargetPose
    idle_since : float
        Time at which the idle motion began.
    sequence : int
        Number of frames so far.
    shown : Appearance or None
        That of the last frame.

    Raises
    ------
    PuppetlineError
        The recording cannot be read, or the character cannot be solved.
    """

    def __init__(self, rig: Rig, seconds: float, idle: Path | None) -> None:
        self.deformer = make_deformer(rig.puppet, rig.mesh, rig.model)
        self._idle_log = idle
        self.idle: IdleRecording | None = None
        self.idle = self.make_idle(rig)
        self.idle_since = -math.inf
        self.sequence = 0
        self.shown: Appearance | None = None
        bones = self.deformer.bones
        self.rest = TargetPose(self.deformer.handles, np.tile(np.eye(4, 3), (len(bones), 1, 1)), np.zeros(3))
        self.easing = Easing(bones, self.rest, seconds)
        self._followed: Deformer | None = None  # has computed the last frame, instead of `deformer`
        self._precompile(rig)

    def _precompile(self, rig: Rig) -> None:
        """Compile what a frame runs, which takes 15 seconds the first time, by a frame in which nothing is known."""
        unknown, lost = np.full((len(JOINTS), 3), np.nan), np.full(len(JOINTS), LOST, np.float32)
        Retargeting(rig.puppet, rig.mesh, self.deformer, unknown).step(SkeletonFrame(0.0, 0, unknown, lost))
        easing = Easing(self.deformer.bones, self.rest, 1.0)
        easing.begin(0.0)
        easing.show(MAX_STEP_SECONDS, self.rest)
        self.deformer.solve(self.deformer.handles)
        self.deformer.reset()

    def ease(self, time: float) -> None:
        """Ease from the pose that is shown into the one that is shown from now on."""
        if self._followed is not None:
            self.deformer.resume(self._followed.state)
            self._followed = None
        self.easing.begin(time)

    def make_idle(self, rig: Rig) -> IdleRecording | None:
        """Compute the idle motion with a mapping, which may take a second."""
        if self._idle_log is None or (self.idle is not None and self.idle.puppet is rig.puppet):
            return self.idle
        return IdleRecording(self._idle_log, rig, self.deformer)

    def idle_pose(self, time: float) -> TargetPose:
        """Return the pose without a performer."""
        if self.idle is None:
            return self.rest
        if math.isinf(self.idle_since):
            self.idle_since = time
        return self.idle.at(time - self.idle_since)

    def show(
        self,
        character: StreamedCharacter,
        time: float,
        received: int,
        wanted: Appearance,
        solved: tuple[Deformer, NDArray[np.float64]] | None = None,
    ) -> Frame:
        """Return the frame of an appearance, or of one on the way to it.

        Parameters
        ----------
        character : StreamedCharacter
        time : float
            The stage's clock.
        received : int
            `puppetline.clock.now_ns` at which the data arrived.
        wanted : Appearance
        solved : (Deformer, (4m, 3) float64), optional
            Another deformer of this character, and what it has computed for the pose; it is shown when the easing is
            over, so that the frame depends on that deformer's frames only.
        """
        pose = self.easing.show(time, wanted.pose)
        moved = character.channel_motion.moved(pose, wanted.channels)
        self._followed, R = (None, None) if solved is None or pose is not wanted.pose else solved
        self.sequence += 1
        self.shown = wanted._replace(pose=pose)
        return Frame(
            character=character,
            sequence=self.sequence,
            time=time,
            received=received,
            state=wanted.state,
            user=wanted.user,
            R=self.deformer.solve(moved.targets, moved.motions) if R is None else R,
            root=pose.root,
            targets=moved.targets + pose.root,
            motions=moved.motions,
            joints=None if wanted.seen is None else wanted.seen.positions,
            confidence=None if wanted.seen is None else wanted.seen.confidence,
            channels=wanted.channels,
        )

    def succeed(self, other: "PoseDisplay", ours: StreamedCharacter, theirs: StreamedCharacter) -> None:
        """Continue from what the display shows that a reload replaces."""
        self.sequence, self.idle_since = other.sequence, other.idle_since
        self.easing.shown, self.easing.shown_at = self._pose_of(other, ours, theirs), other.easing.shown_at
        self.ease(other.easing.shown_at)

    def _pose_of(self, other: "PoseDisplay", ours: StreamedCharacter, theirs: StreamedCharacter) -> TargetPose:
        """Return the pose that another display shows, for these handles and limbs.

        Handles are matched by name, and new ones are in their rest position. Limbs are matched only if all of them have
        the same names and numbers of points; otherwise, all are in their rest position.
        """
        names = [handle.name for handle in theirs.rig.puppet.handle]
        moved = dict(zip(names, other.easing.shown.targets - other.deformer.handles, strict=True))
        own = [handle.name for handle in ours.rig.puppet.handle]
        targets = self.rest.targets + np.reshape([moved.get(name, np.zeros(3)) for name in own], (-1, 3))
        motions = self.rest.motions
        if _shape_of_limbs(ours.rig) == _shape_of_limbs(theirs.rig):
            apart = difference(other.deformer.bones, other.rest.motions, other.easing.shown.motions)
            motions = moved_by(self.deformer.bones, motions, apart, 1.0)
        return TargetPose(targets, motions, other.easing.shown.root)


def _shape_of_limbs(rig: Rig) -> list[tuple[str, int]]:
    return [(limb.name, len(limb.points)) for limb in rig.puppet.limbs]
