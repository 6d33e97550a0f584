"""The limbs of a character whose file has a skeleton: its joints by their names and by where they hang."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import Character
from engine_bridge.character.document import Document
from engine_bridge.character.scene import influences, world_transforms
from engine_bridge.puppet.puppet import Direction
from solver.anatomy.limb_chain import LimbChain, Limbs, evenly

SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}

WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")
"""A word in the name of a joint: `LeftForeArm`, `upper_arm.L`, `J_Bip_R_LowerLeg`."""

DECORATION = {
    "mixamorig",
    "def",
    "b",
    "c",
    "j",
    "cc",
    "base",
    "bip",
    "valve",
    "biped",
    "bn",
    "jnt",
    "joint",
    "bone",
    "bend",
}
"""Words that programs put before or after a joint's own name."""

CONTROLS = {
    "ik",
    "fk",
    "pole",
    "target",
    "ctrl",
    "control",
    "mch",
    "org",
    "twist",
    "roll",
    "heel",
    "end",
    "nub",
    "helper",
}
"""Words in the names of joints that steer others; such a joint counts where vertices follow it."""

PARTS = {
    "head": "head|skull",
    "neck": "neck",
    "spine": "spine|torso|abdomen|chest|upperchest|waist|ribcage|back|hips?|pelvis|body|spinelower|spineupper",
    "girdle": "clavicle|collar|collarbone|shoulder",
    "upper arm": "upperarm|uparm|arm|shldr",
    "lower arm": "lowerarm|lowarm|forearm|elbow",
    "hand": "hand|wrist|palm[a-z]?",
    "thigh": "upperleg|upleg|thigh|femur",
    "shin": "lowerleg|lowleg|calf|shin|knee",
    "leg": "leg|midleg",
    "foot": "foot|ankle|footback|paw|hoof",
    "toe": "toes?|toebase|ball",
    "tail": "tail",
    "wing": "wing|feather",
}
"""Part of the body by a joint's own name: side, digits and decoration taken off."""

PATTERNS = {part: re.compile(f"(?:{names})") for part, names in PARTS.items()}

QUARTERS = {"front": "front", "fore": "front", "back": "hind", "hind": "hind", "rear": "hind"}

LEG = ("thigh", "leg", "shin", "foot", "toe")

MIN_NECK_SHARE = 0.3
"""A neck of at least this share of the trunk's length is a limb of its own."""

GIRDLE_COSINE = np.cos(np.pi / 4)
"""A bone within 45° of the line from left to right only leads from the spine to a leg."""

LYING_COSINE = np.cos(np.radians(45))
"""Cosine between spine and up below which a body may be four-legged."""

MAX_HAND_HEIGHT_SHARE = 0.3
"""Forelegs end this near to the ground, as a share of the height of the shoulders."""

UP = np.array([0.0, 1.0, 0.0])
"""Up in glTF."""


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint of a skeleton.

    Attributes
    ----------
    name : str
        As in the file, or VRM's name for it.
    parent : int
        Index of the joint it hangs on, −1 for none.
    place : (3,) float64
        Mesh file's coordinates.
    vertices : (n, 3) float64
        Those that follow this joint more than any other.
    """

    name: str
    parent: int
    place: NDArray[np.float64]
    vertices: NDArray[np.float64]


@dataclass(frozen=True)
class _Meaning:
    """What a joint's name says."""

    side: str | None
    quarter: str | None
    part: str


def rig_limbs(character: Character, up: NDArray[np.float64] = UP) -> Limbs | None:
    """Find a character's limbs by the joints of its file's skeleton, as that stands.

    Parameters
    ----------
    character : Character
    up : (3,) float64
        Mesh file's coordinates.

    Returns
    -------
    Limbs or None
        None where the file has no skeleton. No chains where its names say nothing; a note says so.
    """
    joints = _joints(character)
    limbs = limbs_of_joints(joints, up) if joints else None
    if limbs is not None and not limbs.chains and not character.document.gltf["skins"]:
        return None  # names of parts, which need not say anything
    return limbs


