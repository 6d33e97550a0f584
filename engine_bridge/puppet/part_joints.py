"""Joints of a character that is made of rigid parts: on which other part each hangs, and where it turns.

Files made by hand or by a program often list all parts side by side, with their origins in their middles. Then neither
hierarchy nor origins say how the body moves, but what touches does.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.spatial import Delaunay, QhullError, cKDTree

from capture.bone_names import JointMeaning, joint_meanings
from engine_bridge.character.character import CharacterMesh
from engine_bridge.character.scene import tree, world_transforms
from engine_bridge.puppet.joint_labels import LABEL_OF
from engine_bridge.puppet.limb_nodes import node_labels
from engine_bridge.puppet.skin_joints import STRAIGHT, Joint, part_nodes, parts_above
from solver.anatomy.orientation import spread

MAX_PARTS = 400
"""Maximum number of parts of a body: the time to compare them grows with its square."""

SAMPLES = 200
"""Number of points on the surface of each part with which distances are measured."""

TOUCHING_SHARE = 0.02
"""Maximum distance between parts that touch, as a share of the body's size."""

NEAR_SHARE = 0.05
"""Maximum distance between parts of one limb, as a share of the body's size."""

NAMELESS = 1.5
"""How much more it costs, in shares of a surface that touches, to hang a part on another one if names do not say what
both are: clothes and ornaments hang on a body, but carry none of it."""

FORBIDDEN = 2.0
"""The same for two parts that names do not allow to hang on each other."""

WHOLE_SHARE = 0.97
"""Smallest extent of a part that is the whole body, as a share of the extent of all parts, along each axis."""

LARGE = 0.3
"""How much less it costs to hang a part on the largest one, in the same unit."""

MIN_NAMED = 4
"""Number of parts whose names say what they are from which the others are ornaments."""

MIDDLE_SHARE = 0.25
"""Maximum distance of an origin from the middle of its part, in half diagonals, that says nothing: an origin elsewhere
in the part is where its maker wants it to turn."""

CONTACT_SHARE = 0.1
"""Distance from the part that it hangs on, in diagonals of a part, at which its surface counts 1/e of what touches."""

SLENDER = 1.8
"""Length of a part in thicknesses from which it turns at one of its ends."""

AT_END = 0.4
"""Distance of where a slender part touches from its middle, in half lengths, from which it touches at an end."""

STEEP_COSINE = 0.5
"""Minimum cosine between up and the length of a part that hangs."""

END_SHARE = 0.9
"""Distance of the joint of a slender part from its middle, as a share of that of its end."""


