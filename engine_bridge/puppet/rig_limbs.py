"""Limbs of a character from the skeleton in its file: from the names of its joints and their hierarchy."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from capture.bone_names import LEG_PARTS, QUARTERS, JointMeaning, joint_meanings
from engine_bridge.character.character import Character
from engine_bridge.character.document import Document
from engine_bridge.character.scene import influences, world_transforms
from engine_bridge.puppet.body_plans import is_leg
from engine_bridge.puppet.limb_nodes import node_labels
from engine_bridge.puppet.rig_axes import upward
from solver.anatomy.limb_chain import LimbChain, Limbs, evenly, leg_names

MIN_NECK_SHARE = 0.3
"""Minimum length of a neck that is a separate limb, as a share of the trunk's length."""

GIRDLE_COSINE = np.cos(np.pi / 4)
"""Cosine of the largest angle between the left-right direction and a bone that leads from the spine to a leg."""

LYING_COSINE = np.cos(np.radians(45))
"""Cosine of the angle between spine and up below which a body may be four-legged."""

MAX_HAND_HEIGHT_SHARE = 0.3
"""Maximum height of the ends of forelegs, as a share of the height of the shoulders."""

MIN_LEG_BONE_SHARE = 0.08
"""Minimum length of the bones of a leg below the third joint, as a share of the leg's length."""

SPINE_PARTS = ("hips", "spine", "chest", "upperChest", "trunk")

HEAD_PARTS = (None, "head", "ear", "eye", "jaw")
"""Parts below the head that count for its size; None for hair and the like."""

SHOULDER_PARTS = ("shoulder", "upperArm")
"""Parts by which an arm hangs on the spine."""

HAND_PARTS = ("hand", "palm")

MANY_PAIRS = 3
"""Number of pairs of legs from which they are rows."""

MIN_SPINE_JOINTS = 4
"""Minimum number of joints in a row without branches that is the spine of a body without legs, such as a fish."""

UP, FRONT = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
"""Directions in glTF."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a skeleton.

    Attributes
    ----------
    name : str
        As in the file, or its name in VRM's table.
    parent : int
        Index of the parent joint, −1 for none.
    place : (3,) float64
        Mesh file's coordinates.
    vertices : (n, 3) float64
        Vertices that follow this joint more than any other.
    label : str
        How puppet files call it.
    """

    name: str
    parent: int
    place: NDArray[np.float64]
    vertices: NDArray[np.float64]
    label: str = ""


@dataclass(frozen=True, eq=False)
class _Chain:
    """Points (k, 3) of a limb, and the joints on it, both root to tip; the trunk's are those above other limbs."""

    points: NDArray[np.float64]
    joints: Sequence[int] = ()


def rig_limbs(character: Character) -> Limbs | None:
    """Find a character's limbs by the joints of its file's skeleton.

    Parameters
    ----------
    character : Character

    Returns
    -------
    Limbs or None
        None if the file has no skeleton. No chains, but a note, if its joint names are unknown.
    """
    joints = _joints(character)
    limbs = limbs_of_joints(joints) if joints else None
    if limbs is not None and not limbs.chains and not character.document.gltf["skins"]:
        return None  # names of mesh parts need not mean anything
    return limbs


