"""Which bones of a puppet the joints of a file's own skeleton follow."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character
from engine_bridge.character.scene import tree, world_transforms
from puppetline.errors import PuppetError, at
from solver.motion.limbs import TRUNK, Limb, bones_of, parents_first

MAX_LIMB_DISTANCE = 0.01
"""Greatest distance between a limb and its first joint, as a fraction of the diagonal."""

MAX_TARGET_DISTANCE = 0.02
"""The same for a joint on a limb that does not hang there, as a target of inverse kinematics."""

HEAD_TOLERANCE = 0.002
"""A joint this near to a bone's head, as a fraction of the diagonal, is at it: puppet files hold rounded numbers."""


@dataclass(frozen=True, eq=False)
class RigBones:
    """Which bones the joints of a file's skeleton follow.

    Attributes
    ----------
    nodes : (j,) int64
        The joints, parents before their children.
    parents : (j,) int64
        Row of the nearest joint above each, −1 for none.
    shares : (j, b) float64
        Share of each bone's rotation in that of each joint. A row's sum is 1, or 0 for a joint that does not turn.
    placed : (j,) bool
        Joints that go where their bones take them: they hang on no joint, or on one of another limb. All others keep
        the translation that they have in the file.
    missing : tuple of str
        Names of the limbs that have no joint.
    loose : tuple of str
        Names of shown nodes without a skin and without a joint above them; they are among the joints.
    """

    nodes: NDArray[np.int64]
    parents: NDArray[np.int64]
    shares: NDArray[np.float64]
    placed: NDArray[np.bool_]
    missing: tuple[str, ...]
    loose: tuple[str, ...]

    @property
    def turning(self) -> NDArray[np.bool_]:
        """(j,) bool: joints that turn otherwise than the one above them."""
        above = np.where(self.parents[:, None] >= 0, self.shares[self.parents], 0.0)
        return np.asarray((self.shares != above).any(axis=1))

    def of_nodes(self, character: Character) -> NDArray[np.int64]:
        """Return for each node (nodes,) the bone that moves it most; −1 for none."""
        strongest = np.where(self.shares.any(axis=1), self.shares.argmax(axis=1), -1)
        own = dict(zip(self.nodes.tolist(), strongest.tolist(), strict=True))
        found = np.full(len(character.document.gltf["nodes"]), -1)
        for node, parent in tree(character.document):
            found[node] = own.get(node, -1 if parent is None else found[parent])
        return found


def rig_bones(character: Character, limbs: Sequence[Limb]) -> RigBones:
    """Find which bones the joints of a file's skeleton follow.

    1. A limb's first joint is where its first point is, or the first joint on its first bone.
    2. From there a line of joints leads to the limb's end. A joint of the line turns as the bone between it and the
       next joint; where that is several bones, with the shares of their lengths. The trunk's line leads from the top
       of the skeleton to the joint on which head, neck or arms hang.
    3. Another joint that hangs on a line turns as the bone beside it; what hangs on such a joint turns with it.
    4. A target of inverse kinematics hangs on the top of the skeleton or on nothing, and lies on a limb beyond its
       first bone; it follows that. Meshes without a joint follow the bone nearest to their middle.

    Parameters
    ----------
    character : Character
    limbs : sequence of Limb
        Mesh file's coordinates.

    Returns
    -------
    RigBones
        Without joints where the file has no skeleton.
    """
    return _Sorting(_Skeleton.of(character), limbs).result()


def require_joints(character: Character, limbs: Sequence[Limb], where: Path) -> None:
    """Refuse a puppet whose limbs say nothing to a skeleton in its character's file.

    Parameters
    ----------
    character : Character
    limbs : sequence of Limb
    where : Path
        The puppet file.

    Raises
    ------
    PuppetError
        No limbs, no skeleton, or none of the limbs on it.
    """
    if not limbs:
        raise PuppetError(
            at(where, field="[[limb]]"),
            found="no limb",
            expected="limbs along the skeleton of the character's file",
            fix="Use --as morph, or propose limbs: puppetline new MESH -o PUPPET.toml",
        )
    found = rig_bones(character, limbs)
    if not len(found.nodes):
        raise PuppetError(
            at(where, field="[character], mesh"),
            found="a file without a skeleton",
            expected="one with a skeleton, whose joints --as rig turns",
            fix="Use --as morph.",
        )
    others = [limb.name for limb in limbs if limb.name != TRUNK]
    if others and len(found.missing) == len(others):
        raise PuppetError(
            at(where, field="[[limb]], points"),
            found="no limb whose first point is at a joint of the file's skeleton",
            expected="points at the skeleton's joints",
            fix="Use --as morph, or propose limbs from the skeleton: puppetline new MESH -o PUPPET.toml",
        )


