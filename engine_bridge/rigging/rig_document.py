"""Documents of rigged characters: nodes of joints, and meshes bound to them by skin weights."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import TRIANGLES, CharacterMesh
from engine_bridge.character.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Document
from engine_bridge.character.scene import own_mesh, show_all, world_transforms
from engine_bridge.character.scene import skinning as carried_by_skin
from engine_bridge.character.schema import Animation, ChannelTarget, Gltf, Node, Primitive
from engine_bridge.rigging.made_rig import MadeRig
from engine_bridge.rigging.skeleton import Skeleton
from solver.skinning.weights import Weights

MIN_LENGTH = 1e-30
"""Minimum length of a transformed normal or tangent that has a direction."""

UP = (0.0, 1.0, 0.0)
"""Normal or tangent without a direction."""

TRANSFORMS = ("translation", "rotation", "scale")
PLACE_KEYS = (*TRANSFORMS, "matrix", "children", "camera")
"""Keys that stay with a new node in its place when the node of a mesh moves to the top of the scene."""

SKELETON = "skeleton"
"""Name of the node above all joints, which Blender shows as the armature."""

INFLUENCES_PER_SET = 4
"""Number of joints per vertex in one set of attributes (glTF 2.0, section 3.7.3.3)."""


def rigged_document(
    character: CharacterMesh, made: MadeRig, follows: NDArray[np.int64], placed: NDArray[np.float64] | None = None
) -> tuple[Document, list[int], tuple[str, ...]]:
    """Bind the meshes of a copy of a character's document to new joints.

    A skinned mesh ignores its parent nodes (glTF 2.0, section 3.7.3.3). Its vertices are therefore converted to world
    coordinates, and its node is moved to the top of the scene. Points and lines are bound to the first joint. The
    character's own skeleton is replaced, and animations that move the character's nodes or skeleton are omitted.

    Parameters
    ----------
    character : CharacterMesh
    made : MadeRig
    follows : (N,) int64
        Solver vertex of each vertex of all parts, one part after another.
    placed : (4, 4) float64, optional
        Rotation, even scale and translation of the whole character, for column vectors.

    Returns
    -------
    document : Document
    nodes : list of int
        Node of each joint.
    notes : tuple of str
        Sentences about what was replaced or omitted.
    """
    document = character.document.copy()
    gltf = document.gltf
    show_all(gltf)
    shown = list(dict.fromkeys(part.node for part in character.parts))
    notes = _drop_animations(gltf, shown)
    everywhere = np.eye(4) if placed is None else placed
    of_vertices = everywhere[None] if made.bind is None else everywhere @ made.bind.transforms[follows]
    _convert_to_world(document, character, shown, everywhere, of_vertices)
    skin, joints = _add_skeleton(document, _placed(made.skeleton, everywhere))
    bound = {
        (part.node, part.primitive): follows[place]
        for part, place in zip(character.parts, character.vertex_slices, strict=True)
    }
    for node in shown:
        for index, primitive in enumerate(gltf["meshes"][gltf["nodes"][node]["mesh"]]["primitives"]):
            _bind(document, primitive, made.weights, bound.get((node, index)))
        _move_to_top(gltf, node)
        gltf["nodes"][node]["skin"] = skin
    _drop_unused_skins(gltf)
    return document, joints, notes


def _drop_animations(gltf: Gltf, nodes: list[int]) -> tuple[str, ...]:
    """Remove the animations that move the nodes, their ancestors or their skeletons; return notes."""
    above = {child: parent for parent, node in enumerate(gltf["nodes"]) for child in node.get("children", [])}
    skins = {gltf["nodes"][node]["skin"] for node in nodes if "skin" in gltf["nodes"][node]}
    placing: set[int] = set()
    for node in (*nodes, *(joint for skin in skins for joint in gltf["skins"][skin]["joints"])):
        way: int | None = node
        while way is not None and way not in placing:
            placing.add(way)
            way = above.get(way)

    moving = {f"/nodes/{node}/{transform}" for node in placing for transform in TRANSFORMS}

    def moves_it(animation: Animation) -> bool:
        return any(_pointer(channel["target"]) in moving for channel in animation["channels"])

    dropped = [animation for animation in gltf["animations"] if moves_it(animation)]
    gltf["animations"] = [animation for animation in gltf["animations"] if animation not in dropped]
    notes = ["The character's own skeleton is replaced."] if skins else []
    if dropped:
        notes.append(f"Omitted {len(dropped)} of the file's animations, which moved the character's nodes or skeleton.")
    return tuple(notes)


def _pointer(target: ChannelTarget) -> str:
    """Return the JSON pointer to a channel's property, as in KHR_animation_pointer."""
    if target["path"] != "pointer":
        return f"/nodes/{target.get('node')}/{target['path']}"
    found: Any = target
    for name in ("extensions", "KHR_animation_pointer", "pointer"):
        found = found.get(name) if isinstance(found, dict) else None
    return str(found)


