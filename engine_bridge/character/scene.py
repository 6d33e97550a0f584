"""Tree of nodes: shown nodes, their transforms, and skins."""

from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.document import Document
from engine_bridge.character.gltf_file import damaged
from engine_bridge.character.schema import Gltf, Mesh, Node, Primitive, copied
from puppetline.errors import MeshError, at

MAX_JOINT_SETS = 16
"""Maximum number of sets of 4 joints per vertex; without a limit, a small file could have many that share one array."""


def top_nodes(gltf: Gltf) -> list[int]:
    """Return the top nodes of the shown scene, or all nodes without a parent if a file has no scene."""
    return list(gltf["scenes"][gltf.get("scene", 0)].get("nodes", [])) if gltf["scenes"] else _roots(gltf)


def _roots(gltf: Gltf) -> list[int]:
    """Return the nodes without a parent."""
    children = {child for node in gltf["nodes"] for child in node.get("children", [])}
    return [index for index in range(len(gltf["nodes"])) if index not in children]


def show_all(gltf: Gltf) -> None:
    """Add a scene with all nodes to a file without scenes, because viewers would show nothing of it."""
    if not gltf["scenes"]:
        gltf["scenes"], gltf["scene"] = [{"nodes": top_nodes(gltf)}], 0


def own_mesh(document: Document, node: int, shown: Counter[int | None]) -> Mesh:
    """Return a mesh that only this node shows, because displacements are in the coordinates of a node.

    Parameters
    ----------
    document : Document
    node : int
    shown : Counter
        Number of nodes that show each mesh; it is updated.
    """
    gltf = document.gltf
    mesh = gltf["nodes"][node]["mesh"]
    if shown[mesh] > 1:
        shown[mesh] -= 1
        gltf["meshes"].append(copied(gltf["meshes"][mesh]))
        gltf["nodes"][node]["mesh"] = mesh = len(gltf["meshes"]) - 1
    return gltf["meshes"][mesh]


def shown_nodes(document: Document) -> list[int]:
    """Return the nodes of the shown scene that have a mesh, in the order of the file.

    Raises
    ------
    MeshError
        The nodes do not form a tree.
    """
    nodes, tops = document.gltf["nodes"], top_nodes(document.gltf)
    shown = [index for index, _ in _walk(document, tops) if "mesh" in nodes[index]]
    inner = set(tops).difference(_roots(document.gltf))
    if inner:  # its parent is not shown, but moves it
        raise _no_tree(document, min(inner), "a node at the top of the scene that has a parent")
    return shown


def world_transforms(document: Document) -> NDArray[np.float64]:
    """Return the world transforms (nodes, 4, 4) of all nodes, for column vectors.

    Nodes outside the shown scene, which may be joints, are placed from the top of their own tree.
    """
    gltf = document.gltf
    transforms = np.tile(np.eye(4), (len(gltf["nodes"]), 1, 1))
    for index, parent in tree(document):
        above = np.eye(4) if parent is None else transforms[parent]
        transforms[index] = above @ local_transform(gltf["nodes"][index])
    return transforms


def tree(document: Document) -> list[tuple[int, int | None]]:
    """Return all nodes with their parents, parents first.

    Raises
    ------
    MeshError
        The nodes do not form a tree.
    """
    return list(_walk(document, _roots(document.gltf)))


def _walk(document: Document, roots: list[int]) -> Iterator[tuple[int, int | None]]:
    """Yield the nodes of trees with their parents, in the order of the file."""
    nodes = document.gltf["nodes"]
    waiting: list[tuple[int, int | None]] = [(root, None) for root in reversed(roots)]
    seen: set[int] = set()
    while waiting:
        index, parent = waiting.pop()
        if index in seen:
            raise _no_tree(document, index, "a node that is its own ancestor, or has two parents")
        seen.add(index)
        yield index, parent
        waiting.extend((child, index) for child in reversed(nodes[index].get("children", [])))


def _no_tree(document: Document, node: int, found: str) -> MeshError:
    return MeshError(
        at(document.name, field=f"nodes[{node}]"), found=found, expected="a tree of nodes", fix="Export the file again."
    )