def limbs_of_joints(joints: Sequence[Joint], up: NDArray[np.float64] = UP) -> Limbs:
    """Find the limbs of a skeleton.

    Names of VRM, Mixamo, Rigify, Unreal, Quaternius and KayKit and plain ones are known, with a side in any spelling.
    Joints between those of a limb (twists, controls) are passed over.

    Parameters
    ----------
    joints : sequence of Joint
    up : (3,) float64
    """
    skeleton = _Skeleton(joints)
    found = skeleton.arms_and_legs()
    four_legged = _lies(found, up)
    names = {"arm": "front leg", "leg": "hind leg"} if four_legged else {"front leg": "arm", "hind leg": "leg"}
    found = {_renamed(name, names): points for name, points in found.items()}
    behind, before = ("hind leg", "front leg") if four_legged else ("leg", "arm")
    if not any({f"left {pair}", f"right {pair}"} <= found.keys() for pair in (behind, before)):
        some = ", ".join(dict.fromkeys(joint.name for joint in joints[:5]))
        note = f"The names of the joints in its skeleton say too little ({some}, …): limbs are found from the shape."
        return Limbs((), (note,))
    trunk = skeleton.trunk(found, behind, before)
    limbs = {} if trunk is None else {"trunk": trunk}
    limbs |= skeleton.head(trunk, four_legged)
    for pair in (before, behind):
        limbs |= {f"{side} {pair}": found[f"{side} {pair}"] for side in ("left", "right") if f"{side} {pair}" in found}
    limbs |= skeleton.tail_and_wings()
    return Limbs(tuple(LimbChain(name, points) for name, points in limbs.items()))


def axes_of(limbs: Limbs) -> tuple[Direction, Direction] | None:
    """Return which way a skeleton with named limbs stands and faces: legs go down, left is on its left.

    Parameters
    ----------
    limbs : Limbs
        From a skeleton, whose names say which side is which.
    """
    points = limbs.points
    pairs = [
        (points[name], points[name.replace("left", "right")])
        for name in points
        if name.startswith("left") and name.endswith("leg") and name.replace("left", "right") in points
    ]
    if not pairs:
        return None
    left = np.sum([left[0] - right[0] for left, right in pairs], axis=0)
    up = np.sum([leg[0] - leg[2] for pair in pairs for leg in pair], axis=0)
    upwards = int(np.abs(up).argmax())
    forwards = np.cross(left, np.sign(up[upwards]) * np.eye(3)[upwards])
    frontwards = int(np.abs(forwards).argmax())
    return _direction(upwards, float(up[upwards])), _direction(frontwards, float(forwards[frontwards]))


def _direction(axis: int, sign: float) -> Direction:
    names: tuple[tuple[Direction, Direction], ...] = (("x", "-x"), ("y", "-y"), ("z", "-z"))
    return names[axis][sign < 0]


