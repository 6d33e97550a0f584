"""A puppet on stage with one performer: the pipeline of recorded skeletons, frame by frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.puppet.puppet import Puppet
from solver.model.reduced_model import ReducedModel
from solver.motion.deformer import Deformer
from solver.surface.mesh import SolverMesh


@dataclass(frozen=True)
class Pose:
    """One frame of a character.

    Attributes
    ----------
    R : (4m, 3) float64
        Control variables, model units.
    root : (3,) float64
        Translation of the whole character, mesh file's coordinates; zero where the puppet has no root.
    motions : (b, 4, 3) float64
        Motions of the bones for row vectors, mesh file's coordinates, without the root's motion.
    """

    R: NDArray[np.float64]
    root: NDArray[np.float64]
    motions: NDArray[np.float64]


class Performance:
    """A puppet moved by one performer from the first frame to the last.

    Parameters
    ----------
    puppet : Puppet
    mesh : SolverMesh
        Of the puppet's character.
    model : ReducedModel
        Of that mesh.
    rest : (20, 3) float64
        The performer's joints in the pose that stands for the character's rest pose; sensor frame, NaN where unknown.
    """

    def __init__(self, puppet: Puppet, mesh: SolverMesh, model: ReducedModel, rest: NDArray[np.float64]) -> None:
        self.deformer = make_deformer(puppet, mesh, model)
        self.retargeting = Retargeting(puppet, mesh, self.deformer, rest)

    def step(self, frame: SkeletonFrame, out: NDArray[np.float64] | None = None) -> Pose:
        """Take the next frame.

        Parameters
        ----------
        frame : SkeletonFrame
            Later than the one before.
        out : (4m, 3) float64, optional
            Where the pose's R is written.
        """
        aim = self.retargeting.step(frame)
        return Pose(self.deformer.solve(aim.targets, aim.motions, out), aim.root, aim.motions)


def make_deformer(puppet: Puppet, mesh: SolverMesh, model: ReducedModel) -> Deformer:
    """Bind a character's model to a puppet's handles."""
    return Deformer(
        model,
        mesh,
        puppet.handle_positions,
        iterations=puppet.solver.iterations,
        mode=puppet.solver.rotations,
    )
