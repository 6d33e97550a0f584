"""Retargeting and deformation of a character by one performer, frame by frame."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.performance.channels import ChannelMotion, sided
from engine_bridge.performance.easing import EASE_SECONDS, Easing, TargetPose
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.puppet.puppet import Puppet
from solver.model.reduced_model import ReducedModel
from solver.motion.deformer import Deformer
from solver.surface.mesh import SolverMesh


class Pose(NamedTuple):
    """Pose of a character in a frame, or in each of f frames: all arrays then have a first axis f, and are float32.

    Attributes
    ----------
    R : (4m, 3) float64
        Control variables, model units.
    root : (3,) float64
        Translation of the whole character, mesh file's coordinates; zero if the puppet has no root.
    motions : (b, 4, 3) float64
        Motions of the bones for row vectors, mesh file's coordinates, without the root's motion.
    """

    R: NDArray[Any]
    root: NDArray[Any]
    motions: NDArray[Any]


class Performance:
    """A puppet that one performer drives.

    Parameters
    ----------
    puppet : Puppet
    mesh : SolverMesh
        Mesh of the puppet's character.
    model : ReducedModel
        Reduced model of that mesh.
    rest : (20, 3) float64
        Performer's calibration pose, sensor coordinates, NaN for unknown joints.
    """

    def __init__(self, puppet: Puppet, mesh: SolverMesh, model: ReducedModel, rest: NDArray[np.float64]) -> None:
        self._puppet, self._mesh = puppet, mesh
        self.deformer = make_deformer(puppet, mesh, model)
        self.retargeting = Retargeting(puppet, mesh, self.deformer, rest)
        bones = self.deformer.bones
        at_rest = TargetPose(self.deformer.handles, np.tile(np.eye(4, 3), (len(bones), 1, 1)), np.zeros(3))
        self._easing = Easing(bones, at_rest, EASE_SECONDS)
        self._channels = ChannelMotion(puppet, bones)

    def calibrate(self, time: float, rest: NDArray[np.float64], mirror: bool | None) -> None:
        """Ease into the motion with another calibration pose or mirroring, from a time on; None keeps the mirroring."""
        self._puppet = mirrored(self._puppet, mirror)
        self.retargeting = Retargeting(self._puppet, self._mesh, self.deformer, rest)
        self._easing.begin(time)

    def aim(self, frame: SkeletonFrame) -> TargetPose:
        """Return the targets and motions of the next frame, moved by its channels."""
        shown = self._easing.show(frame.time, self.retargeting.step(frame))
        return self._channels.moved(shown, sided(frame.channels, self._puppet.retarget.mirror))

    def step(self, frame: SkeletonFrame, out: NDArray[np.float64] | None = None) -> Pose:
        """Return the pose of the next frame.

        Parameters
        ----------
        frame : SkeletonFrame
            A later frame than the previous one.
        out : (4m, 3) float64, optional
            Array for the pose's R.
        """
        aim = self.aim(frame)
        return Pose(self.deformer.solve(aim.targets, aim.motions, out), aim.root, aim.motions)


def mirrored(puppet: Puppet, on: bool | None) -> Puppet:
    """Return a puppet that mirrors the performer or does not; None keeps its setting."""
    if on is None or on == puppet.retarget.mirror:
        return puppet
    return puppet.model_copy(update={"retarget": puppet.retarget.model_copy(update={"mirror": on})})


def make_deformer(puppet: Puppet, mesh: SolverMesh, model: ReducedModel) -> Deformer:
    """Return a deformer for a character's model and a puppet's handles."""
    return Deformer(
        model, mesh, puppet.handle_positions, iterations=puppet.solver.iterations, mode=puppet.solver.rotations
    )
