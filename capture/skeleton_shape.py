"""Meanings of the joints of a skeleton by its shape: for skeletons whose names say nothing, and to tell animals.

The two sides of a body are mirror images in its rest pose. Chains of joints with a mirror image are limbs: legs reach
the floor, arms do not; between them is the trunk, beyond the arms are neck and head. Feet point forward, which tells
left from right.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]

SAME_PLACE = 0.1
"""Largest distance of a joint from the mirror image of its counterpart, as a share of the skeleton's size: the bones of
both sides are measured each."""

NO_LENGTH = 0.003
"""Length, as a share of the skeleton's size, below which a bone has none."""

MIN_LIMB = 0.2
"""Smallest length of an arm or leg, as a share of the skeleton's size."""

FLOOR_SHARE = 0.2
"""Height over the lowest joint, as a share of the skeleton's height, up to which a limb reaches the floor."""


ALIKE_SHARE = 0.75
"""Two pairs of bones in a limb that differ by less are alike; the outer pair counts: a collarbone can be long."""


class Shape(NamedTuple):
    """What a skeleton's shape tells.

    Attributes
    ----------
    legs : int
        Number of limbs that reach the floor; 0 if the skeleton has no sides.
    joints : dict
        Nodes of the joints of `capture.skeleton.JOINTS`, for a body with two legs and two arms, or with four legs, of
        which those nearer to the head are arms.
    """

    legs: int
    joints: dict[str, int]


def shape_of(parents: Sequence[int], rest: Points, is_end: Sequence[bool]) -> Shape:
    """Return the number of legs of a skeleton and, of a person's, the joints.

    Parameters
    ----------
    parents : sequence of int
        Parents precede children; −1 for a root.
    rest : (J, 3) float64
        Positions in the rest pose, in any unit and right-handed axes.
    is_end : sequence of bool
        Whether a node is only the end of a bone.
    """
    tree = _Tree(parents, rest, is_end)
    sides = _sides(tree)
    if sides is None:
        return Shape(0, {})
    across, pairs = sides
    limbs = [limb for limb in _limbs(tree, pairs, across) if tree.length(limb.left) > MIN_LIMB * tree.size]
    found = _upright(tree, limbs, across)
    if found is None:
        return Shape(0, {})
    up, legs = found
    arms = [limb for limb in limbs if limb not in legs]
    if len(legs) == 2:
        hind, front = legs[::-1] if tree.path(legs[0].attached, legs[1].attached) else legs
        ahead = tree.rest[front.attached] - tree.rest[hind.attached]
        return Shape(4, _joints(tree, hind, front, up, across, pairs, ahead))
    if len(legs) != 1 or not arms:
        return Shape(2 * len(legs), {})
    [leg] = legs
    arm = max(arms, key=lambda limb: tree.length(limb.left) * (limb.attached != leg.attached))
    return Shape(2, _joints(tree, leg, arm, up, across, pairs))


class _Limb(NamedTuple):
    """A chain of nodes with a mirror image, from the root to the tip, and the middle node that it is attached to."""

    attached: int
    left: list[int]
    right: list[int]


class _Tree:
    """A tree of nodes in a rest pose."""

    def __init__(self, parents: Sequence[int], rest: Points, is_end: Sequence[bool]) -> None:
        self.parents, self.rest, self.is_end = parents, rest, is_end
        self.size = float(np.ptp(rest, axis=0).max())
        self.children: list[list[int]] = [[] for _ in parents]
        self._next, reach = [-1] * len(parents), [0.0] * len(parents)  # the way to the farthest leaf, and its length
        below, count = rest.copy(), np.ones(len(rest))
        for node, parent in reversed(list(enumerate(parents))):
            if parent >= 0:
                self.children[parent].insert(0, node)
                below[parent] += below[node]
                count[parent] += count[node]
                way = reach[node] + self.length([parent, node])
                if way >= reach[parent]:
                    self._next[parent], reach[parent] = node, way
        self.middles = below / count[:, None]  # of each node and those below it

    def longest(self, node: int) -> list[int]:
        """Return the longest chain of nodes from a node to a leaf."""
        chain = [node]
        while (node := self._next[node]) >= 0:
            chain.append(node)
        return chain

    def length(self, chain: Sequence[int]) -> float:
        """Return the length of a chain."""
        return float(sum(np.linalg.norm(self.rest[a] - self.rest[b]) for a, b in pairwise(chain)))

    def path(self, node: int, top: int) -> list[int]:
        """Return the nodes from below a node to one of its descendants; empty if it is none."""
        found = []
        while node >= 0 and node != top:
            found.append(node)
            node = self.parents[node]
        return found[::-1] if node == top else []

    def distinct(self, chain: Sequence[int]) -> list[int]:
        """Return the nodes of a chain without those at the place of the node before them; the last one counts."""
        found: list[int] = []
        for node in chain:
            if found and np.linalg.norm(self.rest[found[-1]] - self.rest[node]) < NO_LENGTH * self.size:
                found.pop()
            found.append(node)
        return found


def _sides(tree: _Tree) -> tuple[int, dict[int, int]] | None:
    """Return the axis from side to side, and the counterpart of each node that has one."""
    best: tuple[int, dict[int, int]] | None = None
    for axis in range(3):
        pairs = _pairs(tree, axis)
        if pairs and (best is None or len(pairs) > len(best[1])):
            best = axis, pairs
    return best


