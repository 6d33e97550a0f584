"""Surfaces of simple shapes, vertices (n, 3) and triangles (t, 3), and bones."""

from itertools import pairwise, permutations, product

import igl
import numpy as np

from solver.model.bones import Bones
from solver.surface.mesh import weld


def points(text):
    """The points (n, 3) of a text, as "0 1 0, 0 1.2 0"; an array of points stays as it is."""
    return np.array([point.split() for point in text.split(",")], float) if isinstance(text, str) else np.array(text)


def distance_to_capsule(points, start, end, radius):
    way, along = points.T - np.array(start)[:, None], np.array(end) - np.array(start)
    x, y, z = way - np.clip(along @ way / (along @ along), 0, 1) * along[:, None]
    return np.sqrt(x * x + y * y + z * z) - radius


def capsules(table):
    """From, to and radius of each line of a table; a line with * is on the left side, and mirrored on the right one."""
    found = []
    for line in table.strip().splitlines():
        *ends, radius = map(float, line.strip(" *").split())
        sides = ([1, 1, 1], [-1, 1, 1]) if "*" in line else ([1, 1, 1],)
        found += [(*(np.array(ends).reshape(2, 3) * side), radius) for side in sides]
    return found


def march(capsules, low, high, step):
    """The union of capsules (from, to, radius)."""
    counts = np.ceil(np.subtract(high, low) / step).astype(int) + 1
    grid = igl.grid(counts) * ((counts - 1) * step) + low
    distance = np.min([distance_to_capsule(grid, *each) for each in capsules], axis=0)
    v, f, _ = igl.marching_cubes(distance, grid, *map(int, counts), 0.0)
    return v, f


def body_of(limbs, step=0.035):
    """The mesh of a character that is a union of capsules."""
    ends = np.array([end for limb in limbs for end in limb[:2]])
    reach = max(limb[2] for limb in limbs) + 2 * step + 0.0013  # no vertex of the grid on a limb's axis
    return weld(*march(limbs, ends.min(axis=0) - reach, ends.max(axis=0) + reach, step))


def box(corners, step=np.inf):
    """A closed box between two corners, whose sides are split into squares of about `step`."""
    low, high = points(corners)
    counts = np.maximum(np.ceil((high - low) / step), 1).astype(int) + 1
    sides = []
    for axis in range(3):
        others = [(axis + 1) % 3, (axis + 2) % 3]
        flat, faces = igl.triangulated_grid(*map(int, counts[others]))
        for end in (0, 1):
            side = np.full((len(flat), 3), end, dtype=float)
            side[:, others] = flat
            sides.append((low + side * (high - low), faces[:, :: 1 if end else -1]))
    vertices, _, _, faces = igl.remove_duplicate_vertices(*joined(*sides), 0.0)
    return vertices, faces


def sphere(rounds=2, radius=1.0, center=(0, 0, 0)):
    """An icosahedron that is subdivided some times."""
    vertices, faces = igl.icosahedron()
    for _ in range(rounds):
        vertices, faces = igl.upsample(vertices, faces)
    unit = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    return np.array(center) + radius * unit, faces.astype(np.int64)


def tube(x, radius, sides, *, closed=False):
    """Rings of a radius about the x axis."""
    angles, radii = np.tile(np.arange(sides) * 2 * np.pi / sides, len(x)), np.repeat(radius * np.ones(len(x)), sides)
    vertices = np.column_stack([np.repeat(x, sides), radii * np.cos(angles), radii * np.sin(angles)])
    k = np.arange(len(vertices) - sides)
    beside, j = k // sides * sides + (k + 1) % sides, np.arange(1, sides - 1)
    faces = [np.column_stack([k, beside, k + sides]), np.column_stack([beside, beside + sides, k + sides])]
    if closed:
        fan = np.column_stack([0 * j, j, j + 1])
        faces += [fan[:, ::-1], fan + len(k)]
    return vertices, np.concatenate(faces)


def joined(*parts):
    """Surfaces side by side."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def needles(vertices, faces, some, height):
    """Split some of the triangles just off the middle of an edge: three for one, of which one is a needle."""
    a, b, c = faces[some].T
    new, middle = len(vertices) + np.arange(len(a)), (vertices[a] + vertices[b]) / 2
    split = [np.column_stack(corners) for corners in ((a, b, new), (b, c, new), (c, a, new))]
    return np.concatenate([vertices, middle + height * (vertices[c] - middle)]), np.concatenate([faces[~some], *split])


def chains(*limbs):
    """Bones of limbs (parent, points), with the number of the parent bone; the first limb is the trunk."""
    rows = []
    for number, (parent, places) in enumerate(limbs, -1):
        for k, (head, tail) in enumerate(pairwise(points(places))):
            rows.append((head, tail, len(rows) - 1 if k else parent, number))
    heads, tails, parents, numbers = (np.array(column) for column in zip(*rows, strict=True))
    return Bones(heads.astype(float), tails.astype(float), parents, numbers)


def stretches(mesh, positions):
    """Length of each edge at other positions (n, 3) of the vertices, divided by that at rest."""
    a, b = mesh.edges.T
    rest, now = (
        np.linalg.norm(np.subtract(each[a], each[b], dtype=float), axis=1) for each in (mesh.vertices, positions)
    )
    return now / rest


def moved(points, motions):
    """Points (b, 3), each by the motion (4, 3) of its bone."""
    return np.einsum("bi,bij->bj", np.column_stack([points, np.ones(len(points))]), motions)


def assert_joined(bones, motions, tolerance=1e-12):
    """Assert that each bone begins where the motion of the bone that it hangs on takes its head."""
    child = np.flatnonzero(bones.parents >= 0)
    heads, above = bones.heads[child], motions[bones.parents[child]]
    np.testing.assert_allclose(moved(heads, motions[child]), moved(heads, above), rtol=0, atol=tolerance)


TURNS = [
    turned
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
    if np.linalg.det(turned := np.eye(3)[list(order)] * np.array(signs)) > 0
]
"""The 24 rotations by right angles."""
