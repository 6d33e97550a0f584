"""Checks that the handles and limbs of a puppet are on and inside its mesh."""

from collections.abc import Sequence
from pathlib import Path

import igl
import numpy as np
from numpy.typing import NDArray

from engine_bridge.puppet.puppet import HandleTable, LimbTable
from puppetline.errors import PuppetError, at
from solver.surface.mesh import SolverMesh, snap

MAX_DISTANCE_SHARE = 0.1
"""Maximum distance from the surface of a handle, and of a limb's point outside the character, as a share of the
diagonal."""

INSIDE_WINDING_NUMBER = 0.5
"""Absolute winding number from which a point counts as inside."""


def check_handles(handles: Sequence[HandleTable], mesh: SolverMesh, where: str | Path) -> None:
    """Refuse handles that are far from the surface.

    Raises
    ------
    PuppetError
    """
    for number, handle in enumerate(handles, 1):
        field = f"[[handle]] {number} {handle.name!r}, position"
        check_on_surface(np.array(handle.position), mesh, at(where, field=field))


def check_on_surface(point: NDArray[np.float64], mesh: SolverMesh, where: str) -> None:
    """Refuse a point (3,) that is far from the surface.

    Raises
    ------
    PuppetError
    """
    nearest = _if_far(point, mesh)
    if nearest is not None:
        raise _off_the_mesh(point, nearest, mesh, where, "on")


def check_limbs(limbs: Sequence[LimbTable], mesh: SolverMesh, where: str | Path) -> None:
    """Refuse limbs with points that are outside the character and far from its surface.

    Raises
    ------
    PuppetError
    """
    for number, limb in enumerate(limbs, 1):
        for place, position in enumerate(limb.points, 1):
            point = np.array(position)
            nearest = _if_far(point, mesh)
            if (
                nearest is not None
                and abs(igl.winding_number(mesh.vertices, mesh.faces, point[None])[0]) < INSIDE_WINDING_NUMBER
            ):
                field = f"[[limb]] {number} {limb.name!r}, points, {place}"
                raise _off_the_mesh(point, nearest, mesh, at(where, field=field), "inside")


def _if_far(point: NDArray[np.float64], mesh: SolverMesh) -> NDArray[np.float64] | None:
    """Return the surface point (3,) nearest to a point if it is too far away, else None."""
    allowed = MAX_DISTANCE_SHARE * mesh.diagonal
    away = mesh.vertices - point
    if np.einsum("vx,vx->v", away, away).min() <= allowed**2:
        return None  # the surface is at most as far away as its nearest vertex
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
