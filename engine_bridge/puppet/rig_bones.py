"""Bones of a puppet that the joints of a file's skeleton follow, and their shares in the motion of vertices."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh
from engine_bridge.character.scene import tree
from engine_bridge.puppet.file_skeleton import FileSkeleton
from engine_bridge.puppet.limb_nodes import limb_nodes
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.skin_joints import vertex_influences
from solver.model.bones import Bones
from solver.motion.limbs import TRUNK, Limb, bone_ranges, bones_of, parents_first

LIMB_DISTANCES = (0.02, 0.05)
"""Maximum distances between limbs and their first joints, as fractions of the diagonal. They are tried one by one
until all limbs have joints: limbs that were found from the shape are beside the joints."""

MAX_TARGET_DISTANCE = 0.05
"""Maximum distance between a limb and a target of inverse kinematics, as a fraction of the diagonal."""

MIN_FOLLOWING = 0.02
"""Smallest number of vertices that follow a limb by the file's weights, as a share of those nearest to it, with which
the weights are used. Limbs of 20 public characters have 0.3 or more, a snake's jaw 0.05, an arm without weights 0."""

HEAD_TOLERANCE = 0.002
"""Maximum distance between a joint and a bone's head that count as one point, as a fraction of the diagonal: puppet
files hold rounded numbers."""


MAX_HINGE_DISTANCE = 0.03
"""Maximum distance between a joint and the point at which its bone is hinged, as a fraction of the diagonal, with which
it keeps its place relative to its parent."""


@dataclass(frozen=True, eq=False)
class RigBones:
    """Bones that the joints of a file's skeleton follow.

    Attributes
    ----------
    nodes : (j,) int64
        The joints, parents before their children.
    parents : (j,) int64
        Row of each joint's nearest ancestor, −1 for none.
    shares : (j, b) float64
        Share of each bone's rotation in that of each joint. A row's sum is 1, or 0 for a joint that does not turn.
    placed : (j,) bool
        Joints that move with their bones, because they have no parent, their parent belongs to another limb, or they
        are far from where their limb bends; all parts do, which need not turn at their origins. All others keep their
        translation from the file.
    missing : tuple of str
        Names of limbs without a joint.
    loose : tuple of str
        Names of shown nodes without a skin and without a joint above them; they count as joints.
    """

    nodes: NDArray[np.int64]
    parents: NDArray[np.int64]
    shares: NDArray[np.float64]
    placed: NDArray[np.bool_]
    missing: tuple[str, ...]
    loose: tuple[str, ...]

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Joints (j,) bool whose rotation differs from their parent's."""
        above = np.where(self.parents[:, None] >= 0, self.shares[self.parents], 0.0)
        return np.asarray((self.shares != above).any(axis=1))

    def of_nodes(self, character: CharacterMesh) -> NDArray[np.float64]:
        """Return the shares (nodes, b) of the bones in the motion of each node, those of the nearest joint above."""
        own = dict(zip(self.nodes.tolist(), self.shares, strict=True))
        found = np.zeros((len(character.document.gltf["nodes"]), self.shares.shape[1]))
        for node, parent in tree(character.document):
            found[node] = own.get(node, 0.0 if parent is None else found[parent])
        return found


def rig_bones(
    character: CharacterMesh, limbs: Sequence[Limb], nodes: Mapping[str, Sequence[int]] = MappingProxyType({})
) -> RigBones:
    """Return the bones that the joints of a file's skeleton follow.

    1. The first joint of a limb is the first of its nodes. Without nodes, it is at its first point, or is the first
       joint on its first bone. Of joints at one place, it is one that moves vertices, then the deepest.
    2. A chain of joints leads from the first joint to the last node, or to the limb's end. Each of them follows the
       bones between it and the next joint, in proportion to their lengths. The trunk's chain leads from the top of the
       skeleton to the parent of head, neck or arms. A joint below which limbs hang on an earlier bone follows that
       bone.
    3. A joint between a chain and a limb follows the bone on which the limb hangs. Any other child of a joint in a
       chain follows the bone next to it, and so do its descendants.
       A part hangs on the part that `part_joints` finds, and follows its bone.
    4. A target of inverse kinematics has the top of the skeleton as its parent, or no parent, and is on a limb beyond
       its first bone; it follows the bone there. Meshes without a joint follow the bone nearest to their middle.

    Parameters
    ----------
    character : CharacterMesh
    limbs : sequence of Limb
        Mesh file's coordinates.
    nodes : mapping of str to sequence of int, optional
        Nodes of the joints along a limb, by its name, root to tip.

    Returns
    -------
    RigBones
        Without joints if the file has no skeleton.
    """
    which, share = vertex_influences(character)
    skeleton, holding = FileSkeleton.of(character), {*which[share > 0].tolist()}
    found = []
    for distance in LIMB_DISTANCES:
        found.append(_BoneAssignment(skeleton, limbs, nodes, holding, distance).result())
        if not found[-1].missing or not len(skeleton):
            break
    return min(found, key=lambda each: len(each.missing))