class _Skeleton:
    """Joints with what their names mean."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self.joints = joints
        self.meanings = [_meaning(joint) for joint in joints]
        self.children: list[list[int]] = [[] for _ in joints]
        for index, joint in enumerate(joints):
            if joint.parent >= 0:
                self.children[joint.parent].append(index)
        self.depth = [len(list(self.ancestors(index))) for index in range(len(joints))]

    def ancestors(self, index: int) -> Iterator[int]:
        while (index := self.joints[index].parent) >= 0:
            yield index

    def below(self, index: int) -> list[int]:
        """Return a joint and all that hang on it."""
        return [index, *(other for child in self.children[index] for other in self.below(child))]

    def place(self, index: int) -> NDArray[np.float64]:
        return self.joints[index].place

    def named(self, side: str | None, quarter: str | None, *parts: str) -> list[int]:
        """Return joints by what they mean, those near the root first."""
        wanted = [
            index
            for index, meaning in enumerate(self.meanings)
            if meaning and meaning.part in parts and (meaning.side, meaning.quarter) == (side, quarter)
        ]
        return sorted(wanted, key=lambda index: (self.depth[index], index))

    def arms_and_legs(self) -> dict[str, NDArray[np.float64]]:
        """Return arms and legs by the names that they have in the skeleton."""
        found: dict[str, NDArray[np.float64]] = {}
        for side in ("left", "right"):
            arm, leg = self.arm(side), self.leg(side, None)
            front, hind = self.leg(side, "front"), self.leg(side, "hind")
            if front is not None and hind is None:  # only the front ones are said to be that
                leg, hind = None, leg
            limbs = {"arm": arm, "leg": leg, "front leg": front, "hind leg": hind}
            found |= {f"{side} {name}": points for name, points in limbs.items() if points is not None}
        return found

    def arm(self, side: str) -> NDArray[np.float64] | None:
        upper, lower = self.named(side, None, "upper arm"), self.named(side, None, "lower arm")
        if not upper:  # what is called a shoulder may be all that there is
            upper = [index for index in self.named(side, None, "girdle") if set(self.below(index)) & set(lower)]
        if not upper or not lower:
            return None
        hands = [index for index in self.below(lower[0]) if self.meanings[index] and index != lower[0]]
        hands = [index for index in hands if self.meanings[index].part == "hand"]  # type: ignore[union-attr]
        wrist = min(hands or self.children[lower[0]], key=lambda index: (self.depth[index], index), default=None)
        chain = [self.place(upper[0]), self.place(lower[0])]
        if wrist is None:
            held = self.end(chain[0], chain[1], [lower[0]])
            chain += [chain[1] + 0.8 * (held - chain[1]), held]
        else:
            chain += [self.place(wrist), self.end(chain[1], self.place(wrist), self.below(wrist))]
        return np.array(chain)

    def leg(self, side: str, quarter: str | None) -> NDArray[np.float64] | None:
        named = self.named(side, quarter, "girdle", *LEG)
        tops = [index for index in named if not set(named) & set(self.ancestors(index))]
        legs = [top for top in tops if set(self.below(top)) & set(self.named(side, quarter, "thigh", "leg"))]
        if not legs:
            return None
        top = max(legs, key=lambda index: (len(set(named) & set(self.below(index))), -index))
        chain = [top]
        for index in named:
            twice = self.part(index) not in ("leg", "girdle") and self.part(index) in map(self.part, chain)
            if chain[-1] in self.ancestors(index) and not twice:
                chain.append(index)
        feet = [index for index in tops if index != top]
        if feet and "foot" not in map(self.part, chain):  # moved by inverse kinematics, it hangs on the root
            chain.append(feet[0])
        chain = [index for index in chain if self.part(index) != "toe"]
        across = self.across(quarter)
        while len(chain) > 3 and abs(_unit(self.place(chain[1]) - self.place(chain[0])) @ across) > GIRDLE_COSINE:
            del chain[0]
        if len(chain) < 3 or self.part(chain[0]) == "girdle":
            return None
        held = [below for index in chain[2:] for below in self.below(index)]
        points = [self.place(index) for index in chain[:3]]
        return np.array([*points, self.end(points[1], points[2], held)])

    def across(self, quarter: str | None) -> NDArray[np.float64]:
        """Return the direction from right to left legs."""
        left, right = ([self.place(index) for index in self.named(side, quarter, *LEG)] for side in ("left", "right"))
        return _unit(np.mean(left, axis=0) - np.mean(right, axis=0)) if left and right else np.zeros(3)

    def part(self, index: int) -> str | None:
        meaning = self.meanings[index]
        return meaning.part if meaning else None

    def end(self, before: NDArray[np.float64], root: NDArray[np.float64], held: Sequence[int]) -> NDArray[np.float64]:
        """Return the far end of what some joints hold, straight on from a joint."""
        vertices = np.concatenate([self.joints[index].vertices for index in held])
        if not len(vertices):
            places = np.array([self.place(index) for index in held])
            far = places[np.linalg.norm(places - root, axis=1).argmax()]
            if np.linalg.norm(far - root) > 0:
                return far
            return root + 0.3 * (root - before)
        direction = _unit((vertices.min(axis=0) + vertices.max(axis=0)) / 2 - root)  # no matter where details are
        reach = np.quantile((vertices - root) @ direction, 0.95)
        return np.asarray(root + max(float(reach), 0.0) * direction)

    def trunk(self, limbs: dict[str, NDArray[np.float64]], behind: str, before: str) -> NDArray[np.float64] | None:
        """Return the points of hips, middle and the root of the neck."""
        legs = [points[0] for name, points in limbs.items() if name.endswith(behind)]
        arms = [points[0] for name, points in limbs.items() if name.endswith(before)]
        if not legs or not (arms or self.named(None, None, "neck", "head")):
            return None
        low = np.mean(legs, axis=0)
        necks = self.named(None, None, "neck") or ([] if arms else self.named(None, None, "head"))
        high = self.place(necks[0]) if necks else np.mean(arms, axis=0)
        middle = (low + high) / 2
        spine = [self.place(index) for index in self.named(None, None, "spine")]
        nearest = min(spine, key=lambda place: float(np.linalg.norm(place - middle)), default=middle)
        if np.linalg.norm(nearest - middle) > np.linalg.norm(high - low) / 4:
            nearest = middle
        return np.array([low, nearest, high])

    def head(self, trunk: NDArray[np.float64] | None, four_legged: bool) -> dict[str, NDArray[np.float64]]:
        """Return the head from the trunk's end, with a neck between where that is long."""
        heads, necks = self.named(None, None, "head"), self.named(None, None, "neck")
        if not heads:
            return {}
        root = self.place(heads[0])
        start = self.place(necks[0]) if necks else root if trunk is None else trunk[-1]
        tip = self.end(start, root, [index for index in self.below(heads[0]) if self.part(index) in (None, "head")])
        if (
            trunk is None
            or not four_legged
            or np.linalg.norm(root - start) < MIN_NECK_SHARE * np.linalg.norm(trunk[-1] - trunk[0])
        ):
            return {"head": np.array([start, tip])}
        way = np.array([start, *(self.place(index) for index in necks[1:]), root])
        return {"neck": evenly(way, 3), "head": np.array([root, tip])}

    def tail_and_wings(self) -> dict[str, NDArray[np.float64]]:
        found = {}
        for name, side, part in (
            ("tail", None, "tail"),
            ("left wing", "left", "wing"),
            ("right wing", "right", "wing"),
        ):
            chain = self.named(side, None, part)
            if chain:
                way = [self.place(index) for index in chain if index == chain[0] or chain[0] in self.ancestors(index)]
                before = way[-2] if len(way) > 1 else way[-1]
                found[name] = evenly(np.array([*way, self.end(before, way[-1], self.below(chain[-1]))]), 4)
        return found


