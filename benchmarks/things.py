"""Things that characters hold and wear, for `benchmarks.posed_bodies`: swords, shields, hats, bags, capes and skirts.

They have no joints. A network that has never seen a sword takes it for a limb.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from solver.anatomy.part_network import PARTS

CHANCES = {"staff": 0.2, "shield": 0.1, "hat": 0.15, "bag": 0.12, "cape": 0.08, "skirt": 0.08}
"""Chance of each thing; staff and shield need an arm, the others need arms and a head, as persons have them."""

Points = NDArray[np.float64]
Thing = tuple[int, Points, NDArray[np.int64]]
"""Number of the limb that carries it, vertices (n, 3) and triangles (t, 3)."""


def things(parts: Sequence[tuple[int, Points]], rng: np.random.Generator) -> Iterator[Thing]:
    """Yield random things of a character.

    Parameters
    ----------
    parts : sequence of (int, (4, 3) float64)
        Part and joints of each limb; left, up and front.
    rng : numpy.random.Generator
    """
    of = {PARTS[part]: number for number, (part, _) in enumerate(parts)}
    arms = [number for number, (part, _) in enumerate(parts) if PARTS[part] == "arm"]
    if not arms or not {"trunk", "head"} <= set(of):
        return
    trunk, head = (parts[of[name]][1] for name in ("trunk", "head"))
    size = float(np.ptp(np.concatenate([joints for _, joints in parts]), axis=0).max())
    for name, chance in CHANCES.items():
        if rng.random() > chance:
            continue
        if name in ("staff", "shield"):
            limb = arms[rng.integers(len(arms))]
            place, radii = _held(name, parts[limb][1], size, rng)
            yield limb, *_solid(place, Rotation.random(rng=rng).as_matrix(), radii, rng)
        elif name == "hat":
            radii = size * rng.uniform([0.05, 0.02, 0.05], [0.16, 0.12, 0.16])
            yield of["head"], *_solid(head[-1], np.eye(3), radii[[0, 1, 0]], rng)
        else:
            lowest = min(float(joints[:, 1].min()) for _, joints in parts)
            yield of["trunk"], *_solid(*_worn(name, trunk, size, lowest, rng), rng)


def _held(name: str, arm: Points, size: float, rng: np.random.Generator) -> tuple[Points, Points]:
    """Return the middle and the radii of a staff or shield in a hand."""
    if name == "shield":
        return arm[2] + rng.normal(0, 0.02 * size, 3), size * rng.uniform([0.01, 0.08, 0.08], [0.03, 0.2, 0.25])
    return arm[3] + rng.normal(0, 0.05 * size, 3), size * rng.uniform([0.01, 0.012, 0.1], [0.03, 0.05, 0.5])


def _worn(
    name: str, trunk: Points, size: float, lowest: float, rng: np.random.Generator
) -> tuple[Points, Points, Points]:
    """Return the middle, the axes and the radii of what hangs on the trunk."""
    hip, chest = trunk[0], trunk[-1]
    if name == "skirt":
        length = rng.uniform(0.15, 0.45) * max(float(hip[1]) - lowest, 0.05 * size)
        return hip - [0, 0.6 * length, 0], np.eye(3), np.array([rng.uniform(0.08, 0.2) * size, length, 0.12 * size])
    back = (hip + chest) / 2 - [0, 0, rng.uniform(0.08, 0.18) * size]
    if name == "bag":
        return back, np.eye(3), size * rng.uniform([0.06, 0.08, 0.04], [0.15, 0.2, 0.12])
    tilt = Rotation.from_euler("x", rng.uniform(0, 25), degrees=True).as_matrix().T
    length = rng.uniform(0.2, 0.4) * size
    return chest - [0, 0.9 * length, 0.12 * size], tilt, np.array([rng.uniform(0.1, 0.25) * size, length, 0.02 * size])


def _solid(middle: Points, axes: Points, radii: Points, rng: np.random.Generator) -> tuple[Points, NDArray[np.int64]]:
    """Return a box or an ellipsoid."""
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    if rng.random() < 0.5:
        corners = rng.normal(size=(80, 3))
        corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    hull = ConvexHull(corners)
    faces = hull.simplices.astype(np.int64)
    inwards = np.einsum("ni,ni->n", _normals(corners[faces]), hull.equations[:, :3]) < 0
    faces[inwards] = faces[inwards, ::-1]
    return middle + (corners * radii) @ axes, faces


def _normals(triangles: Points) -> Points:
    return np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
