"""The motion of a character, frame by frame: from a performer's skeleton to the pose of the character.

The service, conversions, films and measurements all use it, so a live frame is the offline frame.
"""

import math

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINTS, LOST, SkeletonFrame
from engine_bridge.performance.channels import ChannelMotion, Channels, sided
from engine_bridge.performance.easing import EASE_SECONDS, MAX_STEP_SECONDS, Easing
from engine_bridge.performance.motion import Motion
from engine_bridge.performance.pose import Pose, TargetPose, difference_of
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.puppet.puppet import Puppet
from solver.motion.deformer import Deformer
from solver.motion.motion_blend import moved_by


class CharacterMotion:
    """A character that follows a performer, or else its idle motion, and eases from one into the other.

    Parameters
    ----------
    prepared : PreparedCharacter
    rest : (20, 3) float64, optional
        The performer's calibration pose, sensor coordinates, NaN for unknown joints; by default there is no performer
        until `follow`.
    mirror : bool, optional
        Whether the performer's left moves the character's right; the puppet's setting by default.
    ease : float, optional
        Duration of easing, in seconds.

    Attributes
    ----------
    prepared : PreparedCharacter
    mirror : bool
        Whether the next `retargeting` mirrors.
    performer : Retargeting or None
        The performer that is followed.
    idle : Motion or None
        Followed without a performer, from `idle_since` on; the rest pose if there is none.
    idle_since : float
    held : TargetPose or None
        Followed instead of the idle motion until the next `follow`.
    easing : Easing
    deformer : Deformer
        Its state is that of the last frame.
    """

    def __init__(
        self,
        prepared: PreparedCharacter,
        rest: NDArray[np.float64] | None = None,
        *,
        mirror: bool | None = None,
        ease: float = EASE_SECONDS,
    ) -> None:
        self.prepared = prepared
        self.mirror = prepared.puppet.retarget.mirror if mirror is None else mirror
        self.deformer = make_deformer(prepared)
        bones = np.tile(np.eye(4, 3), (len(self.deformer.bones), 1, 1))
        self.at_rest = TargetPose(self.deformer.handles, bones, np.zeros(3))
        self.easing = Easing(self.deformer.bones, self.at_rest, ease)
        self._channels = ChannelMotion(prepared.puppet, self.deformer.bones)
        self.performer = None if rest is None else self.retargeting(rest)
        self.idle: Motion[TargetPose] | None = None
        self.idle_since = -math.inf
        self.held: TargetPose | None = None
        self._solved_by: Deformer | None = None  # has computed the last frame, instead of `deformer`

    def retargeting(self, rest: NDArray[np.float64], mirror: bool | None = None) -> Retargeting:
        """Compute how to follow a performer, which takes a tenth of a second and changes nothing, in any thread.

        Parameters
        ----------
        rest : (20, 3) float64
            The performer's calibration pose.
        mirror : bool, optional
            Whether to mirror the performer; `mirror` by default.
        """
        puppet = mirrored(self.prepared.puppet, self.mirror if mirror is None else mirror)
        return Retargeting(puppet, self.prepared.mesh, self.deformer, rest)

    def follow(self, time: float, performer: Retargeting | None) -> None:
        """Ease into the motion of a performer from a time on; None for the idle motion, from its start."""
        self.performer, self.held = performer, None
        if performer is None:
            self.idle_since = time
        self.ease(time)

    def ease(self, time: float) -> None:
        """Ease from the pose that is shown into the one that is followed from now on."""
        if self._solved_by is not None:
            self.deformer.resume(self._solved_by.state)
            self._solved_by = None
        self.easing.begin(time)

    def remap(self, prepared: PreparedCharacter) -> None:
        """Use the mapping of another puppet of the same character and handles, from the next `retargeting` on."""
        self.prepared = prepared
        self._channels = ChannelMotion(prepared.puppet, self.deformer.bones)

    def step(self, frame: SkeletonFrame, *, ease_cuts: bool = False) -> Pose:
        """Return the pose for the performer's next frame, which is later than the previous one.

        Parameters
        ----------
        frame : SkeletonFrame
        ease_cuts : bool
            Whether to ease from the pose before a cut (`capture.cuts`) into that after it.
        """
        if self.performer is None:
            return self.show(frame.time, self._without_performer(frame.time), sided(frame.channels, self.mirror))
        target = self.performer.step(frame)
        if ease_cuts and self.performer.has_cut:
            self.ease(frame.time)
        return self.show(frame.time, target, sided(frame.channels, self.performer.mirrors))

    def wait(self, time: float) -> Pose:
        """Return the pose at a time without a performer."""
        return self.show(time, self._without_performer(time))

    def show(
        self, time: float, target: TargetPose, channels: Channels = None, solved: tuple[Deformer, Pose] | None = None
    ) -> Pose:
        """Return the pose for any target, or one on the way to it.

        Parameters
        ----------
        time : float
        target : TargetPose
            Before channels move it.
        channels : mapping of str to float, optional
        solved : (Deformer, Pose), optional
            Another deformer of this character, and what it has computed for the target; it is shown when the easing is
            over, so that the frame depends on that deformer's frames only.
        """
        shown = self.easing.show(time, target)
        if solved is not None and shown is target:
            self._solved_by, pose = solved
            return pose
        self._solved_by = None
        return self.solve(shown, channels)

    def solve(self, target: TargetPose, channels: Channels = None) -> Pose:
        """Move a target by channels, and solve it; the deformer starts from the previous frame."""
        moved = self._channels.moved(target, channels)
        R = self.deformer.solve(moved.targets, moved.bones)
        return Pose(moved.targets, moved.bones, moved.root, R, self.prepared.model, channels)

    def _without_performer(self, time: float) -> TargetPose:
        if self.held is not None:
            return self.held
        if self.idle is None:
            return self.at_rest
        if math.isinf(self.idle_since):
            self.idle_since = time
        return self.idle.at(time - self.idle_since)

    def precompile(self) -> None:
        """Compile what a frame runs, which takes 15 seconds the first time, by a frame in which nothing is known."""
        unknown, lost = np.full((len(JOINTS), 3), np.nan), np.full(len(JOINTS), LOST, np.float32)
        self.retargeting(unknown).step(SkeletonFrame(0.0, 0, unknown, lost))
        easing = Easing(self.deformer.bones, self.at_rest, 1.0)
        easing.begin(0.0)
        easing.show(MAX_STEP_SECONDS, self.at_rest)
        self.deformer.solve(self.deformer.handles)
        self.deformer.reset()

    def succeed(self, other: "CharacterMotion") -> None:
        """Ease from what another motion shows, of this character before it was loaded again."""
        self.idle_since = other.idle_since
        self.easing.shown, self.easing.shown_at = self._pose_of(other), other.easing.shown_at
        self.ease(other.easing.shown_at)

    def _pose_of(self, other: "CharacterMotion") -> TargetPose:
        """Return the pose that another motion shows, for these handles and limbs.

        Handles are matched by name, and new ones are in their rest position. Limbs are matched only if all of them have
        the same names and numbers of points; otherwise, all are in their rest position.
        """
        shown, rest = other.easing.shown, self.at_rest
        names = [handle.name for handle in other.prepared.puppet.handle]
        moved = dict(zip(names, shown.targets - other.deformer.handles, strict=True))
        own = [handle.name for handle in self.prepared.puppet.handle]
        targets = rest.targets + np.reshape([moved.get(name, np.zeros(3)) for name in own], (-1, 3))
        bones = rest.bones
        if _shape_of_limbs(self.prepared) == _shape_of_limbs(other.prepared):
            bones = moved_by(self.deformer.bones, bones, difference_of(other.deformer.bones, other.at_rest, shown), 1.0)
        return TargetPose(targets, bones, shown.root)


def mirrored(puppet: Puppet, on: bool) -> Puppet:
    """Return a puppet that mirrors the performer or does not."""
    if on == puppet.retarget.mirror:
        return puppet
    return puppet.model_copy(update={"retarget": puppet.retarget.model_copy(update={"mirror": on})})


def make_deformer(prepared: PreparedCharacter) -> Deformer:
    """Return a deformer for a character's model and the handles of its puppet."""
    solver = prepared.puppet.solver
    return Deformer(
        prepared.model,
        prepared.mesh,
        prepared.puppet.handle_positions,
        iterations=solver.iterations,
        mode=solver.rotations,
    )


def _shape_of_limbs(prepared: PreparedCharacter) -> list[tuple[str, int]]:
    return [(limb.name, len(limb.points)) for limb in prepared.puppet.limbs]