@dataclass(frozen=True, eq=False)
class _Skeleton:
    """Joints by row, parents before their children.

    Attributes
    ----------
    nodes, parents : (j,) list of int
    places : (j, 3) float64
        Of a loose node, the middle of what it shows.
    loose : dict
        Row to name.
    diagonal : float
    """

    nodes: list[int]
    parents: list[int]
    places: NDArray[np.float64]
    loose: dict[int, str]
    diagonal: float

    @classmethod
    def of(cls, character: Character) -> "_Skeleton":
        """Take the joints of all skins, or the nodes that lead to several meshes where nothing is skinned."""
        document, gltf = character.document, character.document.gltf
        walk = tree(document)
        above = {node: parent for node, parent in walk if parent is not None}
        middles = _middles(character)
        chosen = {joint for skin in gltf["skins"] for joint in skin["joints"]}
        if not chosen and len(middles) > 1:
            chosen = {other for node in middles for other in _way_up(node, above)}
        loose: set[int] = set()
        for node, _ in walk if chosen else ():
            hangs = not (chosen | loose).isdisjoint(_way_up(node, above))
            if node in middles and "skin" not in gltf["nodes"][node] and not hangs:
                loose.add(node)
        nodes = [node for node, _ in walk if node in chosen or node in loose]
        rows = {node: row for row, node in enumerate(nodes)}
        parents = [next((rows[other] for other in _way_up(node, above)[1:] if other in rows), -1) for node in nodes]
        places = world_transforms(document)[np.array(nodes, dtype=np.int64), :3, 3]
        for node in loose:
            places[rows[node]] = middles[node]
        names = {rows[node]: gltf["nodes"][node].get("name", f"node {node}") for node in sorted(loose)}
        return cls(nodes, parents, places, names, float(np.linalg.norm(np.ptp(character.vertices, axis=0))))

    def __len__(self) -> int:
        return len(self.nodes)

    @cached_property
    def ways_up(self) -> list[list[int]]:
        """Each joint and those above it, from itself to the top."""
        above = {row: parent for row, parent in enumerate(self.parents) if parent >= 0}
        return [_way_up(row, above) for row in range(len(self))]


def _way_up(node: int, above: dict[int, int]) -> list[int]:
    way = [node]
    while way[-1] in above:
        way.append(above[way[-1]])
    return way


def _middles(character: Character) -> dict[int, NDArray[np.float64]]:
    """Return the middle of what each node shows."""
    shown: dict[int, list[NDArray[np.float64]]] = {}
    for part in character.parts:
        shown.setdefault(part.node, []).append(part.vertices)
    whole = {node: np.concatenate(parts) for node, parts in shown.items()}
    return {node: (places.min(axis=0) + places.max(axis=0)) / 2 for node, places in whole.items()}


@dataclass(frozen=True, eq=False)
class _Polyline:
    """The bones of a limb, end to end.

    Attributes
    ----------
    limb : Limb
    bones : slice
        Numbers of its bones.
    near : float
        A place this near to a bone's head is at it, mesh units.
    """

    limb: Limb
    bones: slice
    near: float

    @cached_property
    def heads(self) -> NDArray[np.float64]:
        """(k,) float64: how far along the limb each of its points is."""
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.limb.points, axis=0), axis=1))])

    def nearest(self, place: NDArray[np.float64]) -> tuple[float, float]:
        """Return how far along the limb a place is, and how far away from it."""
        along, away = 0.0, np.inf
        for head, (start, end) in zip(self.heads, pairwise(self.limb.points), strict=False):
            way = end - start
            share = float(np.clip((place - start) @ way / (way @ way), 0, 1))
            distance = float(np.linalg.norm(place - start - share * way))
            if distance < away:
                along, away = head + share * float(np.linalg.norm(way)), distance
        at = self.heads[np.abs(self.heads - along).argmin()]
        return float(at if abs(at - along) <= self.near else along), away

    def bone_at(self, along: float) -> int:
        """Return the number of the bone at a place; of two that meet there, the second."""
        last = self.bones.stop - self.bones.start - 1
        return self.bones.start + min(int(np.searchsorted(self.heads, along, "right")) - 1, last)

    def overlaps(self, start: float, end: float) -> NDArray[np.float64]:
        """Return the length of each bone between two places along the limb."""
        return np.maximum(np.minimum(self.heads[1:], end) - np.maximum(self.heads[:-1], start), 0.0)


