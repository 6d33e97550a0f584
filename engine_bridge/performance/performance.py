"""A puppet on stage with one performer: the pipeline of recorded skeletons, frame by frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import igl
import numpy as np
from numpy.typing import NDArray

from capture.skeleton import SkeletonFrame
from engine_bridge.performance.retargeting import Retargeting
from engine_bridge.puppet.puppet import HandleTable, LimbTable, Puppet
from puppetline.errors import PuppetError, at
from solver.model.reduced_model import ReducedModel
from solver.motion.deformer import Deformer
from solver.motion.limbs import bones_of
from solver.surface.mesh import SolverMesh, snap

OFF_THE_MESH = 0.1
"""Distance from the surface, as a share of the diagonal, beyond which a handle is a mistake, and a limb's point that is
outside the character."""

INSIDE = 0.5
"""Absolute value of the winding number from which a point is inside."""


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
    for number, handle in enumerate(handles, 1):
        point = np.array(handle.position)
        nearest = _if_far(point, mesh)
        if nearest is not None:
            field = f"[[handle]] {number} {handle.name!r}, position"
            raise _off_the_mesh(point, nearest, mesh, at(where, field=field), "on")


def check_limbs(limbs: Sequence[LimbTable], mesh: SolverMesh, where: str | Path) -> None:
    """Refuse limbs with points that are outside the character and too far from it to have been meant.

    Raises
    ------
    PuppetError
    """
    for number, limb in enumerate(limbs, 1):
        for place, position in enumerate(limb.points, 1):
            point = np.array(position)
            nearest = _if_far(point, mesh)
            if nearest is not None and abs(igl.winding_number(mesh.vertices, mesh.faces, point[None])[0]) < INSIDE:
                field = f"[[limb]] {number} {limb.name!r}, points, {place}"
                raise _off_the_mesh(point, nearest, mesh, at(where, field=field), "inside")


def _if_far(point: NDArray[np.float64], mesh: SolverMesh) -> NDArray[np.float64] | None:
    """Return the nearest surface point (3,) if that is too far from a point; else None."""
    allowed = OFF_THE_MESH * mesh.diagonal
    away = mesh.vertices - point
    if np.einsum("vx,vx->v", away, away).min() <= allowed**2:
        return None  # the surface is no farther away than its nearest vertex
    corners, blend = snap(mesh, point)
    nearest: NDArray[np.float64] = blend[0] @ mesh.vertices[corners[0]]
    return nearest if np.linalg.norm(nearest - point) > allowed else None


def _off_the_mesh(
    point: NDArray[np.float64], nearest: NDArray[np.float64], mesh: SolverMesh, where: str, place: str
) -> PuppetError:
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return PuppetError(
        where,
        found=f"{_numbers(point)}, which is {np.linalg.norm(nearest - point):.4g} away from the surface",
        expected=f"a point {place} the mesh, which spans {_numbers(low)} to {_numbers(high)}",
        fix=f"The nearest surface point is {_numbers(nearest)}.",
    )


def _numbers(point: NDArray[np.float64]) -> str:
    return "[" + ", ".join(f"{value:.4g}" for value in point) + "]"