def _placed(skeleton: Skeleton, transform: NDArray[np.float64]) -> Skeleton:
    """Return a skeleton after a rotation, even scale and translation."""

    def moved(point: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(transform[:3, :3] @ point + transform[:3, 3])

    joints = [replace(joint, head=moved(joint.head), tail=moved(joint.tail)) for joint in skeleton.joints]
    turn = transform[:3, :3] / np.cbrt(np.linalg.det(transform[:3, :3]))
    return replace(skeleton, joints=tuple(joints), axes=turn @ skeleton.axes)


def _convert_to_world(
    document: Document,
    character: CharacterMesh,
    nodes: Iterable[int],
    everywhere: NDArray[np.float64],
    of_vertices: NDArray[np.float64],
) -> None:
    """Convert the vertices of some nodes' meshes to world coordinates, with nodes and skins at rest.

    Parameters
    ----------
    document : Document
    character : CharacterMesh
    nodes : iterable of int
    everywhere : (4, 4) float64
        Transform of points and lines, from the world.
    of_vertices : (1 or N, 4, 4) float64
        Transform of the vertices of all parts, from the world.
    """
    gltf = document.gltf
    world = world_transforms(document)
    places = zip(character.parts, character.vertex_slices, strict=True)
    parts = {(part.node, part.primitive): (part, place) for part, place in places}
    shown = Counter(node.get("mesh") for node in gltf["nodes"])
    for node in nodes:
        for index, primitive in enumerate(own_mesh(document, node, shown)["primitives"]):
            part, place = parts.get((node, index), (None, slice(None)))
            if part is None:
                to_world = everywhere @ _to_world(document, node, primitive, world)
            else:
                to_world = (of_vertices if len(of_vertices) == 1 else of_vertices[place]) @ part.to_world
            if np.array_equal(to_world, np.eye(4)[None]):
                continue
            _transform(document, primitive, to_world)
            if part is not None and np.linalg.det(to_world[:, :3, :3]).mean() < 0:  # a mirror flipped the triangles
                corners = part.triangles.astype(np.uint32).ravel()
                primitive["indices"], primitive["mode"] = document.add(corners, ELEMENT_ARRAY_BUFFER), TRIANGLES


def _to_world(document: Document, node: int, primitive: Primitive, world: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the transforms (1 or n, 4, 4) of points and lines; a skin does not move those without joints."""
    shown = document.gltf["nodes"][node]
    if "skin" not in shown or not {"POSITION", "JOINTS_0"} <= primitive["attributes"].keys():
        return world[None, node]
    return carried_by_skin(document, primitive, shown["skin"], _count(document, primitive), world)


def _count(document: Document, primitive: Primitive) -> int:
    return document.gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]


def _transform(document: Document, primitive: Primitive, to_world: NDArray[np.float64]) -> None:
    """Transform positions, normals and tangents of a primitive and of its own morph targets."""
    if "POSITION" not in primitive["attributes"]:
        return
    count = _count(document, primitive)
    linear = to_world[:, :3, :3]
    matrices = {"POSITION": linear, "NORMAL": np.linalg.pinv(linear).swapaxes(1, 2), "TANGENT": linear}
    flipped = np.where(np.linalg.det(linear) < 0, -1.0, 1.0)
    lengths: dict[str, NDArray[np.float64]] = {}
    for name, matrix in matrices.items():
        base = document.attribute(primitive, name, count, 3, 4)
        if base is None:
            continue
        turned = (matrix @ base[:, :3, None].astype(np.float64))[:, :, 0]
        if name == "POSITION":
            turned += to_world[:, :3, 3]
        else:
            turned[np.linalg.norm(turned, axis=1) < MIN_LENGTH] = UP  # of a part that is scaled to zero
            lengths[name] = np.linalg.norm(turned, axis=1, keepdims=True)
            turned /= lengths[name]
        if name == "TANGENT":
            turned = np.column_stack([turned, base[:, 3] * flipped])
        primitive["attributes"][name] = _add_vertices(document, turned, name)
    for target in primitive.get("targets", []):
        for name, matrix in matrices.items():
            moved = document.attribute({"attributes": target}, name, count, 3)
            if moved is not None:
                turned = (matrix @ moved[:, :, None].astype(np.float64))[:, :, 0] / lengths.get(name, 1.0)
                target[name] = _add_vertices(document, turned, name)


def _add_vertices(document: Document, values: NDArray[np.floating], name: str) -> int:
    return document.add(values.astype(np.float32), ARRAY_BUFFER, bounds=name == "POSITION")


def _add_skeleton(document: Document, skeleton: Skeleton) -> tuple[int, list[int]]:
    """Add a node for the skeleton, with the joints below it; return the skin and the nodes of the joints."""
    gltf = document.gltf
    top = len(gltf["nodes"])
    nodes = [top + 1 + row for row in range(len(skeleton.joints))]
    positions, rotations = skeleton.rest
    gltf["nodes"].append({"name": SKELETON, "children": []})
    for joint, place, turn in zip(skeleton.joints, positions.tolist(), rotations.tolist(), strict=True):
        gltf["nodes"].append({"name": joint.name, "translation": place, "rotation": turn})
        gltf["nodes"][top + 1 + joint.parent].setdefault("children", []).append(len(gltf["nodes"]) - 1)
    gltf["scenes"][gltf.get("scene", 0)].setdefault("nodes", []).append(top)
    bind = world_transforms(document)[nodes]
    back = np.linalg.inv(bind).transpose(0, 2, 1)  # matrices are stored by columns
    matrices = document.add(back.astype(np.float32).reshape(-1, 16))
    skin = {"name": SKELETON, "joints": nodes, "skeleton": top, "inverseBindMatrices": matrices}
    gltf["skins"].append(skin)  # type: ignore[arg-type]
    return len(gltf["skins"]) - 1, nodes


def _bind(document: Document, primitive: Primitive, weights: Weights, follows: NDArray[np.int64] | None) -> None:
    """Bind a primitive to the joints of its solver vertices, or without these to the first joint."""
    attributes = primitive["attributes"]
    for name in [name for name in attributes if name.startswith(("JOINTS_", "WEIGHTS_"))]:
        del attributes[name]
    if "POSITION" not in attributes:
        return
    if follows is None:
        shares = np.tile(np.eye(1, INFLUENCES_PER_SET, dtype=np.float32), (_count(document, primitive), 1))
        joints: NDArray[np.integer] = np.zeros(shares.shape, dtype=np.uint8)
    else:
        shares, wide = weights.weights[follows], weights.bones[follows]
        joints = wide.astype(np.uint8) if wide.max(initial=0) <= np.iinfo(np.uint8).max else wide
    for number in range(shares.shape[1] // INFLUENCES_PER_SET):
        chosen = slice(number * INFLUENCES_PER_SET, (number + 1) * INFLUENCES_PER_SET)
        attributes[f"JOINTS_{number}"] = document.add(joints[:, chosen], ARRAY_BUFFER)
        attributes[f"WEIGHTS_{number}"] = document.add(shares[:, chosen], ARRAY_BUFFER)


def _move_to_top(gltf: Gltf, node: int) -> None:
    """Move a node to the top of the scene without its transform; a new node in its place keeps its children."""
    table = gltf["nodes"][node]
    left: Node = {key: table.pop(key) for key in PLACE_KEYS if key in table}  # type: ignore[misc, assignment]
    tops = gltf["scenes"][gltf.get("scene", 0)]["nodes"]
    rows = [tops, *(other["children"] for other in gltf["nodes"] if "children" in other)]
    row = next((row for row in rows if node in row), tops)
    if "children" in left or "camera" in left:
        gltf["nodes"].append(left)
        row[row.index(node)] = len(gltf["nodes"]) - 1
        tops.append(node)
    elif row is not tops:
        row.remove(node)
        tops.append(node)
    for parent in gltf["nodes"]:
        if parent.get("children") == []:
            del parent["children"]


def _drop_unused_skins(gltf: Gltf) -> None:
    used = sorted({node["skin"] for node in gltf["nodes"] if "skin" in node})
    gltf["skins"] = [gltf["skins"][skin] for skin in used]
    for node in gltf["nodes"]:
        if "skin" in node:
            node["skin"] = used.index(node["skin"])
