"""Joints of a character's file, and the vertices that follow them."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh
from engine_bridge.character.document import Document
from engine_bridge.character.scene import influences, tree, world_transforms
from engine_bridge.puppet.limb_nodes import node_labels

STRAIGHT = np.eye(3)
"""Rotation of a character that is not turned between its axes."""


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
    contacts : mapping of int to int
        Indices of joints whose vertices share triangles with its own, and the numbers of their common sides.
    """

    name: str
    parent: int
    place: NDArray[np.float64]
    vertices: NDArray[np.float64]
    label: str = ""
    contacts: Mapping[int, int] = field(default_factory=dict)


def joints_of(character: CharacterMesh, back: NDArray[np.float64] = STRAIGHT) -> list[Joint]:
    """Return the joints of all skins; without skins, the named nodes of a character of several parts.

    Vertices of a part without a skin that hangs on a joint follow this joint, if it is a part of the body: if no
    vertices with a skin follow this joint or one above it. Otherwise it is carried, as a hat or a weapon is.

    Places are those of the character that `back` (3, 3), a rotation, turns back to its axes.
    """
    document = character.document
    gltf = document.gltf
    parents = {child: index for index, node in enumerate(gltf["nodes"]) for child in node.get("children", [])}
    nodes = sorted(character.joints) or _named(gltf["nodes"])
    vrm = _vrm_names(document)
    number = {node: index for index, node in enumerate(nodes)}

    def joint_at(node: int | None) -> int:
        while node is not None and node not in number:
            node = parents.get(node)
        return -1 if node is None else number[node]

    above = [joint_at(parents.get(node)) for node in nodes]
    followed, rows = np.unique(_most_followed(character), return_inverse=True)
    skinned = {number[node] for node in followed.tolist() if node in number}

    def owner(node: int) -> int:
        joint = over = joint_at(node)
        while node not in number and over >= 0:
            if over in skinned:
                return -1
            over = above[over]
        return joint

    owners = np.array([owner(node) for node in followed.tolist()])[rows]
    places, labels = world_transforms(document)[:, :3, 3] @ back.T, node_labels(document)
    joints, contacts = [], _contacts(owners[character.triangles], len(nodes))
    for index, node in enumerate(nodes):
        name = vrm.get(node) or gltf["nodes"][node].get("name", f"node {node}")
        vertices = character.vertices[owners == index] @ back.T
        joints.append(Joint(name, above[index], places[node], vertices, labels[node], contacts[index]))
    return joints


def _named(nodes: Sequence[Mapping[str, Any]]) -> list[int]:
    """Return the nodes that have names, without those that only show the mesh of a bone."""
    of_bones = _bones_of_meshes(nodes)
    return [index for index, node in enumerate(nodes) if node.get("name") and index not in of_bones]


def _bones_of_meshes(nodes: Sequence[Mapping[str, Any]]) -> dict[int, int]:
    """Return the bone of each node that only shows a mesh: a named node without a mesh, whose only such child it is."""
    found = {}
    for bone, node in enumerate(nodes):
        meshes = [child for child in node.get("children", []) if "mesh" in nodes[child]]
        if node.get("name") and "mesh" not in node and len(meshes) == 1 and not nodes[meshes[0]].get("children"):
            found[meshes[0]] = bone
    return found


def part_nodes(character: CharacterMesh) -> list[int]:
    """Return the nodes that show the parts of a character."""
    return sorted({part.node for part in character.parts})


def are_nested(character: CharacterMesh) -> bool:
    """Return whether the file says how a body of parts hangs together: two parts are above another one."""
    nodes = part_nodes(character)
    above = parts_above(character, nodes)
    return any(above[over] >= 0 for over in above if over >= 0)


def parts_above(character: CharacterMesh, nodes: Sequence[int]) -> list[int]:
    """Return the row of the nearest shown node above each one, −1 for none; the bone of a mesh stands for it."""
    bones = _bones_of_meshes(character.document.gltf["nodes"])
    own = [bones.get(node, node) for node in nodes]
    rows, found = {node: row for row, node in enumerate(own)}, dict[int, int]()
    for node, parent in tree(character.document):
        found[node] = -1 if parent is None else rows.get(parent, found[parent])
    return [found[node] for node in own]


def _contacts(triangles: NDArray[np.int64], count: int) -> list[Counter[int]]:
    """Return how often the sides of triangles lead from each owner of vertices to another one."""
    found: list[Counter[int]] = [Counter() for _ in range(count)]
    sides = np.stack([triangles, np.roll(triangles, 1, axis=1)], axis=2).reshape(-1, 2)
    sides = sides[(sides[:, 0] != sides[:, 1]) & (sides >= 0).all(axis=1)]
    pairs, numbers = np.unique(sides, axis=0, return_counts=True)
    for (one, other), number in zip(pairs.tolist(), numbers.tolist(), strict=True):
        found[one][other] += number
        found[other][one] += number
    return found


def _vrm_names(document: Document) -> dict[int, str]:
    """Return the names of nodes in the humanoid table of VRM 0 or 1."""
    extensions = document.gltf.get("extensions", {})
    older = extensions.get("VRM", {}).get("humanoid", {}).get("humanBones", [])
    newer = extensions.get("VRMC_vrm", {}).get("humanoid", {}).get("humanBones", {})
    named = [(entry.get("bone"), entry.get("node")) for entry in older if isinstance(entry, dict)]
    named += [(bone, entry.get("node")) for bone, entry in newer.items() if isinstance(entry, dict)]
    return {node: bone for bone, node in named if isinstance(bone, str) and isinstance(node, int)}


def vertex_influences(character: CharacterMesh) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the nodes that move each vertex: joints, or the node that shows it if it has no skin.

    Parameters
    ----------
    character : CharacterMesh

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


def _most_followed(character: CharacterMesh) -> NDArray[np.int64]:
    """Return the node (N,) with the largest share in each vertex's motion."""
    nodes, shares = vertex_influences(character)
    return np.asarray(nodes[np.arange(len(nodes)), shares.argmax(axis=1)])