def own_bones(character: CharacterMesh, puppet: Puppet) -> RigBones | None:
    """Return the bones that the joints of a file's skeleton follow; None if no limb is along the skeleton.

    Parameters
    ----------
    character : CharacterMesh
    puppet : Puppet

    Raises
    ------
    PuppetError
        A limb's nodes are not in the file.
    """
    found = _of_puppet(character, puppet)
    others = [limb.name for limb in puppet.limb if limb.name != TRUNK]
    return None if found is None or (others and len(found.missing) == len(others)) else found


def skin_shares(character: CharacterMesh, puppet: Puppet) -> NDArray[np.float64] | None:
    """Return each bone's share in the motion of each vertex.

    Parameters
    ----------
    character : CharacterMesh
    puppet : Puppet

    Returns
    -------
    (N, b) float64 or None
        Rows sum to 1, or to 0 for vertices that follow no bone. None if the file has no skeleton, or if its skeleton
        or its weights leave some limb out.
    """
    found = _of_puppet(character, puppet)
    if found is None or found.missing:
        return None
    which, share = vertex_influences(character)
    shares = np.asarray(np.einsum("nk,nkb->nb", share, found.of_nodes(character)[which]))
    bones = bones_of(puppet.limbs)
    near = np.bincount(nearest_bones(character.vertices, bones), minlength=len(bones))
    follow = shares.sum(axis=0)
    if any(follow[of].sum() < MIN_FOLLOWING * near[of].sum() for of in map(list, bone_ranges(puppet.limbs).values())):
        return None
    return shares


def _of_puppet(character: CharacterMesh, puppet: Puppet) -> RigBones | None:
    """Return the bones that joints follow; None without limbs or without a skeleton."""
    found = rig_bones(character, puppet.limbs, limb_nodes(puppet, character)) if puppet.limb else None
    return None if found is None or not len(found.nodes) else found


def nearest_bones(points: NDArray[np.float64], bones: Bones) -> NDArray[np.int64]:
    """Return the number (n,) of the bone nearest to each point (n, 3)."""
    nearest, distance = np.zeros(len(points), np.int64), np.full(len(points), np.inf)
    for number, (head, tail) in enumerate(zip(bones.heads, bones.tails, strict=True)):
        along = np.clip((points - head) @ (tail - head) / max(float((tail - head) @ (tail - head)), 1e-300), 0, 1)
        away = np.linalg.norm(points - head - along[:, None] * (tail - head), axis=1)
        nearest[away < distance] = number
        distance = np.minimum(distance, away)
    return nearest


@dataclass(frozen=True, eq=False)
class _Polyline:
    """Bones of a limb as a polyline.

    Attributes
    ----------
    limb : Limb
    bones : slice
        Numbers of its bones.
    near : float
        Maximum distance of a position from a bone's head that counts as the head, mesh units.
    """

    limb: Limb
    bones: range
    near: float

    @cached_property
    def heads(self) -> NDArray[np.float64]:
        """Distances (k,) float64 of the limb's points along it."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.limb.points, axis=0), axis=1))])

    def nearest(self, position: NDArray[np.float64]) -> tuple[float, float]:
        """Return a position's distance along the limb and its distance from it."""
        along, away = 0.0, np.inf
        for head, (start, end) in zip(self.heads, pairwise(self.limb.points), strict=False):
            bone = end - start
            share = float(np.clip((position - start) @ bone / (bone @ bone), 0, 1))
            distance = float(np.linalg.norm(position - start - share * bone))
            if distance < away:
                along, away = head + share * float(np.linalg.norm(bone)), distance
        at = self.heads[np.abs(self.heads - along).argmin()]
        return float(at if abs(at - along) <= self.near else along), away

    def bone_at(self, along: float) -> int:
        """Return the number of the bone at a distance along the limb; where two bones meet, the second."""
        last = self.bones.stop - self.bones.start - 1
        return self.bones.start + min(int(np.searchsorted(self.heads, along, "right")) - 1, last)

    def overlaps(self, start: float, end: float) -> NDArray[np.float64]:
        """Return the length of each bone between two distances along the limb."""
        return np.maximum(np.minimum(self.heads[1:], end) - np.maximum(self.heads[:-1], start), 0.0)


