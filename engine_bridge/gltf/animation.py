"""The animated character: morph targets, their weights over time, and the root's way through space."""

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass

import numpy as np
import pygltflib
from numpy.typing import NDArray
from pygltflib import Animation, AnimationChannel, AnimationChannelTarget, AnimationSampler, Attributes, Node, Scene

from engine_bridge.gltf.character import Character, Part, top_nodes
from engine_bridge.gltf.document import Document


@dataclass(frozen=True)
class Take:
    """A clip, ready to be written.

    Attributes
    ----------
    name : str
        Name of the animation.
    times : (F,) float32
        Seconds, from 0.
    weights : (F, K) float32
    root : (F, 3) float32 or None
        Translation of the whole character, mesh file's coordinates.
    """

    name: str
    times: NDArray[np.float32]
    weights: NDArray[np.float32]
    root: NDArray[np.float32] | None


Displacements = Callable[[int], tuple[NDArray[np.float32], NDArray[np.float32] | None]]
"""Part number to (K, n, 3) position and normal displacements in world coordinates, normals None where it has none."""


def animate(character: Character, take: Take, displacements: Displacements) -> Document:
    """Put a take into a copy of a character's document.

    Each node that shows a part of the character gets morph targets and a weights animation; the root's motion is the
    translation of a new node above the scene.

    Parameters
    ----------
    character : Character
    take : Take
    displacements : callable
        Asked for one part at a time, so that they need not all be in memory.

    Returns
    -------
    Document
        Ready to be saved.
    """
    document = Document(deepcopy(character.document.gltf), bytes(character.document.blob), character.document.name)
    if not document.gltf.scenes:  # such a file is a library, of which viewers show nothing
        document.gltf.scenes, document.gltf.scene = [Scene(nodes=top_nodes(document.gltf))], 0
    animation = Animation(name=take.name)
    clock = document.add(take.times, bounds=True)
    for node in dict.fromkeys(part.node for part in character.parts):
        _own_mesh(document, node)
        before = _rest_weights(document, node)
        for number, part in enumerate(character.parts):
            if part.node == node:
                _add_targets(document, part, *displacements(number))
        _pad_targets(document, node, len(before) + take.weights.shape[1])
        if take.weights.shape[1]:
            held = np.tile(np.array(before, dtype=np.float32), (len(take.times), 1))
            _channel(document, animation, clock, np.hstack([held, take.weights]).ravel(), node, pygltflib.WEIGHTS)
            _describe_targets(document, node, before, take.weights.shape[1])
    if take.root is not None:
        _channel(document, animation, clock, take.root, _add_root(document), pygltflib.TRANSLATION)
    document.gltf.animations = [animation] if animation.channels else []
    return document


def _own_mesh(document: Document, node: int) -> None:
    """Give a node a mesh that no other node shows: in its own space the same motion is another displacement."""
    gltf = document.gltf
    shown = gltf.nodes[node].mesh
    if sum(other.mesh == shown for other in gltf.nodes) > 1:
        gltf.meshes.append(deepcopy(gltf.meshes[shown]))
        gltf.nodes[node].mesh = len(gltf.meshes) - 1


def _rest_weights(document: Document, node: int) -> list[float]:
    """Return the weights of the morph targets that the node came with."""
    mesh = document.gltf.meshes[document.gltf.nodes[node].mesh]
    there = max((len(primitive.targets or []) for primitive in mesh.primitives), default=0)
    return list(mesh.weights or [0.0] * there)


def _add_targets(
    document: Document, part: Part, positions: NDArray[np.float32], normals: NDArray[np.float32] | None
) -> None:
    """Append a part's targets to its primitive, turned from world coordinates into its node's."""
    primitive = document.gltf.meshes[document.gltf.nodes[part.node].mesh].primitives[part.primitive]
    primitive.targets = list(primitive.targets or [])
    linear = part.to_world[:3, :3]
    to_local = np.linalg.pinv(linear).T.astype(np.float32)
    if part.normals is not None:
        # a node's scale changes the length of the unit normals in the file: displacements must keep their share of it
        length = np.linalg.norm(part.normals @ linear, axis=1, keepdims=True).astype(np.float32)
    for k, displacement in enumerate(positions):
        target = Attributes(POSITION=document.add(displacement @ to_local, pygltflib.ARRAY_BUFFER, bounds=True))
        if normals is not None:
            turned = normals[k] @ linear.astype(np.float32) / np.maximum(length, np.float32(1e-30))
            target.NORMAL = document.add(turned, pygltflib.ARRAY_BUFFER)
        primitive.targets.append(target)


def _pad_targets(document: Document, node: int, count: int) -> None:
    """Give points and lines of the mesh as many targets, which do nothing: a mesh must have one number of them."""
    for primitive in document.gltf.meshes[document.gltf.nodes[node].mesh].primitives:
        primitive.targets = list(primitive.targets or [])
        if len(primitive.targets) < count:
            still = np.zeros((document.gltf.accessors[primitive.attributes.POSITION].count, 3), dtype=np.float32)
            accessor = document.add(still, pygltflib.ARRAY_BUFFER, bounds=True)
            primitive.targets += [Attributes(POSITION=accessor) for _ in range(count - len(primitive.targets))]


def _describe_targets(document: Document, node: int, before: list[float], count: int) -> None:
    mesh = document.gltf.meshes[document.gltf.nodes[node].mesh]
    mesh.weights = [*before, *([0.0] * count)]
    extras = dict(mesh.extras or {})
    names = list(extras.get("targetNames", []))[: len(before)]
    names += [f"target_{index}" for index in range(len(names), len(before))]
    mesh.extras = {**extras, "targetNames": [*names, *(f"motion_{index}" for index in range(count))]}


def _channel(
    document: Document, animation: Animation, clock: int, values: NDArray[np.float32], node: int, path: str
) -> None:
    sampler = AnimationSampler(input=clock, output=document.add(values), interpolation=pygltflib.ANIM_LINEAR)
    animation.samplers.append(sampler)
    target = AnimationChannelTarget(node=node, path=path)
    animation.channels.append(AnimationChannel(sampler=len(animation.samplers) - 1, target=target))


def _add_root(document: Document) -> int:
    """Put one node above all others of the scene."""
    gltf = document.gltf
    scene = gltf.scenes[gltf.scene or 0]
    gltf.nodes.append(Node(name="puppetline_root", children=scene.nodes))
    scene.nodes = [len(gltf.nodes) - 1]
    return scene.nodes[0]