def limbs_of_joints(joints: Sequence[Joint]) -> Limbs:
    """Find the limbs of a skeleton.

    Known names are those of VRM, Mixamo, Rigify, Unreal, SMPL, ARKit, Motive, Character Creator, Advanced Skeleton,
    Quaternius and KayKit, and plain English ones, with a side in any spelling. Other joints within a limb (twists,
    controls) are skipped.

    Parameters
    ----------
    joints : sequence of Joint
    """
    skeleton = _Skeleton(joints)
    found = skeleton.rows_of_legs()
    lies, pairs = bool(found), leg_names(len(found) // 2)
    if not found:
        found = skeleton.arms_and_legs()
        lies = _is_four_legged(found)
        if lies:
            found = skeleton.arms_and_legs(every_bend=True)
        pairs = leg_names(2) if lies else ("leg", "arm")
    trunk = skeleton.trunk(found, pairs[0], pairs[-1])
    if trunk is None:  # the short ones might be anything
        found = {name: chain for name, chain in found.items() if len(chain.joints) > 1 + is_leg(name)}
    paired = any({f"left {pair}", f"right {pair}"} <= found.keys() for pair in pairs)
    limbs = {} if trunk is None else {"trunk": trunk}
    if not paired and (trunk is None or not skeleton.named(None, None, "tail")):
        limbs = skeleton.spine()
        if not limbs:
            some = ", ".join(dict.fromkeys(joint.name for joint in joints[:5]))
            note = f"The joint names in the skeleton are unknown ({some}, …); limbs are found from the shape."
            return Limbs((), (note,))
    limbs |= skeleton.head(trunk, lies or not paired)
    limbs |= skeleton.curved({"left ear": 2, "right ear": 2, "jaw": 1}, moving=True)
    for pair in reversed(pairs):
        limbs |= {f"{side} {pair}": found[f"{side} {pair}"] for side in ("left", "right") if f"{side} {pair}" in found}
    limbs |= skeleton.curved({"tail": 3, "left wing": 3, "right wing": 3})
    return Limbs(
        tuple(
            LimbChain(name, chain.points, tuple(joints[index].label for index in chain.joints))
            for name, chain in limbs.items()
        )
    )


class _Skeleton:
    """Joints with the meanings of their names."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self.joints = joints
        self.meanings = joint_meanings([joint.name for joint in joints], [len(joint.vertices) > 0 for joint in joints])
        self.children: list[list[int]] = [[] for _ in joints]
        for index, joint in enumerate(joints):
            if joint.parent >= 0:
                self.children[joint.parent].append(index)
        self.depth = [len(list(self.ancestors(index))) for index in range(len(joints))]
        self._forget_poles()
        self._rename_hips_and_heads()

    def _forget_poles(self) -> None:
        """Drop the meaning of a joint that moves nothing if another of this meaning does: an elbow may be a pole."""
        holding = [index for index, joint in enumerate(self.joints) if len(joint.vertices)]
        moving = {*holding, *(other for index in holding for other in self.ancestors(index))}
        known = {self.meanings[index] for index in moving}
        for index, meaning in enumerate(self.meanings):
            if index not in moving and meaning in known:
                self.meanings[index] = None

    def _rename_hips_and_heads(self) -> None:
        """Correct meanings that depend on other joints: of hips without thighs, and a spine up to the head."""
        for index, meaning in enumerate(self.meanings):
            below = {self.part(other) for other in self.below(index)} & {"upperLeg", "leg", "lowerLeg"}
            if meaning and meaning.side and meaning.part == "hips" and below == {"lowerLeg"}:
                self.meanings[index] = replace(meaning, part="upperLeg")
        sides = ("left", "right")
        shoulders = {self.joints[k].parent for side in sides for k in self.named(side, None, *SHOULDER_PARTS)}
        beyond = [index for index in self.named(None, None, *SPINE_PARTS) if shoulders & set(self.ancestors(index))]
        if beyond and not self.named(None, None, "head"):  # Rigify numbers the spine up to the head
            for index in beyond:
                self.meanings[index] = JointMeaning(None, None, "head" if index == beyond[-1] else "neck")

    def ancestors(self, index: int) -> Iterator[int]:
        while (index := self.joints[index].parent) >= 0:
            yield index

    def below(self, index: int) -> list[int]:
        """Return a joint and all of its descendants."""
        return [index, *(other for child in self.children[index] for other in self.below(child))]

    def place(self, index: int) -> NDArray[np.float64]:
        return self.joints[index].place

    def named(self, side: str | None, quarter: str | None, *parts: str) -> list[int]:
        """Return the joints of a side, quarter and parts, those near the root first."""
        wanted = [
            index
            for index, meaning in enumerate(self.meanings)
            if meaning and meaning.part in parts and (meaning.side, meaning.quarter) == (side, quarter)
        ]
        return sorted(wanted, key=lambda index: (self.depth[index], index))

    def arms_and_legs(self, every_bend: bool = False) -> dict[str, _Chain]:
        """Return arms and legs by their names.

        Legs of people have hip, knee, ankle and foot; with `every_bend` they have all the joints of the file, and arms
        are front legs.
        """
        found: dict[str, _Chain] = {}
        before, behind = ("front leg", "hind leg") if every_bend else ("arm", "leg")
        for side in ("left", "right"):
            arm, leg = self.arm(side), self.leg(side, None, every_bend)
            front, hind = (self.leg(side, quarter, every_bend) for quarter in ("front", "hind"))
            if front is not None and hind is None:  # only the front legs are marked as such
                leg, hind = None, leg
            limbs = ((before, arm), (behind, leg), (before, front), (behind, hind))
            found |= {f"{side} {name}": chain for name, chain in limbs if chain is not None}
        return found

    def arm(self, side: str) -> _Chain | None:
        upper, lower = self.named(side, None, "upperArm"), self.named(side, None, "lowerArm")
        if not upper:  # the shoulder, after the collar bone, may be the upper arm's only joint
            upper = [index for index in self.named(side, None, "shoulder") if set(self.below(index)) & set(lower)][-1:]
        lower = lower or [index for index in upper[1:] if upper[0] in self.ancestors(index)]  # numbered joints
        if not upper or not lower:
            return self.without_end(*upper[:1])
        hands = [index for index in self.below(lower[0]) if self.part(index) in HAND_PARTS and index != lower[0]]
        wrist = min(hands or self.children[lower[0]], key=lambda index: (self.depth[index], index), default=None)
        if wrist is None:
            return self.without_end(upper[0], lower[0])
        return self.with_end([upper[0], lower[0], wrist], self.below(wrist))

    def with_end(self, joints: Sequence[int], held: Sequence[int]) -> _Chain:
        """Return a limb from its joints to the end of the vertices of some joints."""
        points = [self.place(index) for index in joints]
        return _Chain(np.array([*points, self.end(points[-2:][0], points[-1], held)]), joints)

    def without_end(self, *joints: int) -> _Chain | None:
        """Return a limb of two joints, or of one and a bend in its middle; the last fifth is the hand or foot."""
        places = [self.place(index) for index in joints]
        tip = self.end(places[0], places[-1], self.below(joints[-1])) if joints else None
        if tip is None or (tip == places[0]).all():
            return None
        middle = places[1] if len(joints) > 1 else (places[0] + tip) / 2
        return _Chain(np.array([places[0], middle, middle + 0.8 * (tip - middle), tip]), joints)

    def rows_of_legs(self) -> dict[str, _Chain]:
        """Return all legs by their names; none if there are fewer than three pairs, or if the sides differ."""
        rows = [list(self.legs(side)) for side in ("left", "right")]
        several = len(self.named(None, None, "head")) >= max(MANY_PAIRS, len(rows[0]))  # bodies in one file
        if len(rows[0]) != len(rows[1]) or len(rows[0]) < MANY_PAIRS or several:
            return {}
        hips, tips = (np.array([[leg.points[end] for leg in legs] for legs in rows]) for end in (0, -1))
        front = np.cross((hips[0] - hips[1]).sum(axis=0), upward((hips - tips).sum(axis=(0, 1))))
        return {
            f"{side} {name}": legs[place]
            for side, legs, order in zip(("left", "right"), rows, np.argsort(tips @ front, axis=1), strict=True)
            for name, place in zip(leg_names(len(legs)), order, strict=True)
        }

    def legs(self, side: str) -> Iterator[_Chain]:
        """Yield all legs of a side, without a last bone that is a stub: the joint of a foot may be at its tip."""
        for quarter in (None, *dict.fromkeys(QUARTERS.values())):
            number = 0
            while (leg := self.leg(side, quarter, True, number)) is not None:
                lengths = np.linalg.norm(np.diff(leg.points, axis=0), axis=1)
                stub = len(lengths) > 3 and lengths[-1] < MIN_LEG_BONE_SHARE * lengths.sum()
                yield _Chain(np.delete(leg.points, -2, axis=0), leg.joints[:-1]) if stub else leg
                number += 1

    def leg(self, side: str, quarter: str | None, every_bend: bool, number: int | None = None) -> _Chain | None:
        """Return a leg; with a number, that one of the legs of a quarter, whose first bone may lead sideways."""
        named = self.named(side, quarter, "shoulder", *LEG_PARTS)
        tops = [index for index in named if not set(named) & set(self.ancestors(index))]
        upper = set(self.named(side, quarter, "upperLeg", "leg"))
        legs = [top for top in tops if upper & set(self.below(top)) and self.is_long(top)]
        if not legs[number or 0 :]:
            return None
        top = max(legs, key=lambda index: (len(set(named) & set(self.below(index))), -index))
        top = top if number is None else legs[number]
        chain = [top]
        for index in named:
            known = ("leg", "shoulder", "foot") if every_bend else ("leg", "shoulder")
            twice = self.part(index) not in known and self.part(index) in map(self.part, chain)
            if chain[-1] in self.ancestors(index) and not twice:
                chain.append(index)
        feet = [index for index in tops if index != top and (number is None or len(legs) == 1)]
        if feet and "foot" not in map(self.part, chain):  # a foot with inverse kinematics hangs on the root
            chain.append(feet[0])
        chain = [index for index in chain if self.part(index) != "toes"]
        across = self.across(quarter) if number is None else np.zeros(3)
        while len(chain) > 3 and abs(_unit(self.place(chain[1]) - self.place(chain[0])) @ across) > GIRDLE_COSINE:
            del chain[0]
        if self.part(chain[0]) == "shoulder":
            return None
        if len(chain) < 3:
            return self.without_end(*chain)
        last = 3 if every_bend and len(chain) > 3 else 2
        held = [below for index in chain[last:] for below in self.below(index)]
        return self.with_end(self.bends(chain) if every_bend else chain[:3], held)

    def is_long(self, top: int) -> bool:
        """Return whether a joint and those below it are not all at one place, as controls of a foot are."""
        held = np.vstack([each for k in self.below(top) for each in (self.place(k), self.joints[k].vertices)])
        return not np.allclose(held, self.place(top), rtol=0, atol=1e-5 * np.abs(held).max())

    def bends(self, joints: Sequence[int]) -> list[int]:
        """Return the joints of a leg without those that follow others closely, which are twists and controls."""
        size = sum(float(np.linalg.norm(self.place(after) - self.place(joint))) for joint, after in pairwise(joints))
        kept = [*joints[:3]]
        for index in joints[3:]:
            if np.linalg.norm(self.place(index) - self.place(kept[-1])) > MIN_LEG_BONE_SHARE * size:
                kept.append(index)
        return kept

    def across(self, quarter: str | None) -> NDArray[np.float64]:
        """Return the direction from right to left legs."""
        left, right = (
            [self.place(index) for index in self.named(side, quarter, *LEG_PARTS)] for side in ("left", "right")
        )
        return _unit(np.mean(left, axis=0) - np.mean(right, axis=0)) if left and right else np.zeros(3)

    def part(self, index: int) -> str | None:
        meaning = self.meanings[index]
        return meaning.part if meaning else None

    def end(self, before: NDArray[np.float64], root: NDArray[np.float64], held: Sequence[int]) -> NDArray[np.float64]:
        """Return the far end of the vertices of some joints, along their direction from a joint."""
        vertices = np.concatenate([self.joints[index].vertices for index in held])
        if not len(vertices):
            places = np.array([self.place(index) for index in held])
            far = places[np.linalg.norm(places - root, axis=1).argmax()]
            if np.linalg.norm(far - root) > 0:
                return far
            return root + 0.3 * (root - before)
        direction = _unit((vertices.min(axis=0) + vertices.max(axis=0)) / 2 - root)  # regardless of where details are
        reach = np.quantile((vertices - root) @ direction, 0.95)
        return np.asarray(root + max(float(reach), 0.0) * direction)

    def trunk(self, limbs: dict[str, _Chain], behind: str, before: str) -> _Chain | None:
        """Return the points of the trunk: the hips, its middle, and the root of the neck."""
        legs = [chain.points[0] for name, chain in limbs.items() if name.endswith(behind)]
        arms = [chain.points[0] for name, chain in limbs.items() if name.endswith(before)]
        spine = [self.place(index) for index in self.named(None, None, *SPINE_PARTS)]
        tails = self.named(None, None, "tail")
        if not (legs or tails) or not (arms or self.named(None, None, "neck", "head")):
            return None
        low = np.mean(legs, axis=0) if legs else self.place(tails[0])  # a snake's body leads on into its tail
        necks = self.named(None, None, "neck") or ([] if arms else self.named(None, None, "head"))
        high = self.place(necks[0]) if necks else np.mean(arms, axis=0)
        if not np.linalg.norm(high - low) > 0:  # names of mesh parts, without places
            return None
        middle = (low + high) / 2
        nearest = min(spine, key=lambda place: float(np.linalg.norm(place - middle)), default=middle)
        if np.linalg.norm(nearest - middle) > np.linalg.norm(high - low) / 4:
            nearest = middle
        return _Chain(np.array([low, nearest, high]))

    def spine(self) -> dict[str, _Chain]:
        """Return trunk and tail of a body whose only joints are a row from front to back; none for another body."""
        row = sorted(range(len(self.joints)), key=lambda index: self.depth[index])
        way = self.place(row[0]) - self.place(row[-1])
        branches = len({joint.parent for joint in self.joints}) < len(row)
        if branches or len(row) < MIN_SPINE_JOINTS or way @ FRONT <= LYING_COSINE * np.linalg.norm(way):
            return {}
        tail = self.with_end(row[1:], row[-1:])
        front = self.end(tail.points[1], tail.points[0], row[:1])
        return {"trunk": _Chain(np.array([tail.points[0], front])), "tail": tail}

    def head(self, trunk: _Chain | None, with_neck: bool) -> dict[str, _Chain]:
        """Return the head from the trunk's end, after a neck if that is long."""
        heads, necks = self.named(None, None, "head"), self.named(None, None, "neck")
        if not heads:
            return {}
        root = self.place(heads[0])
        start = self.place(necks[0]) if necks else root if trunk is None else trunk.points[-1]
        if necks and any(self.part(index) == "upperArm" for index in self.below(necks[0])):
            start, necks = root, []  # the neck carries the arms, as a trunk does
        tip = self.end(start, root, [index for index in self.below(heads[0]) if self.part(index) in HEAD_PARTS])
        length = None if trunk is None else trunk.points[-1] - trunk.points[0]
        if length is not None and (root - start) @ length < 0:
            start, necks = root, []  # it begins behind the front legs
        least = np.inf if length is None else MIN_NECK_SHARE * np.linalg.norm(length)
        if not with_neck or np.linalg.norm(root - start) < least:
            return {"head": _Chain(np.array([start, tip]), [*necks, heads[0]])}
        way = np.array([start, *(self.place(index) for index in necks[1:]), root])
        return {"neck": _Chain(evenly(way, 3), necks), "head": _Chain(np.array([root, tip]), heads[:1])}

    def curved(self, bones: dict[str, int], moving: bool = False) -> dict[str, _Chain]:
        """Return limbs by their names, with as many bones; only those that vertices follow, if they must be moving."""
        found = {}
        for name, count in bones.items():
            side, _, part = name.rpartition(" ")
            joints = self.named(side or None, None, part)
            if any(len(self.joints[index].vertices) or not moving for index in joints):
                row = [index for index in joints if index == joints[0] or joints[0] in self.ancestors(index)]
                chain = self.with_end(row, self.below(row[-1]))
                found[name] = replace(chain, points=evenly(chain.points, count + 1))
        return found


def _is_four_legged(limbs: dict[str, _Chain]) -> bool:
    """Return whether the arms are legs: they reach the ground, and the spine is not upright."""
    behind, before = ([limb.points for name, limb in limbs.items() if name.endswith(part)] for part in ("leg", "arm"))
    if not behind or not before:
        return False
    hips, shoulders = (np.mean([points[0] for points in limbs], axis=0) for limbs in (behind, before))
    soles, hands = (np.mean([points[-1] for points in limbs], axis=0) for limbs in (behind, before))
    upright = _unit(shoulders - hips) @ UP > LYING_COSINE
    return bool(not upright and (hands - soles) @ UP < MAX_HAND_HEIGHT_SHARE * ((shoulders - soles) @ UP))


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def _joints(character: Character) -> list[Joint]:
    """Return the joints of all skins; without skins, the named nodes of a character of several parts."""
    document, gltf = character.document, character.document.gltf
    nodes = sorted({joint for skin in gltf["skins"] for joint in skin["joints"]})
    if not nodes:
        nodes = [index for index, node in enumerate(gltf["nodes"]) if node.get("name")]
        if len(character.parts) < 2:
            return []
    vrm = _vrm_names(document)
    parents = {child: index for index, node in enumerate(gltf["nodes"]) for child in node.get("children", [])}
    number = {node: index for index, node in enumerate(nodes)}
    which, shares = vertex_influences(character)
    owners = np.take_along_axis(which, shares.argmax(axis=1)[:, None], axis=1)[:, 0]
    places, labels, vertices = world_transforms(document)[:, :3, 3], node_labels(document), character.vertices
    joints = []
    for node in nodes:
        above = parents.get(node)
        while above is not None and above not in number:
            above = parents.get(above)
        name = vrm.get(node) or gltf["nodes"][node].get("name", f"node {node}")
        parent = -1 if above is None else number[above]
        joints.append(Joint(name, parent, places[node], vertices[owners == node], labels[node]))
    return joints


def _vrm_names(document: Document) -> dict[int, str]:
    """Return the names of nodes in the humanoid table of VRM 0 or 1."""
    extensions = document.gltf.get("extensions", {})
    older = extensions.get("VRM", {}).get("humanoid", {}).get("humanBones", [])
    newer = extensions.get("VRMC_vrm", {}).get("humanoid", {}).get("humanBones", {})
    named = [(entry.get("bone"), entry.get("node")) for entry in older if isinstance(entry, dict)]
    named += [(bone, entry.get("node")) for bone, entry in newer.items() if isinstance(entry, dict)]
    return {node: bone for bone, node in named if isinstance(bone, str) and isinstance(node, int)}


def vertex_influences(character: Character) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the nodes that move each vertex: joints, or the node that shows it if it has no skin.

    Parameters
    ----------
    character : Character

    Returns
    -------
    nodes : (N, k) int64
    shares : (N, k) float64
        Share of each of these nodes in the vertex's motion.
    """
    gltf, found = character.document.gltf, []
    for part in character.parts:
        node, count = gltf["nodes"][part.node], len(part.vertices)
        if "skin" in node:
            which, share = influences(character.document, character.primitive(part), node["skin"], count)
            found.append((np.array(gltf["skins"][node["skin"]]["joints"])[which], share))
        else:
            found.append((np.full((count, 1), part.node), np.ones((count, 1))))
    width = max(which.shape[1] for which, _ in found)
    padded = [[np.pad(array, ((0, 0), (0, width - array.shape[1]))) for array in pair] for pair in found]
    return np.concatenate([which for which, _ in padded]), np.concatenate([share for _, share in padded])