class _BoneAssignment:
    """Assigns bones to the joints of a skeleton."""

    def __init__(
        self,
        skeleton: FileSkeleton,
        limbs: Sequence[Limb],
        nodes: Mapping[str, Sequence[int]],
        holding: Collection[int],
        distance: float,
    ) -> None:
        self.skeleton = skeleton
        self.limb_distance = distance * skeleton.diagonal
        self.holding = {row for row, node in enumerate(skeleton.nodes) if node in holding}  # which move vertices
        self.bones = bones_of(limbs)
        ranges, near = bone_ranges(limbs), HEAD_TOLERANCE * skeleton.diagonal
        self.polylines = {limb.name: _Polyline(limb, ranges[limb.name], near) for limb in parents_first(limbs)}
        self.trunk = self.polylines.get(TRUNK)
        rows = {node: row for row, node in enumerate(skeleton.nodes)}
        self.remembered = {name: [rows[node] for node in chain if node in rows] for name, chain in nodes.items()}
        self.firsts = self._first_joints()
        self.limb_of = [
            next((self.firsts[row] for row in path if row in self.firsts), None) for path in skeleton.paths_to_top
        ]
        self.shares = np.zeros((len(skeleton), len(self.bones)))
        self.stretches: dict[int, tuple[_Polyline, float, float]] = {}  # of joints on polylines
        self.placed: set[int] = set()  # joints that follow another bone than their parent, but are not where it begins

    def result(self) -> RigBones:
        """Assign bones to all joints."""
        for first, name in self.firsts.items():
            for end in self._ends(first, name):
                path = self.skeleton.paths_to_top[end]
                self._assign_path(self.polylines[name], path[path.index(first) :: -1] if first in path else [end])
        for path in self._trunk_paths():
            self._assign_path(self.trunk, path)
        for row in sorted(range(len(self.skeleton)), key=lambda row: len(self.skeleton.paths_to_top[row])):
            parent = self.skeleton.parents[row]
            if row not in self.stretches and self.skeleton.of_parts and parent >= 0:
                self.shares[row] = self.shares[parent]
            elif row not in self.stretches:
                self.shares[row] = self._shares_beside(row)
        return RigBones(
            nodes=np.array(self.skeleton.nodes, dtype=np.int64),
            parents=np.array(self.skeleton.above, dtype=np.int64),
            shares=self.shares,
            placed=np.array(
                [
                    self.skeleton.of_parts or parent < 0 or row in self.placed or not self._joined(row, parent)
                    for row, parent in enumerate(self.skeleton.parents)
                ]
            ),
            missing=tuple(name for name in self.polylines if name != TRUNK and name not in self.firsts.values()),
            loose=tuple(self.skeleton.loose.values()),
        )

    def _first_joints(self) -> dict[int, str]:
        """Return the first joint of each limb in each tree of joints, with the limb's name.

        The trunk has none, because its first point is between the legs.
        """
        known = {chain[0]: name for name, chain in self.remembered.items() if chain}
        found = dict(known)
        limbs = [polyline for name, polyline in self.polylines.items() if name != TRUNK]
        tops = [row for row, parent in enumerate(self.skeleton.parents) if parent < 0]
        tops = [row for row in tops if row not in self.skeleton.loose]
        for top in tops:
            for polyline in limbs:
                there = any(name == polyline.limb.name and self._top(row) == top for row, name in found.items())
                candidates = [] if there else list(self._candidates(polyline, top))
                candidates = [row for row in candidates if row not in found and self._fits(row, polyline, found)]
                if candidates:
                    best = min(candidates, key=lambda row: self._misfit(row, polyline))
                    found[best] = polyline.limb.name
        return {
            row: name
            for row, name in found.items()
            if row in known
            or self._fits(row, self.polylines[name], {other: n for other, n in found.items() if other != row})
        }

    def _top(self, row: int) -> int:
        return self.skeleton.paths_to_top[row][-1]

    def _candidates(self, polyline: _Polyline, top: int) -> Iterator[int]:
        """Yield the joints of a tree at a limb's first point or on its first bone."""
        for row, position in enumerate(self.skeleton.positions):
            along, away = polyline.nearest(position)
            if self._top(row) == top and along < polyline.heads[1] and away <= self.limb_distance:
                yield row

    def _misfit(self, row: int, polyline: _Polyline) -> tuple[float, bool, int]:
        """Return a sort key for first joints of a limb: the misfit, then what moves vertices, then the deeper joint."""
        below = [other for other, path in enumerate(self.skeleton.paths_to_top) if row in path]
        start, following = polyline.limb.points[:2]
        away = float(np.linalg.norm(self.skeleton.positions[row] - start))
        away += float(np.linalg.norm(self.skeleton.positions[below] - following, axis=1).min())
        return round(away / polyline.near), self.holding.isdisjoint(below), -len(self.skeleton.paths_to_top[row])

    def _fits(self, row: int, polyline: _Polyline, found: dict[int, str]) -> bool:
        """Return whether all limbs with a first joint below this joint are children of this limb."""
        for other, name in found.items():
            if row in self.skeleton.paths_to_top[other][1:] and not self._is_child(self.polylines[name], polyline):
                return False
        return True

    def _is_child(self, polyline: _Polyline, other: _Polyline) -> bool:
        """Return whether a limb is a child of another, in the puppet or because it begins where the other ends."""
        limb: Limb | None = polyline.limb
        while limb is not None and limb.parent is not None:
            if limb.parent == other.limb.name:
                return True
            limb = self.polylines[limb.parent].limb
        return bool(np.linalg.norm(polyline.limb.points[0] - other.limb.points[-1]) <= self.limb_distance)

    def _ends(self, first: int, name: str) -> list[int]:
        """Return the last joint of the chain from a limb's first joint, and the limb's nodes outside the chain.

        Such a node is a foot with inverse kinematics, which hangs on the root.
        """
        polyline, remembered = self.polylines[name], self.remembered.get(name, [])
        below = [row for row, path in enumerate(self.skeleton.paths_to_top) if first in path]
        if first in remembered:
            return [[row for row in remembered if row in below][-1], *(row for row in remembered if row not in below)]
        members = [row for row in below if self.limb_of[row] == name]
        following = self._following(polyline)
        after = [row for row in below if following is not None and self.firsts.get(row) == following.limb.name]
        if after:
            members = [self.skeleton.parents[row] for row in after]
        return [min(members, key=lambda row: self._away(row, polyline.limb.points[-1]))]

    def _trunk_paths(self) -> Iterator[list[int]]:
        """Yield for each tree the joints from its top to the parent of head, neck or arms."""
        if self.trunk is None:
            return
        end = self.trunk.limb.points[-1]
        for top in dict.fromkeys(self._top(row) for row in self.firsts):
            firsts = [row for row in self.firsts if self._top(row) == top]
            upper = [row for row in firsts if self._parent_bone(row) == self.trunk.bones.stop - 1]
            upper = [self.skeleton.parents[row] for row in sorted(upper, key=lambda row: self._away(row, end))]
            upper = [row for row in upper if row >= 0 and self.limb_of[row] is None]
            members = [row for row, limb in enumerate(self.limb_of) if limb is None and self._top(row) == top]
            if members:
                last = upper[0] if upper else min(members, key=lambda row: self._away(row, end))
                yield self.skeleton.paths_to_top[last][::-1]

    def _parent_bone(self, first: int) -> int:
        return int(self.bones.parents[self.polylines[self.firsts[first]].bones.start])

    def _away(self, row: int, position: NDArray[np.float64]) -> float:
        return float(np.linalg.norm(self.skeleton.positions[row] - position))

    def _assign_path(self, polyline: _Polyline | None, path: Sequence[int]) -> None:
        """Assign bones to the joints along a limb."""
        if polyline is None:
            return
        along = np.array([polyline.nearest(self.skeleton.positions[row])[0] for row in path])
        along = np.minimum.accumulate(along[::-1])[::-1]  # a joint may lie beyond the next one
        end, following = float(polyline.heads[-1]), None
        for row, start in zip(reversed(path), along[::-1].tolist(), strict=True):
            last, lengths = following is None, polyline.overlaps(start, end)
            if last and polyline is not self.trunk:
                self.shares[row, polyline.bones.start + int(np.abs(polyline.heads[:-1] - start).argmin())] = 1
            elif not lengths.any():
                self.shares[row, polyline.bone_at(start)] = 1
            elif last:  # it moves the rest of the trunk, which is mostly this bone
                self.shares[row, polyline.bones.start + int(lengths.argmax())] = 1
            else:
                self.shares[row, polyline.bones] = lengths / lengths.sum()
            carried = self._carried_bones(row) if polyline is self.trunk else set()
            if carried and min(carried) < self.shares[row].argmax():  # such as one joint at the back, above all others
                self.shares[row] = self._single(min(carried))
                start, end = polyline.heads[min(carried) - polyline.bones.start :][:2].tolist()
                self.placed.update(() if following is None else (following,))
            self.stretches[row] = polyline, start, end
            end, following = start, row

    def _carried_bones(self, row: int) -> set[int]:
        """Return the bones on which the limbs below a joint hang; −1 for none."""
        return {self._parent_bone(first) for first in self.firsts if row in self.skeleton.paths_to_top[first]}

    def _shares_beside(self, row: int) -> NDArray[np.float64]:
        """Return the shares (b,) of a joint that is not on a polyline."""
        parent, position = self.skeleton.parents[row], self.skeleton.positions[row]
        if row in self.skeleton.loose:
            polyline = min(self.polylines.values(), key=lambda polyline: polyline.nearest(position)[1])
            return self._single(polyline.bone_at(polyline.nearest(position)[0]))
        if self.limb_of[row] is None and (parent < 0 or self.skeleton.parents[parent] < 0):
            target = self._target_bone(position)
            if target is not None:
                return self._single(target)
        if parent < 0:
            return self._single(None if self.trunk is None else self.trunk.bones.start)
        carried = self._carried_bones(row)
        if len(carried) == 1 and min(carried) >= 0 and self.limb_of[row] is None:
            if not self.shares[parent, min(carried)]:
                self.placed.add(row)
            return self._single(min(carried))
        if parent in self.stretches:
            polyline, start, end = self.stretches[parent]
            along, _ = polyline.nearest(position)
            if start <= along <= end:
                following = self._following(polyline) if along == polyline.heads[-1] else None
                if following is not None:
                    self.placed.add(row)
                    return self._single(following.bones.start)
                return self._single(polyline.bone_at(along))
        return self.shares[parent]

    def _following(self, polyline: _Polyline) -> _Polyline | None:
        """Return the limb that begins where a limb ends, such as the head after the neck; None without one."""
        for other in self.polylines.values():
            at_end = np.linalg.norm(other.limb.points[0] - polyline.limb.points[-1]) <= polyline.near
            if polyline is not self.trunk and other.limb.parent == polyline.limb.name and at_end:
                return other
        return None

    def _target_bone(self, position: NDArray[np.float64]) -> int | None:
        """Return the bone at a target of inverse kinematics, which is never a limb's first bone; None without one."""
        found = []
        for name, polyline in self.polylines.items():
            along, away = polyline.nearest(position)
            if name != TRUNK and away <= MAX_TARGET_DISTANCE * self.skeleton.diagonal and along >= polyline.heads[1]:
                found.append((away, polyline.bone_at(along)))
        return min(found)[1] if found else None

    def _single(self, bone: int | None) -> NDArray[np.float64]:
        shares = np.zeros(len(self.bones))
        if bone is not None:
            shares[bone] = 1
        return shares

    def _joined(self, row: int, parent: int) -> bool:
        """Return whether a joint's bones are those of its parent, or hinged to them where it is."""
        own, above = (set(np.flatnonzero(self.shares[each]).tolist()) for each in (row, parent))
        if not above:
            return all(self.bones.parents[bone] < 0 for bone in own)
        hinges = [bone for bone in own if self.bones.parents[bone] in above]
        hinges += [bone for bone in above if self.bones.parents[bone] in own]
        away = [self._away(row, self.bones.heads[bone]) for bone in hinges]
        return bool(own & above) or min(away, default=np.inf) <= MAX_HINGE_DISTANCE * self.skeleton.diagonal
