"""Animated glTF documents: morph targets, their weights over time, and the root's translation."""

from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh, Part, rest_weights
from engine_bridge.character.document import ARRAY_BUFFER, Document
from engine_bridge.character.gltf_file import damaged
from engine_bridge.character.own_targets import weights_over_time
from engine_bridge.character.scene import own_mesh, show_all
from engine_bridge.character.schema import Animation, Mesh, Node, Primitive
from engine_bridge.character.surfaces.surface import MAX_COORDINATE
from puppetline.errors import at


@dataclass(frozen=True)
class Keyframes:
    """Keyframes of an animation.

    Attributes
    ----------
    name : str
        Name of the animation.
    times : (F,) float32
        Times in seconds, from 0.
    weights : (F, K) float32
        Weights of the morph targets.
    root : (F, 3) float32 or None
        Translation of the whole character, mesh file's coordinates.
    own : dict of str to (F,) float32
        Weights of morph targets that the file has, by name.
    """

    name: str
    times: NDArray[np.float32]
    weights: NDArray[np.float32]
    root: NDArray[np.float32] | None
    own: dict[str, NDArray[np.float32]] = field(default_factory=dict)


@dataclass(frozen=True)
class ExportResult:
    """Numbers about an exported clip, see `engine_bridge.export.convert.Summary`."""

    error: float
    rms: float | None = None
    targets: int = 0
    bones: int = 0
    following: int = 0
    keyframes: int | None = None
    notes: tuple[str, ...] = ()


Displacements = Callable[[int], tuple[NDArray[np.float32], NDArray[np.float32] | None]]
"""Returns the displacements (K, n, 3) of a part's positions and of its normals or None; world coordinates.

Its argument is the number of the part.
"""


def animate(character: CharacterMesh, keyframes: Keyframes, displacements: Displacements) -> Document:
    """Add an animation of morph targets to a copy of a character's document.

    Each node that shows a part of the character gets morph targets and an animation of their weights. The root's motion
    is the translation of a new node above the scene. All contents of the document stay. A skeleton does not move in the
    new animation, whose morph targets apply before the skin. The file's own animations still move it.

    Parameters
    ----------
    character : CharacterMesh
    keyframes : Keyframes
    displacements : callable
        Called for one part at a time, to save memory.

    Returns
    -------
    Document
        Document with the animation.
    """
    document = character.document.copy()
    gltf = document.gltf
    show_all(gltf)
    animation: Animation = {"name": keyframes.name, "channels": [], "samplers": []}
    clock = document.add(keyframes.times, bounds=True)
    numbered: dict[int, list[tuple[int, Part]]] = {}
    for number, part in enumerate(character.parts):
        numbered.setdefault(part.node, []).append((number, part))
    shown = Counter(node.get("mesh") for node in gltf["nodes"])
    for node, parts in numbered.items():
        mesh = own_mesh(document, node, shown)
        before = rest_weights(gltf["nodes"][node], mesh)
        for number, part in parts:
            _add_targets(document, mesh["primitives"][part.primitive], part, *displacements(number))
        _pad_targets(document, mesh, len(before) + keyframes.weights.shape[1])
        if keyframes.weights.shape[1]:
            _widen_animations(document, node, len(before), keyframes.weights.shape[1])
            held = weights_over_time(mesh, before, keyframes.own, len(keyframes.times))
            weights = np.hstack([held, keyframes.weights]).ravel()
            add_channel(document, animation, clock, weights, node, "weights")
            _describe_targets(gltf["nodes"][node], mesh, before, keyframes.weights.shape[1])
    if keyframes.root is not None:
        add_channel(
            document,
            animation,
            clock,
            keyframes.root,
            add_root(document, {part.node for part in character.still}),
            "translation",
        )
    if animation["channels"]:
        gltf["animations"].insert(0, animation)  # viewers play the first one
    return document


def _add_targets(
    document: Document,
    primitive: Primitive,
    part: Part,
    positions: NDArray[np.float32],
    normals: NDArray[np.float32] | None,
) -> None:
    """Append displacements (K, n, 3), which are in world coordinates, as targets of a part's primitive."""
    targets = primitive.setdefault("targets", [])
    linear = part.to_world[:, :3, :3]
    to_local, from_normals = _inverse(linear), linear.transpose(0, 2, 1).astype(np.float32)
    if part.normals is not None:
        # a node's scale changes the length of unit normals; displacements must scale with it
        turned = _turned(from_normals, part.normals.astype(np.float32))
        length = np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), np.float32(1e-30))
    for k, displacement in enumerate(positions):
        target = {"POSITION": document.add(_turned(to_local, displacement), ARRAY_BUFFER, bounds=True)}
        if normals is not None:
            target["NORMAL"] = document.add(_turned(from_normals, normals[k]) / length, ARRAY_BUFFER)
        targets.append(target)


