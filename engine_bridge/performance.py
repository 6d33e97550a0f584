"""A puppet on stage with one performer: the pipeline of recorded skeletons, frame by frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.puppet import HandleTable, Puppet
from engine_bridge.retargeting import Retargeting
from puppetline.errors import PuppetError, at
from solver.deformer import Deformer
from solver.limbs import bones_of
from solver.mesh import SolverMesh, snap
from solver.reduced_model import ReducedModel

OFF_THE_MESH = 0.1
"""A handle farther than this from the surface, as a fraction of the diagonal, is taken for a mistake."""


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
    """Bind a character's model to a puppet's handles and bones."""
    return Deformer(
        model,
        mesh,
        puppet.handle_positions,
        bones=bones_of(puppet.limbs),
        iterations=puppet.solver.iterations,
        mode=puppet.solver.rotations,
    )


def check_handles(handles: Sequence[HandleTable], mesh: SolverMesh, where: str | Path) -> None:
    """Refuse handles that are too far from the surface to have been meant.

    Raises
    ------
    PuppetError
    """
    allowed = OFF_THE_MESH * mesh.diagonal
    for number, handle in enumerate(handles, 1):
        away = mesh.vertices - handle.position
        if np.einsum("vx,vx->v", away, away).min() <= allowed**2:
            continue  # the surface is no farther away than its nearest vertex
        corners, blend = snap(mesh, np.array(handle.position))
        nearest = blend[0] @ mesh.vertices[corners[0]]
        distance = np.linalg.norm(nearest - handle.position)
        if distance > allowed:
            low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
            raise PuppetError(
                at(where, field=f"[[handle]] {number} {handle.name!r}, position"),
                found=f"{_numbers(np.array(handle.position))}, which is {distance:.4g} away from the surface",
                expected=f"a point on the mesh, which spans {_numbers(low)} to {_numbers(high)}",
                fix=f"The nearest surface point is {_numbers(nearest)}.",
            )


def _numbers(point: NDArray[np.float64]) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in point) + "]"
