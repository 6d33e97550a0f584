"""Mends the weights of a file's skins: those that are not numbers, those that are all zero, and other sums than 1."""

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.character.document import Document
from engine_bridge.character.scene import shown_nodes
from engine_bridge.character.schema import Primitive

SUM_TOLERANCE = 2e-7
"""Largest difference of the sum of a vertex's weights from 1, for each of them that is not zero, as in Khronos'
validator."""


def mend_weights(document: Document) -> None:
    """Give vertices without valid weights those of the nearest vertex that has some, and scale sums to 1.

    Vertices of shown meshes with a skin are mended. A note says how many had no valid weights.

    Parameters
    ----------
    document : Document
        It is changed.
    """
    nodes, meshes = document.gltf["nodes"], document.gltf["meshes"]
    skinned = dict.fromkeys(nodes[node]["mesh"] for node in shown_nodes(document) if "skin" in nodes[node])
    mended = sum(_mend(document, primitive) for mesh in skinned for primitive in meshes[mesh]["primitives"])
    if mended:
        document.notes.append(f"{mended:,} vertices without valid skin weights get those of the vertices next to them.")


def _mend(document: Document, primitive: Primitive) -> int:
    """Mend the weights of a primitive; return the number of vertices that had none."""
    attributes = primitive["attributes"]
    names = [(name, f"JOINTS_{name[8:]}") for name in attributes if name.startswith("WEIGHTS_")]
    if "POSITION" not in attributes or not names or any(joints not in attributes for _, joints in names):
        return 0
    count = document.gltf["accessors"][attributes["POSITION"]]["count"]
    columns = [[document.attribute(primitive, name, count, 4) for name in pair] for pair in names]
    weights = np.hstack([each for each, _ in columns if each is not None]).astype(np.float64)
    joints = np.hstack([each for _, each in columns if each is not None])
    broken = ~np.isfinite(weights).all(axis=1)
    weights = np.maximum(np.nan_to_num(weights, posinf=0.0, neginf=0.0), 0.0)
    sums = weights.sum(axis=1)
    broken |= sums == 0
    if not broken.any() and (np.abs(sums - 1) <= SUM_TOLERANCE * np.count_nonzero(weights, axis=1)).all():
        return 0
    if broken.all():
        weights[:], joints = np.eye(1, weights.shape[1]), np.zeros_like(joints)
    elif broken.any():
        nearest = _nearest(document, primitive, count, broken)
        weights[broken], joints[broken] = weights[nearest], joints[nearest]
    weights /= weights.sum(axis=1, keepdims=True)
    for number, (of_weights, of_joints) in enumerate(names):
        chosen = slice(4 * number, 4 * number + 4)
        document.replace(attributes[of_weights], weights[:, chosen].astype(np.float32))
        if broken.any():
            document.replace(attributes[of_joints], joints[:, chosen])
    return int(broken.sum())


def _nearest(document: Document, primitive: Primitive, count: int, broken: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return the vertex with valid weights that is nearest to each broken one."""
    positions = document.attribute(primitive, "POSITION", count, 3)
    places = np.nan_to_num(np.zeros((count, 3)) if positions is None else positions.astype(np.float64))
    valid = np.flatnonzero(~broken)
    return np.asarray(valid[scipy.spatial.cKDTree(places[valid]).query(places[broken])[1]])