def _meaning(joint: Joint) -> _Meaning | None:
    """Read a joint's name."""
    words = [word.lower() for word in WORD.findall(joint.name.rsplit(":", 1)[-1])]
    sides = [SIDES[word] for word in words if word in SIDES]
    words = [word for word in words if word not in SIDES and word not in DECORATION]
    if not sides and words and words[0][0] in "lr" and _part("".join(words)) is None:  # DAZ: lShin
        sides, words[0] = [SIDES[words[0][0]]], words[0][1:]
    if CONTROLS & set(words) and not len(joint.vertices):
        return None
    name = "".join(word for word in words if word not in CONTROLS or word in ("twist", "roll"))
    part, quarter = _part(name), None
    for word, which in QUARTERS.items():
        rest = name.removeprefix(word)
        if rest != name and sides and part is None and _part(rest) in (*LEG, "girdle"):
            part, quarter = _part(rest), which
    return _Meaning(sides[0] if sides else None, quarter, part) if part else None


def _part(name: str) -> str | None:
    return next((part for part, pattern in PATTERNS.items() if pattern.fullmatch(name)), None)


def _renamed(name: str, names: dict[str, str]) -> str:
    side, limb = name.split(" ", 1)
    return f"{side} {names.get(limb, limb)}"


def _lies(limbs: dict[str, NDArray[np.float64]], up: NDArray[np.float64]) -> bool:
    """Return whether what could be arms are legs: they reach the ground, and the spine lies across them."""
    behind = [points for name, points in limbs.items() if name.endswith(("hind leg", "left leg", "right leg"))]
    before = [points for name, points in limbs.items() if name.endswith(("front leg", "arm"))]
    if not behind or not before:
        return False
    hips, shoulders = (np.mean([points[0] for points in limbs], axis=0) for limbs in (behind, before))
    soles, hands = (np.mean([points[-1] for points in limbs], axis=0) for limbs in (behind, before))
    upright = _unit(shoulders - hips) @ up > LYING_COSINE
    return bool(not upright and (hands - soles) @ up < MAX_HAND_HEIGHT_SHARE * ((shoulders - soles) @ up))


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vector / max(float(np.linalg.norm(vector)), 1e-12))