class _Sorting:
    """Gives each joint of a skeleton its bones."""

    def __init__(self, skeleton: _Skeleton, limbs: Sequence[Limb]) -> None:
        self.skeleton = skeleton
        self.bones = bones_of(limbs)
        self.polylines: dict[str, _Polyline] = {}
        for limb in parents_first(limbs):
            start = sum(len(line.limb.points) - 1 for line in self.polylines.values())
            bones = slice(start, start + len(limb.points) - 1)
            self.polylines[limb.name] = _Polyline(limb, bones, HEAD_TOLERANCE * skeleton.diagonal)
        self.trunk = self.polylines.get(TRUNK)
        self.firsts = self._first_joints()
        self.limb_of = [next((self.firsts[row] for row in way if row in self.firsts), None) for way in skeleton.ways_up]
        self.shares = np.zeros((len(skeleton), len(self.bones)))
        self.stretches: dict[int, tuple[_Polyline, float, float]] = {}  # of joints of lines: from where to where

    def result(self) -> RigBones:
        """Sort all joints."""
        for first, name in self.firsts.items():
            below = (row for row, way in enumerate(self.skeleton.ways_up) if first in way)
            members = [row for row in below if self.limb_of[row] == name]
            line = self.polylines[name]
            end = min(members, key=lambda row: self._away(row, line.limb.points[-1]))
            way = self.skeleton.ways_up[end]
            self._lead(line, way[way.index(first) :: -1])
        for way in self._trunk_lines():
            self._lead(self.trunk, way)
        for row in range(len(self.skeleton)):
            if row not in self.stretches:
                self.shares[row] = self._beside(row)
        parents = np.array(self.skeleton.parents, dtype=np.int64)
        return RigBones(
            nodes=np.array(self.skeleton.nodes, dtype=np.int64),
            parents=parents,
            shares=self.shares,
            placed=np.array([parent < 0 or not self._joined(row, parent) for row, parent in enumerate(parents)]),
            missing=tuple(name for name in self.polylines if name != TRUNK and name not in self.firsts.values()),
            loose=tuple(self.skeleton.loose.values()),
        )

    def _first_joints(self) -> dict[int, str]:
        """Return the first joint of each limb, in each tree of joints, with the limb's name.

        The trunk has none: its first point is between the legs.
        """
        found: dict[int, str] = {}
        limbs = [line for name, line in self.polylines.items() if name != TRUNK]
        tops = [row for row, parent in enumerate(self.skeleton.parents) if parent < 0]
        tops = [row for row in tops if row not in self.skeleton.loose]
        for strict in (True, False):
            for top in tops:
                for line in limbs:
                    there = any(name == line.limb.name and self._top(row) == top for row, name in found.items())
                    candidates = [] if there else list(self._candidates(line, top, strict))
                    candidates = [row for row in candidates if row not in found and self._fits(row, line, found)]
                    if candidates:
                        best = min(candidates, key=lambda row: self._misfit(row, line))
                        found[best] = line.limb.name
            found = {
                row: name
                for row, name in found.items()
                if self._fits(row, self.polylines[name], {other: n for other, n in found.items() if other != row})
            }
        return found

    def _top(self, row: int) -> int:
        return self.skeleton.ways_up[row][-1]

    def _candidates(self, line: _Polyline, top: int, strict: bool) -> Iterator[int]:
        """Yield the joints of a tree that are at a limb's first point, or else on its first bone."""
        allowed = MAX_LIMB_DISTANCE * self.skeleton.diagonal
        for row, place in enumerate(self.skeleton.places):
            if self._top(row) == top:
                along, away = line.nearest(place)
                at_first = bool(np.linalg.norm(place - line.limb.points[0]) <= allowed)
                if at_first if strict else away <= allowed and 0 < along < line.heads[1]:
                    yield row

    def _misfit(self, row: int, line: _Polyline) -> tuple[float, int]:
        """Return how badly a joint begins a limb, and of two at one place, first the one below the other."""
        below = [other for other, way in enumerate(self.skeleton.ways_up) if row in way]
        start, following = line.limb.points[:2]
        away = float(np.linalg.norm(self.skeleton.places[row] - start))
        away += float(np.linalg.norm(self.skeleton.places[below] - following, axis=1).min())
        return round(away / line.near), -len(self.skeleton.ways_up[row])

    def _fits(self, row: int, line: _Polyline, found: dict[int, str]) -> bool:
        """Tell whether no other limb's joint hangs on a joint, other than of limbs that hang on this limb."""
        for other, name in found.items():
            if row in self.skeleton.ways_up[other][1:] and not self._hangs_on(self.polylines[name], line):
                return False
        return True

    def _hangs_on(self, line: _Polyline, other: _Polyline) -> bool:
        """Tell whether a limb hangs on another: the puppet says so, or it begins where the other ends."""
        limb: Limb | None = line.limb
        while limb is not None and limb.parent is not None:
            if limb.parent == other.limb.name:
                return True
            limb = self.polylines[limb.parent].limb
        return bool(
            np.linalg.norm(line.limb.points[0] - other.limb.points[-1]) <= MAX_LIMB_DISTANCE * self.skeleton.diagonal
        )

    def _trunk_lines(self) -> Iterator[list[int]]:
        """Yield for each tree the joints from its top to the one on which head, neck or arms hang."""
        if self.trunk is None:
            return
        end = self.trunk.limb.points[-1]
        for top in dict.fromkeys(self._top(row) for row in self.firsts):
            firsts = [row for row in self.firsts if self._top(row) == top]
            upper = [row for row in firsts if self._hangs_on_bone(row) == self.trunk.bones.stop - 1]
            upper = [self.skeleton.parents[row] for row in sorted(upper, key=lambda row: self._away(row, end))]
            upper = [row for row in upper if row >= 0 and self.limb_of[row] is None]
            members = [row for row, limb in enumerate(self.limb_of) if limb is None and self._top(row) == top]
            if members:
                last = upper[0] if upper else min(members, key=lambda row: self._away(row, end))
                yield self.skeleton.ways_up[last][::-1]

    def _hangs_on_bone(self, first: int) -> int:
        return int(self.bones.parents[self.polylines[self.firsts[first]].bones.start])

    def _away(self, row: int, place: NDArray[np.float64]) -> float:
        return float(np.linalg.norm(self.skeleton.places[row] - place))

    def _lead(self, line: _Polyline | None, way: Sequence[int]) -> None:
        """Give the joints that lead along a limb their bones."""
        if line is None:
            return
        along = np.array([line.nearest(self.skeleton.places[row])[0] for row in way])
        along = np.minimum.accumulate(along[::-1])[::-1]  # a joint that lies beyond the next one
        for number, (row, start) in enumerate(zip(way, along, strict=True)):
            last = number == len(way) - 1
            end = float(line.heads[-1] if last else along[number + 1])
            lengths = line.overlaps(start, end)
            if not lengths.any() or (last and line is not self.trunk):
                self.shares[row, line.bone_at(start)] = 1
            elif last:  # it holds all the rest of the trunk: what is most of that
                self.shares[row, line.bones.start + int(lengths.argmax())] = 1
            else:
                self.shares[row, line.bones] = lengths / lengths.sum()
            self.stretches[row] = line, float(start), end

    def _beside(self, row: int) -> NDArray[np.float64]:
        """Return the shares (b,) of a joint that is not in a line."""
        parent, place = self.skeleton.parents[row], self.skeleton.places[row]
        if row in self.skeleton.loose:
            line = min(self.polylines.values(), key=lambda line: line.nearest(place)[1])
            return self._only(line.bone_at(line.nearest(place)[0]))
        if self.limb_of[row] is None and (parent < 0 or self.skeleton.parents[parent] < 0):
            target = self._target(place)
            if target is not None:
                return self._only(target)
        if parent < 0:
            return self._only(None if self.trunk is None else self.trunk.bones.start)
        if parent in self.stretches:
            line, start, end = self.stretches[parent]
            along, _ = line.nearest(place)
            if start <= along <= end:
                return self._only(line.bone_at(along))
        return self.shares[parent]

    def _target(self, place: NDArray[np.float64]) -> int | None:
        """Return the bone on which a target of inverse kinematics lies: not a limb's first one."""
        found = []
        for name, line in self.polylines.items():
            along, away = line.nearest(place)
            if name != TRUNK and away <= MAX_TARGET_DISTANCE * self.skeleton.diagonal and along >= line.heads[1]:
                found.append((away, line.bone_at(along)))
        return min(found)[1] if found else None

    def _only(self, bone: int | None) -> NDArray[np.float64]:
        shares = np.zeros(len(self.bones))
        if bone is not None:
            shares[bone] = 1
        return shares

    def _joined(self, row: int, parent: int) -> bool:
        """Tell whether a joint's bones are those of the joint above it, or hang together with them."""
        own, above = (set(np.flatnonzero(self.shares[each]).tolist()) for each in (row, parent))
        if not above:
            return all(self.bones.parents[bone] < 0 for bone in own)
        return bool(
            own & above
            or {int(self.bones.parents[bone]) for bone in own} & above
            or {int(self.bones.parents[bone]) for bone in above} & own
        )