@dataclass(frozen=True, eq=False)
class _Shape:
    """Points (n, 3) on the surface of a part, the same to search in, and their convex hull."""

    points: NDArray[np.float64]
    tree: cKDTree
    hull: Delaunay | None

    @classmethod
    def of(cls, corners: NDArray[np.float64]) -> "_Shape":
        """Take the surface of triangles with these corners (t, 3, 3)."""
        points, hull = spread(corners, SAMPLES)[0], None
        with suppress(QhullError):  # all in one place
            hull = Delaunay(points, qhull_options="QJ")
        return cls(points, cKDTree(points), hull)

    def distances(self, others: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the distances (n,) of other points (n, 3); 0 inside."""
        away = np.asarray(self.tree.query(others)[0])
        return away if self.hull is None else np.where(self.hull.find_simplex(others) >= 0, 0.0, away)

    def root(self, origin: NDArray[np.float64], parent: "_Shape", size: float) -> NDArray[np.float64]:
        """Return where the part turns: at its origin if that is toward its parent, else where it touches it.

        A slender part turns at the end that is nearer; a steep one that touches its parent along its side, as a hanging
        arm does, at the upper end by glTF's axes.
        """
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        middle, half, margin = (low + high) / 2, float(np.linalg.norm(high - low)) / 2, TOUCHING_SHARE * size
        inside = ((low - margin < origin) & (origin < high + margin)).all()
        if inside and np.linalg.norm(origin - middle) > MIDDLE_SHARE * half:
            from_origin, from_middle = parent.distances(np.array([origin, middle]))
            if from_origin < from_middle:
                return np.asarray(origin)
        away = parent.distances(self.points)
        weights = np.exp(-(away - away.min()) / max(CONTACT_SHARE * 2 * half, 1e-12))
        contact = np.average(self.points, axis=0, weights=weights)
        _, spans, axes = np.linalg.svd(self.points - self.points.mean(axis=0), full_matrices=False)
        if spans[0] < SLENDER * spans[1]:
            return np.asarray(contact)
        length = float(np.abs((self.points - middle) @ axes[0]).max())
        at = float((contact - middle) @ axes[0]) / max(length, 1e-12)
        if abs(at) < AT_END and abs(axes[0, 1]) < STEEP_COSINE:
            return np.asarray(contact)  # as a shoe below a leg
        toward = np.sign(at if abs(at) > AT_END else axes[0, 1])
        return np.asarray(middle + END_SHARE * toward * length * axes[0])


def part_joints(character: CharacterMesh, back: NDArray[np.float64] = STRAIGHT) -> list[Joint]:
    """Return a joint for each node of `part_nodes`, for a character without skins whose parts are not nested.

    The vertices of a joint are the corners of its part's triangles. Places are those of the character that `back`
    (3, 3), a rotation, turns back to its axes.

    A part hangs on the one that it touches most, or that is nearest; on the one above it in the file, if it touches
    that. A limb does not hang on another one. The first part is the largest whose name says that it is the trunk, or
    else the one without which the largest of the remaining pieces is smallest: one whose name says nothing, if there
    is any between others. A single part has no joint, nor have more than `MAX_PARTS`.
    """
    nodes = part_nodes(character)
    if not 2 <= len(nodes) <= MAX_PARTS:
        return []
    names = _names(character, nodes)
    meanings = joint_meanings(names, [True] * len(names))
    surfaces = [
        np.concatenate([part.vertices[part.triangles] @ back.T for part in character.parts if part.node == node])
        for node in nodes
    ]
    size = max(float(np.ptp(np.concatenate(surfaces), axis=(0, 1)).max()), 1e-12)
    shapes, areas = [_Shape.of(corners) for corners in surfaces], np.array([_area(corners) for corners in surfaces])
    costs = _costs(shapes, meanings, parts_above(character, nodes), size)
    costs[costs > 0] -= LARGE * np.maximum.outer(areas, areas)[costs > 0] / areas.sum()
    spanning = minimum_spanning_tree(csr_array(costs))
    _, parents = breadth_first_order(spanning, _first(spanning, meanings, areas), directed=False)
    labels, origins = node_labels(character.document), world_transforms(character.document)[:, :3, 3] @ back.T
    joints = []
    for row, (node, parent) in enumerate(zip(nodes, parents.tolist(), strict=True)):
        own = shapes[row]
        place = own.root(origins[node], shapes[parent], size) if parent >= 0 else own.points.mean(axis=0)
        joints.append(Joint(names[row], max(parent, -1), place, surfaces[row].reshape(-1, 3), labels[node]))
    return joints


def _costs(
    shapes: Sequence[_Shape], meanings: Sequence[JointMeaning | None], above: Sequence[int], size: float
) -> NDArray[np.float64]:
    """Return what it costs (p, p) to hang one of two parts on the other, below the diagonal."""
    lows, highs = (np.array([getattr(each.points, end)(axis=0) for each in shapes]) for end in ("min", "max"))
    apart = np.linalg.norm(
        np.maximum(lows[:, None] - highs[None], 0) + np.maximum(lows[None] - highs[:, None], 0), axis=2
    )
    costs = np.zeros((len(shapes), len(shapes)))
    for one, other in combinations(range(len(shapes)), 2):
        meant, gap, touching = (meanings[one], meanings[other]), float(apart[one, other]) / size, 0.0
        if gap < NEAR_SHARE:
            away = shapes[other].distances(shapes[one].points), shapes[one].distances(shapes[other].points)
            gap = float(min(map(np.min, away))) / size
            shares = [float(np.mean(each < TOUCHING_SHARE * size)) for each in away]
            touching = max(share for share, own in zip(shares, meant, strict=True) if own is None or None not in meant)
        in_file = touching > 0 and (above[one] == other or above[other] == one)
        refused = NAMELESS * (None in meant) + FORBIDDEN * (not _may_hang(*meant, gap < NEAR_SHARE))
        costs[other, one] = 3 + gap - touching - in_file + refused  # above 0, which would be no connection
    return costs


def without_ornaments(parts: Sequence[Joint]) -> list[Joint]:
    """Return the parts whose names say what they are, and those that carry them; all if few names do.

    If no name says that a part is the head, one that hangs on the first part may be. None are left if one part is the
    whole body, among others such as marks of its joints.
    """
    held = [part.vertices for part in parts if len(part.vertices)]
    size = np.ptp(np.concatenate(held), axis=0) if held else np.zeros(3)
    if any((np.ptp(vertices, axis=0) >= WHOLE_SHARE * size).all() for vertices in held):
        return []
    meanings = joint_meanings([part.name for part in parts], [True] * len(parts))
    has_head = any(meaning and LABEL_OF.get(meaning.part) == "head" for meaning in meanings)
    first = next((row for row, part in enumerate(parts) if part.parent < 0), -1)
    kept = {
        row
        for row, (part, meaning) in enumerate(zip(parts, meanings, strict=True))
        if meaning or (not has_head and part.parent == first)
    }
    if len(kept) < MIN_NAMED:
        return list(parts)
    for row in [*kept]:
        while (row := parts[row].parent) >= 0:
            kept.add(row)
    rows = {row: place for place, row in enumerate(sorted(kept))}
    return [replace(parts[row], parent=rows.get(parts[row].parent, -1)) for row in rows]


def _names(character: CharacterMesh, nodes: Sequence[int]) -> list[str]:
    """Return the name of each part: its own, or that of a node above it that shows nothing else."""
    gltf, shown = character.document.gltf, {node: {node} for node in nodes}
    above = {node: parent for node, parent in tree(character.document) if parent is not None}
    for node in nodes:
        over = node
        while (over := above.get(over, -1)) >= 0:
            shown.setdefault(over, set()).add(node)
    found = []
    for node in nodes:
        tried = [node]
        while tried[-1] in above and shown[above[tried[-1]]] == {node}:
            tried.append(above[tried[-1]])
        names = [gltf["nodes"][each].get("name", "") for each in tried]
        meanings = joint_meanings(names)
        found.append(next((name for name, meaning in zip(names, meanings, strict=True) if meaning), names[0]))
    return found


def _may_hang(one: JointMeaning | None, other: JointMeaning | None, near: bool) -> bool:
    """Return whether names allow that a part hangs on another: of limbs, only near parts of the same one."""
    if one is None or other is None:
        return True
    labels = {LABEL_OF.get(one.part), LABEL_OF.get(other.part)}
    if labels & {None, "trunk"} or labels <= {"head", "ear"}:
        return True
    return len(labels) == 1 and near and (one.side == other.side or None in (one.side, other.side))


def _area(corners: NDArray[np.float64]) -> float:
    """Return the area of triangles with these corners (t, 3, 3)."""
    return float(np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum())


def _first(spanning: csr_array, meanings: Sequence[JointMeaning | None], areas: NDArray[np.float64]) -> int:
    """Return the row of the trunk."""
    named = [row for row, meaning in enumerate(meanings) if meaning and LABEL_OF.get(meaning.part) == "trunk"]
    if named:
        return max(named, key=lambda row: areas[row])
    pieces = list[list[float]]()
    for row in range(len(areas)):
        order, above = breadth_first_order(spanning, row, directed=False)
        held = areas.copy()
        for each in order[:0:-1]:
            held[above[each]] += held[each] if above[each] != row else 0.0
        pieces.append([float(held[each]) for each in order[1:] if above[each] == row])

    def rank(row: int) -> tuple[bool, float]:
        is_between = meanings[row] is None and len(pieces[row]) > 1  # what carries a head and arms, and not an eye
        return not is_between, max(pieces[row], default=0.0)

    return min(range(len(areas)), key=rank)