def _joints(character: Character) -> list[Joint]:
    """Return the joints of all skins, or the nodes that carry meshes where nothing is skinned."""
    document = character.document
    gltf = document.gltf
    nodes = sorted({joint for skin in gltf["skins"] for joint in skin["joints"]})
    if not nodes:
        nodes = [index for index, node in enumerate(gltf["nodes"]) if node.get("name")]
        if len(character.parts) < 2:
            return []
    vrm = _vrm_names(document)
    parents = {child: index for index, node in enumerate(gltf["nodes"]) for child in node.get("children", [])}
    number = {node: index for index, node in enumerate(nodes)}
    owners, places = _most_followed(character), world_transforms(document)[:, :3, 3]
    vertices = character.vertices
    joints = []
    for node in nodes:
        above = parents.get(node)
        while above is not None and above not in number:
            above = parents.get(above)
        name = vrm.get(node) or gltf["nodes"][node].get("name", f"node {node}")
        joints.append(Joint(name, -1 if above is None else number[above], places[node], vertices[owners == node]))
    return joints


def _vrm_names(document: Document) -> dict[int, str]:
    """Return VRM's names of the nodes of a humanoid, of version 0 or 1."""
    extensions = document.gltf.get("extensions", {})
    older = extensions.get("VRM", {}).get("humanoid", {}).get("humanBones", [])
    newer = extensions.get("VRMC_vrm", {}).get("humanoid", {}).get("humanBones", {})
    named = [(entry.get("bone"), entry.get("node")) for entry in older if isinstance(entry, dict)]
    named += [(bone, entry.get("node")) for bone, entry in newer.items() if isinstance(entry, dict)]
    return {node: bone for bone, node in named if isinstance(bone, str) and isinstance(node, int)}


def vertex_influences(character: Character) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return what moves each vertex: joints, or the node that shows it where it has no skin.

    Parameters
    ----------
    character : Character

    Returns
    -------
    nodes : (N, k) int64
    shares : (N, k) float64
        How much the vertex follows each of these nodes.
    """
    gltf, found = character.document.gltf, []
    for part in character.parts:
        node, count = gltf["nodes"][part.node], len(part.vertices)
        if "skin" in node:
            primitive = gltf["meshes"][node["mesh"]]["primitives"][part.primitive]
            which, share = influences(character.document, primitive, node["skin"], count)
            found.append((np.array(gltf["skins"][node["skin"]]["joints"])[which], share))
        else:
            found.append((np.full((count, 1), part.node), np.ones((count, 1))))
    width = max(which.shape[1] for which, _ in found)
    padded = [[np.pad(array, ((0, 0), (0, width - array.shape[1]))) for array in pair] for pair in found]
    return np.concatenate([which for which, _ in padded]), np.concatenate([share for _, share in padded])


def _most_followed(character: Character) -> NDArray[np.int64]:
    """Return the node (N,) that each vertex follows most."""
    nodes, shares = vertex_influences(character)
    return np.asarray(nodes[np.arange(len(nodes)), shares.argmax(axis=1)])
