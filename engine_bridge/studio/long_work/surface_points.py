"""Points on and in a character: the nearest surface point, the middle of a limb, and the other side."""

import re
from typing import Any

import igl
import numpy as np
from numpy.typing import NDArray

from engine_bridge.puppet.puppet import Puppet
from engine_bridge.studio.long_work.puppet_values import values_of
from puppetline.errors import ServiceError
from solver.surface.mesh import SolverMesh, snap

SKIN_SHARE = 1e-4
"""Minimum distance of the opposite surface, as a share of the diagonal; nearer hits are the point's own surface."""

DECIMALS = 6
"""Number of significant digits of a mirrored coordinate."""

OTHER = {"left": "right", "right": "left"}
"""Words that are swapped in names."""


def snapped(mesh: SolverMesh, point: tuple[float, float, float]) -> dict[str, Any]:
    """Return the surface point nearest to a point, and the middle of the character below it.

    The middle is half-way between the surface point and the opposite surface, along the normal.

    Returns
    -------
    dict
        Result of `engine_bridge.studio.messages.characters.Snap`.
    """
    corners, blend = snap(mesh, np.array(point))
    triangle = mesh.vertices[corners[0]]
    surface = blend[0] @ triangle
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    length = np.linalg.norm(normal)
    depth = 0.0 if length == 0 else _depth(mesh, surface, -normal / length)
    centre = surface if depth == 0 else surface - normal / length * depth / 2
    return {"surface": surface.tolist(), "centre": centre.tolist(), "radius": depth / 2}


def mirrored(puppet: Puppet, mesh: SolverMesh, name: str) -> dict[str, Any]:
    """Return the values of a puppet in which the other side's limb or handle is the mirror image of one.

    Raises
    ------
    ServiceError
        There is no limb or handle of that name, or its name has no side.
    """
    values = values_of(puppet)
    kind = next((kind for kind in ("limb", "handle") if name in [each["name"] for each in values[kind]]), None)
    if kind is None:
        raise ServiceError(
            "the request, name",
            found=f"no limb or handle {name!r}",
            expected="the name of a limb or handle",
            fix="Choose one of the character's.",
        )
    if _swapped(name) == name:
        raise ServiceError(
            "the request, name",
            found=f"{name!r}, which names no side",
            expected="a name with left or right",
            fix="Rename it first, for example to 'left arm'.",
        )
    tables = values[kind]
    original = next(each for each in tables if each["name"] == name)
    other = _other_side(original, puppet.character.basis[0], mesh)
    known = {each["name"] for each in values["limb"]}
    if other.get("parent") is not None and other["parent"] not in known:
        other["parent"] = original["parent"]
    places = [index for index, each in enumerate(tables) if each["name"] == other["name"]]
    if places:
        tables[places[0]] = other
    else:
        tables.insert(tables.index(original) + 1, other)
    return values


def _other_side(table: dict[str, Any], left: NDArray[np.float64], mesh: SolverMesh) -> dict[str, Any]:
    """Return a limb or handle mirrored at the plane normal to `left` through the median vertex."""
    middle = float(np.median(mesh.vertices @ left))

    def reflect(point: list[float]) -> list[float]:
        moved = np.array(point) - 2 * (np.array(point) @ left - middle) * left
        return [float(f"{value:.{DECIMALS}g}") for value in moved]

    other = {**table, "name": _swapped(table["name"])}
    for key in ("joint", "joints", "parent"):
        if table.get(key) is not None:
            other[key] = _swapped_in(table[key])
    if "points" in table:
        other["nodes"] = None  # these joints are on this side
        other["points"] = [reflect(point) for point in table["points"]]
    else:
        other["position"] = reflect(table["position"])
    return other


def _depth(mesh: SolverMesh, start: NDArray[np.float64], direction: NDArray[np.float64]) -> float:
    """Return the distance to the next surface along a direction; 0 if there is none."""
    hits = igl.ray_mesh_intersect(start, np.ascontiguousarray(direction), mesh.vertices, mesh.faces)
    return next((distance for _, distance, *_ in hits if distance > SKIN_SHARE * mesh.diagonal), 0.0)


def _swapped_in(value: Any) -> Any:
    """Return names, or lists of names, with the sides swapped."""
    return _swapped(value) if isinstance(value, str) else [_swapped_in(each) for each in value]


def _swapped(name: str) -> str:
    return re.sub(
        r"(?<![a-z])(left|right)(?![a-z])",
        lambda side: OTHER[side[0].lower()].capitalize() if side[0][0].isupper() else OTHER[side[0]],
        name,
        flags=re.IGNORECASE,
    )
