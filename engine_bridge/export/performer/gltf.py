"""A performer's motion as a glTF document: a skeleton with octahedra for its bones, or a VRM animation.

At rest, the skeleton stands in a T-pose, faces +z, and all its joints have the axes of the world, as VRMC_vrm_animation
recommends. Joints have animated rotations, and the hips an animated position. Every frame is a keyframe: the noise of
sensors leaves few that could be omitted.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character import schema
from engine_bridge.character.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Document
from engine_bridge.character.schema import Animation, Material, Node
from engine_bridge.export.animation import add_channel
from engine_bridge.export.performer.motion import PerformerMotion

VRM_ANIMATION = "VRMC_vrm_animation"

TIP = "_end"
"""End of the names of the joints at the tips of head, hands and feet."""

RING_SHARE, MAX_RADIUS_METRES = 0.1, 0.025
"""Distance of the widest part of an octahedron from its joint, and its largest radius, as a share of its length and in
metres."""

RING = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
FACES = np.array([[k, (k + 1) % 4, 5] for k in range(4)] + [[(k + 1) % 4, k, 4] for k in range(4)])
"""Triangles of an octahedron: four corners of the ring, then the joint and its child."""

GREY: Material = {"pbrMetallicRoughness": {"baseColorFactor": [0.6, 0.6, 0.65, 1.0], "metallicFactor": 0.0}}


def vrm_animation(motion: PerformerMotion, name: str) -> Document:
    """Return a motion as a VRM animation.

    Parameters
    ----------
    motion : PerformerMotion
    name : str
        Name of the animation.
    """
    document = _animated(motion, name)
    bones = {bone: {"node": node} for node, bone in enumerate(motion.body.skeleton.names)}
    document.gltf["extensionsUsed"] = [VRM_ANIMATION]
    extension: dict[str, Any] = {"specVersion": "1.0", "humanoid": {"humanBones": bones}}
    document.gltf["extensions"] = {VRM_ANIMATION: extension}
    return document


def skeleton_animation(motion: PerformerMotion, name: str) -> Document:
    """Return a motion as an animated skeleton with a mesh of octahedra, which shows the bones where nothing else does.

    Parameters are those of `vrm_animation`.
    """
    document = _animated(motion, name)
    gltf, skeleton, tips = document.gltf, motion.body.skeleton, motion.body.tips
    for joint, place in tips.items():
        row = skeleton.names.index(joint)
        offset = (place - skeleton.heads[row]).tolist()
        gltf["nodes"][row].setdefault("children", []).append(len(gltf["nodes"]))
        gltf["nodes"].append({"name": joint + TIP, "translation": offset})
    segments = [(joint.parent, joint.head) for joint in skeleton.joints if joint.parent >= 0]
    segments += [(skeleton.names.index(joint), place) for joint, place in tips.items()]
    heads = np.concatenate([skeleton.heads, list(tips.values())])
    bind = np.tile(np.eye(4, dtype=np.float32), (len(heads), 1, 1))
    bind[:, 3, :3] = -heads
    joints = list(range(len(heads)))
    gltf["skins"].append({"joints": joints, "skeleton": 0, "inverseBindMatrices": document.add(bind.reshape(-1, 16))})
    gltf["materials"].append(GREY)
    gltf["meshes"].append({"name": "bones", "primitives": [_octahedra(document, skeleton.heads, segments)]})
    gltf["scenes"][0]["nodes"].append(len(gltf["nodes"]))
    gltf["nodes"].append({"name": "performer", "mesh": 0, "skin": 0})
    return document


def _animated(motion: PerformerMotion, name: str) -> Document:
    """Return a document with the skeleton's nodes, whose numbers are the rows of its joints, and its animation."""
    skeleton = motion.body.skeleton
    document = Document(schema.empty(), name=name)
    for row, joint in enumerate(skeleton.joints):
        above = skeleton.heads[joint.parent] if joint.parent >= 0 else np.zeros(3)
        node: Node = {"name": joint.name, "translation": (joint.head - above).tolist()}
        children = np.flatnonzero(skeleton.parents == row).tolist()
        document.gltf["nodes"].append({**node, "children": children} if children else node)
    document.gltf["scenes"], document.gltf["scene"] = [{"nodes": [0]}], 0
    animation: Animation = {"name": name, "channels": [], "samplers": []}
    clock = document.add((np.arange(len(motion.hips)) / motion.fps).astype(np.float32), bounds=True)
    add_channel(document, animation, clock, motion.hips.astype(np.float32), 0, "translation")
    for row in range(len(skeleton.joints)):
        add_channel(document, animation, clock, motion.rotations[:, row].astype(np.float32), row, "rotation")
    document.gltf["animations"].append(animation)
    return document


def _octahedra(
    document: Document, heads: NDArray[np.float64], segments: list[tuple[int, NDArray[np.float64]]]
) -> schema.Primitive:
    """Add an octahedron for each segment from a joint, which it moves with, to a point."""
    points: list[NDArray[np.float64]] = []
    owners: list[int] = []
    faces: list[NDArray[np.int64]] = []
    for joint, end in segments:
        along = end - heads[joint]
        length = float(np.linalg.norm(along))
        if length == 0:
            continue
        across = np.linalg.svd(along[None])[2][1:]
        if np.linalg.det(np.array([*across, along])) < 0:
            across[0] *= -1
        ring = heads[joint] + RING_SHARE * along + min(RING_SHARE * length, MAX_RADIUS_METRES) * RING @ across
        faces.append(FACES + 6 * len(owners))
        points += [*ring, heads[joint], end]
        owners.append(joint)
    joints = np.zeros((len(points), 4), dtype=np.uint8)
    joints[:, 0] = np.repeat(owners, 6)
    weights = np.zeros((len(points), 4), dtype=np.float32)
    weights[:, 0] = 1
    return {
        "attributes": {
            "POSITION": document.add(np.array(points, dtype=np.float32), ARRAY_BUFFER, bounds=True),
            "JOINTS_0": document.add(joints, ARRAY_BUFFER),
            "WEIGHTS_0": document.add(weights, ARRAY_BUFFER),
        },
        "indices": document.add(np.concatenate(faces).astype(np.uint16).ravel(), ELEMENT_ARRAY_BUFFER),
        "material": 0,
    }