def local_transform(node: Node) -> NDArray[np.float64]:
    """Return the transform (4, 4) of a node relative to its parent, for column vectors."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    transform = np.eye(4)
    rotation = np.array(node.get("rotation", [0.0, 0.0, 0.0, 1.0]), dtype=np.float64)
    if rotation.any():
        transform[:3, :3] = rotation_matrix(rotation)
    transform[:3, :3] *= np.array(node.get("scale", [1.0, 1.0, 1.0]), dtype=np.float64)
    transform[:3, 3] = node.get("translation", [0.0, 0.0, 0.0])
    return transform


def rotation_matrix(quaternion: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation matrix (3, 3) of a quaternion x, y, z, w (4,) of any length but 0 (Rodrigues)."""
    scaled = quaternion / np.abs(quaternion).max()  # squares of huge or tiny numbers are infinite or zero
    x, y, z, w = scaled / np.linalg.norm(scaled)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2 * (w * cross + cross @ cross)


def skinning(
    document: Document, primitive: Primitive, skin: int, count: int, world: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the transform of each vertex of a primitive by a skin at rest.

    This is the weighted mean of its joints' matrices (glTF 2.0, section 3.7.3.3); the transform of the node that shows
    the primitive is ignored. Weights are scaled to a sum of 1, as in viewers.

    Parameters
    ----------
    document : Document
    primitive : Primitive
    skin : int
    count : int
        Number of vertices.
    world : (nodes, 4, 4) float64
        From `world_transforms`.

    Returns
    -------
    (count, 4, 4) float64

    Raises
    ------
    MeshError
        There are no valid joints and weights, or a joint is not in the skin.
    """
    joints = world[document.gltf["skins"][skin]["joints"]] @ inverse_bind(document, skin)
    which, share = influences(document, primitive, skin, count)
    blended = np.zeros((count, 4, 4))
    for column in range(which.shape[1]):
        blended += share[:, column, None, None] * joints[which[:, column]]
    return blended


def inverse_bind(document: Document, skin: int) -> NDArray[np.float64]:
    """Return the inverse bind matrices (j, 4, 4) of a skin, for column vectors; identities if it has none.

    Raises
    ------
    MeshError
        There are fewer matrices than joints.
    """
    table = document.gltf["skins"][skin]
    count = len(table["joints"])
    if "inverseBindMatrices" not in table:
        return np.tile(np.eye(4), (count, 1, 1))
    inverse = document.array(table["inverseBindMatrices"]).astype(np.float64)
    if inverse.ndim != 2 or inverse.shape[1] != 16 or len(inverse) < count:
        where = at(document.name, field=f"skins[{skin}]")
        raise damaged(where, f"{len(inverse)} inverse bind matrices for {count} joints")
    return inverse[:count].reshape(-1, 4, 4).transpose(0, 2, 1)


def influences(
    document: Document, primitive: Primitive, skin: int, count: int
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the joints of a skin that each vertex of a primitive follows, and their weights.

    Returns
    -------
    (count, k) int64, (count, k) float64
        Indices into the skin's joints, and weights whose sum is 1 at each vertex.

    Raises
    ------
    MeshError
        There are no valid joints and weights, or a joint is not in the skin.
    """
    where, joints = at(document.name, field=f"skins[{skin}]"), document.gltf["skins"][skin]["joints"]
    sets = [name.removeprefix("JOINTS_") for name in primitive["attributes"] if name.startswith("JOINTS_")]
    if len(sets) > MAX_JOINT_SETS:
        raise damaged(where, f"{len(sets):,} sets of joints at each vertex")
    indices = _columns(document, primitive, [f"JOINTS_{name}" for name in sets], count)
    weights = _columns(document, primitive, [f"WEIGHTS_{name}" for name in sets], count)
    if not sets or indices.shape != weights.shape:
        raise damaged(where, "a primitive without joints and weights")
    which, share = indices.astype(np.int64), weights.astype(np.float64)
    if which.max(initial=0) >= len(joints) or which.min(initial=0) < 0:
        raise damaged(where, f"joint {which.max()} of {len(joints)}")
    share /= share.sum(axis=1, keepdims=True)
    return which, share


def _columns(document: Document, primitive: Primitive, names: list[str], count: int) -> NDArray[Any]:
    """Return the existing attributes of some names side by side."""
    found = [document.attribute(primitive, name, count, 4) for name in names]
    return np.hstack([np.zeros((count, 0)), *(values for values in found if values is not None)])