def _pairs(tree: _Tree, axis: int) -> dict[int, int]:
    """Return the counterparts of nodes if an axis goes from side to side: siblings at mirrored places."""
    middle = tree.rest[0, axis]
    flip = np.where(np.arange(3) == axis, -1.0, 1.0)
    shift = np.where(np.arange(3) == axis, 2 * middle, 0.0)
    pairs: dict[int, int] = {}
    for node, parent in enumerate(tree.parents):
        if node in pairs or parent < 0 or abs(tree.middles[node, axis] - middle) < NO_LENGTH * tree.size:
            continue
        away = {
            other: float(
                np.linalg.norm(flip * tree.middles[node] + shift - tree.middles[other])
                + np.linalg.norm(flip * tree.rest[node] + shift - tree.rest[other])
            )
            for other in tree.children[pairs.get(parent, parent)]
            if other not in pairs and other != node
        }
        other = min(away, key=away.__getitem__, default=node)
        opposite = (tree.middles[node, axis] - middle) * (tree.middles[other, axis] - middle) < 0
        if opposite and away[other] < 2 * SAME_PLACE * tree.size:
            pairs[node], pairs[other] = other, node
    return pairs


def _limbs(tree: _Tree, pairs: dict[int, int], axis: int) -> list[_Limb]:
    """Return the chains of nodes with a counterpart that are attached to a node without one.

    The left ones are further along the axis from side to side.
    """
    return [
        _Limb(tree.parents[node], tree.longest(node), tree.longest(other))
        for node, other in pairs.items()
        if tree.middles[node, axis] > tree.middles[other, axis] and tree.parents[node] not in pairs
    ]


def _upright(tree: _Tree, limbs: Sequence[_Limb], across: int) -> tuple[Points, list[_Limb]] | None:
    """Return the direction up and the limbs that reach the floor: at one end of an axis are feet, at the other none."""
    best, found = 0.0, None
    for axis in {0, 1, 2} - {across}:
        extent = float(np.ptp(tree.rest[:, axis]))
        for sign in (1.0, -1.0):
            heights = sign * tree.rest[:, axis]
            floor = heights.min()
            legs = [
                limb
                for limb in limbs
                if heights[limb.left].min() - floor < FLOOR_SHARE * extent
                and heights[limb.left[0]] - heights[limb.left].min() > tree.length(limb.left) / 2
            ]
            stands = sum(tree.length(limb.left) for limb in legs)
            if stands > best:
                best, found = stands, (sign * np.eye(3)[axis], legs)
    return found


def _joints(
    tree: _Tree, leg: _Limb, arm: _Limb, up: Points, across: int, pairs: dict[int, int], ahead: Points | None = None
) -> dict[str, int]:
    """Return the joints of a body with a pair of legs and one of arms; `ahead` is its front if toes do not tell it."""
    found: dict[str, int] = {"hip_center": leg.attached}
    trunk = tree.distinct([leg.attached, *tree.path(arm.attached, leg.attached)])
    if len(trunk) > 1 and trunk[1] != arm.attached:
        found["spine"] = trunk[1]
    found |= _neck_and_head(tree, arm.attached, up, pairs)
    chains = {"leg": (leg, ("hip", "knee", "ankle", "foot")), "arm": (arm, ("shoulder", "elbow", "wrist", "hand"))}
    toes = np.zeros(3) if ahead is None else ahead
    for limb, names in chains.values():
        for side, chain in (("a", limb.left), ("b", limb.right)):
            nodes = _long_bones(tree, tree.distinct(chain))
            found |= {f"{name}_{side}": node for name, node in zip(names, nodes, strict=False)}
            if names[0] == "hip" and len(nodes) > 3 and ahead is None:
                toes += tree.rest[nodes[3]] - tree.rest[nodes[2]]
    forward = toes - up * (toes @ up)
    left = np.cross(up, forward) if forward.any() else np.eye(3)[across]
    is_left = (tree.rest[found["hip_a"]] - tree.rest[found["hip_b"]]) @ left > 0
    sides = {"a": "left", "b": "right"} if is_left else {"a": "right", "b": "left"}
    return {f"{name[:-2]}_{sides[name[-1]]}" if name[-2:] in ("_a", "_b") else name: at for name, at in found.items()}


def _neck_and_head(tree: _Tree, attached: int, up: Points, pairs: dict[int, int]) -> dict[str, int]:
    """Return the neck and the head: the way from where the arms are attached to the highest tip between the sides."""
    tips = [node for node in range(len(tree.parents)) if not tree.children[node]]
    paths = [path for node in tips if (path := tree.path(node, attached)) and not pairs.keys() & set(path)]
    path = max(paths, key=lambda path: float(tree.rest[path[-1]] @ up), default=[])
    inner = [node for node in path if not tree.is_end[node]]
    head = next((k for k, node in enumerate(inner) if k and len(tree.children[node]) > 1), len(inner) - 1)
    has_end = head < len(inner) - 1 or (path != inner and tree.length(path[-2:]) > NO_LENGTH * tree.size)
    inner = inner[: head + 1]
    if len(inner) > 2 and not has_end:
        inner.pop()
    found = {"head": inner[-1]} if inner else {}
    return found | {"shoulder_center": inner[0]} if len(inner) > 1 else found


def _long_bones(tree: _Tree, chain: Sequence[int]) -> list[int]:
    """Return the nodes of a limb from the beginning of its two long bones on."""
    lengths = [float(np.linalg.norm(tree.rest[a] - tree.rest[b])) for a, b in pairwise(chain)]
    if len(lengths) < 2:
        return list(chain)
    shorter = [min(pair) for pair in pairwise(lengths)]
    first = max(k for k, length in enumerate(shorter) if length >= ALIKE_SHARE * max(shorter))
    return list(chain[first:])