def _inverse(linear: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the inverses of matrices (n, 3, 3), zero for singular ones."""
    inverse = np.linalg.pinv(linear)
    return np.where(np.abs(inverse).max(axis=(1, 2), keepdims=True) <= MAX_COORDINATE, inverse, 0).astype(np.float32)


def _turned(matrices: NDArray[np.float32], vectors: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return vectors (n, 3) multiplied by one matrix (1, 3, 3), or each by its own."""
    return vectors @ matrices[0].T if len(matrices) == 1 else np.einsum("nij,nj->ni", matrices, vectors)


def _pad_targets(document: Document, mesh: Mesh, count: int) -> None:
    """Add empty targets to points and lines, because all primitives of a mesh must have the same number of targets."""
    for primitive in mesh["primitives"]:
        missing = count - len(primitive.get("targets", []))
        if missing > 0 and "POSITION" in primitive["attributes"]:
            vertices = document.gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
            still = document.add(np.zeros((vertices, 3), dtype=np.float32), ARRAY_BUFFER, bounds=True)
            primitive.setdefault("targets", []).extend({"POSITION": still} for _ in range(missing))


def _describe_targets(node: Node, mesh: Mesh, before: list[float], count: int) -> None:
    mesh["weights"] = [*before, *([0.0] * count)]
    node.pop("weights", None)
    extras = mesh["extras"] if isinstance(mesh.get("extras"), dict) else {}
    named = extras.get("targetNames")
    names = list(named)[: len(before)] if isinstance(named, list) else []
    names += [f"target_{index}" for index in range(len(names), len(before))]
    mesh["extras"] = {**extras, "targetNames": [*names, *target_names(count)]}


def target_names(count: int) -> list[str]:
    """Return the names of new morph targets, which follow a mesh's own targets."""
    return [f"motion_{index}" for index in range(count)]


def _widen_animations(document: Document, node: int, before: int, more: int) -> None:
    """Add zero weights for the new morph targets to the file's own animations of a node."""
    for animation in document.gltf["animations"]:
        for channel in animation["channels"]:
            if channel["target"].get("node") == node and channel["target"]["path"] == "weights" and before:
                sampler = animation["samplers"][channel["sampler"]]
                keys = document.array(sampler["output"]).astype(np.float32)
                if keys.size % before:
                    where = at(document.name, field=f"accessors[{sampler['output']}]")
                    raise damaged(where, f"{keys.size} weights for {before} morph targets")
                wider = np.pad(keys.reshape(-1, before), ((0, 0), (0, more))).ravel()
                animation["samplers"].append({**sampler, "output": document.add(wider)})
                channel["sampler"] = len(animation["samplers"]) - 1


def add_channel(
    document: Document, animation: Animation, clock: int, values: NDArray[np.float32], node: int, path: str
) -> None:
    """Add a channel to an animation that moves one property of a node by linear interpolation.

    Parameters
    ----------
    document : Document
    animation : Animation
    clock : int
        Accessor of the keyframes' times.
    values : (F,) or (F, width) float32
    node : int
    path : str
        translation, rotation, scale or weights.
    """
    output = document.add(values)
    animation["samplers"].append({"input": clock, "output": output, "interpolation": "LINEAR"})
    animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": {"node": node, "path": path}})


def hold_targets(document: Document, keyframes: Keyframes, character: CharacterMesh) -> None:
    """Add channels for the weights of a character's own morph targets: those that are moved, and the others at rest.

    Godot ignores the rest weights of a mesh, but not those of an animation.

    Parameters
    ----------
    document : Document
        Without animations, there is nothing to add to.
    keyframes : Keyframes
    character : CharacterMesh
    """
    gltf = document.gltf
    for node in dict.fromkeys(part.node for part in character.parts) if gltf["animations"] else ():
        animation = gltf["animations"][0]
        mesh = gltf["meshes"][gltf["nodes"][node]["mesh"]]
        held = weights_over_time(mesh, rest_weights(gltf["nodes"][node], mesh), keyframes.own, len(keyframes.times))
        if held.any():
            add_channel(document, animation, animation["samplers"][0]["input"], held.ravel(), node, "weights")


def add_root(document: Document, still: Collection[int]) -> int:
    """Add a node above all others of the scene but those that stay still, and return its number.

    Skinned meshes stay at the top, because they follow their joints and not their parents.
    """
    gltf = document.gltf
    scene = gltf["scenes"][gltf.get("scene", 0)]
    tops = scene.get("nodes", [])
    hanging = [
        top for top in tops if top in still or ("skin" in gltf["nodes"][top] and not gltf["nodes"][top].get("children"))
    ]
    gltf["nodes"].append({"name": "puppetline_root", "children": [top for top in tops if top not in hanging]})
    root = len(gltf["nodes"]) - 1
    scene["nodes"] = [root, *hanging]
    return root
