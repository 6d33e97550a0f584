"""Mends a file's skins: weights and inverse bind matrices that are not numbers or have no effect."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from engine_bridge.character.document import Document
from engine_bridge.character.scene import inverse_bind, shown_nodes, tree, world_transforms
from engine_bridge.character.schema import Primitive, Skin

SUM_TOLERANCE = 2e-7
"""Largest difference of the sum of a vertex's weights from 1, for each of them that is not zero, as in Khronos'
validator."""

UNWEIGHTED = "neutral_bone"
"""Name of the joint that Blender's exporter adds for vertices without weights."""

MIN_DETERMINANT = 1e-12
"""Smallest determinant of an inverse bind matrix that does not flatten vertices, relative to its largest entry."""


def mend_skins(document: Document) -> None:
    """Mend the weights and the inverse bind matrices of skins of shown meshes.

    Vertices without valid weights get those of the nearest vertex of the mesh that has some, and sums are scaled to 1.
    A joint with an invalid matrix gets one by which vertices follow it as they follow its parent at rest. Notes say how
    many were invalid. A root that is not above all joints of its skin is removed.

    Parameters
    ----------
    document : Document
        It is changed.
    """
    nodes = document.gltf["nodes"]
    skinned = [node for node in shown_nodes(document) if "skin" in nodes[node]]
    shown: dict[int, list[int]] = {}
    for node in skinned:
        shown.setdefault(nodes[node]["mesh"], []).append(nodes[node]["skin"])
    mended = sum(_mend_weights(document, mesh, _idle(document, skins)) for mesh, skins in shown.items())
    if mended:
        document.notes.append(f"{mended:,} vertices without valid skin weights get those of the vertices next to them.")
    skins = dict.fromkeys(nodes[node]["skin"] for node in skinned)
    for skin in skins:
        _drop_invalid_root(document, skin)
    mended = sum(_mend_matrices(document, skin) for skin in skins)
    if mended:
        document.notes.append(
            f"{mended:,} joints without a valid inverse bind matrix get one like that of their parent."
        )


def _idle(document: Document, skins: Sequence[int]) -> list[int]:
    """Return which joints in all of some skins are those of vertices without weights."""
    rows = [
        {
            row
            for row, joint in enumerate(document.gltf["skins"][skin]["joints"])
            if _name(document, joint) == UNWEIGHTED
        }
        for skin in skins
    ]
    return sorted(set.intersection(*rows))


def _name(document: Document, node: int) -> str:
    return str(document.gltf["nodes"][node].get("name"))


def _drop_invalid_root(document: Document, skin: int) -> None:
    """Remove the optional root of a skin if it is not above all of its joints."""
    table, above = document.gltf["skins"][skin], dict(tree(document))
    root = table.get("skeleton")
    for joint in table["joints"] if root is not None else ():
        node: int | None = joint
        while node is not None and node != root:
            node = above[node]
        if node is None:
            table.pop("skeleton", None)


def _mend_matrices(document: Document, skin: int) -> int:
    """Mend the inverse bind matrices of a skin; return the number of joints that had no valid one."""
    table, found = document.gltf["skins"][skin], inverse_bind(document, skin)
    matrices = found.copy()
    matrices[:, 3] = np.eye(4)[3]
    largest = np.abs(matrices[:, :3, :3]).max(axis=(1, 2))
    valid = np.isfinite(matrices).all(axis=(1, 2)) & (largest > 0)
    scaled = matrices[valid, :3, :3] / largest[valid, None, None]
    valid[valid] = np.abs(np.linalg.det(scaled)) > MIN_DETERMINANT
    if np.array_equal(matrices, found) and valid.all() and not _is_strided(document, table):
        return 0
    world, above = world_transforms(document), dict(tree(document))
    rows = {joint: row for row, joint in enumerate(table["joints"])}
    whole = np.flatnonzero(valid)
    for row in np.flatnonzero(~valid):
        joint: int | None = table["joints"][row]
        while joint is not None and not (joint in rows and valid[rows[joint]]):
            joint = above[joint]
        like = rows[joint] if joint is not None else whole[0] if len(whole) else None
        follows = np.eye(4) if like is None else world[table["joints"][like]] @ matrices[like]
        matrices[row] = np.linalg.pinv(world[table["joints"][row]]) @ follows
        matrices[row, 3] = np.eye(4)[3]
    columns = matrices.transpose(0, 2, 1).reshape(-1, 16).astype(np.float32)
    document.replace(table["inverseBindMatrices"], columns)
    return int((~valid).sum())


def _is_strided(document: Document, skin: Skin) -> bool:
    """Return whether inverse bind matrices are in a view with a stride, which glTF allows for vertices only."""
    view = (
        document.gltf["accessors"][skin["inverseBindMatrices"]].get("bufferView")
        if "inverseBindMatrices" in skin
        else None
    )
    return view is not None and "byteStride" in document.gltf["bufferViews"][view]


@dataclass
class _Weighted:
    """A primitive with a skin.

    Attributes
    ----------
    names : list of (str, str)
        Names of its attributes of weights and of joints.
    places : (n, 3) float64
    weights, joints : (n, k) float64, (n, k) int
    broken : (n,) bool
        Vertices without valid weights.
    """

    primitive: Primitive
    names: list[tuple[str, str]]
    places: NDArray[np.float64]
    weights: NDArray[np.float64]
    joints: NDArray[Any]
    broken: NDArray[np.bool_]

    @classmethod
    def of(cls, document: Document, primitive: Primitive, idle: Sequence[int]) -> "_Weighted | None":
        """Read a primitive; None if it has no skin. Weights of `idle` joints count for nothing."""
        attributes = primitive["attributes"]
        names = [(name, f"JOINTS_{name[8:]}") for name in attributes if name.startswith("WEIGHTS_")]
        if "POSITION" not in attributes or not names or any(joints not in attributes for _, joints in names):
            return None
        count = document.gltf["accessors"][attributes["POSITION"]]["count"]
        columns = [[document.attribute(primitive, name, count, 4) for name in pair] for pair in names]
        weights = np.hstack([each for each, _ in columns if each is not None]).astype(np.float64)
        joints = np.hstack([each for _, each in columns if each is not None])
        broken = ~np.isfinite(weights).all(axis=1)
        weights = np.maximum(np.nan_to_num(weights, posinf=0.0, neginf=0.0), 0.0)
        broken |= np.where(np.isin(joints, idle), 0.0, weights).sum(axis=1) == 0
        positions = document.attribute(primitive, "POSITION", count, 3)
        places = np.nan_to_num(np.zeros((count, 3)) if positions is None else positions.astype(np.float64))
        return cls(primitive, names, places, weights, joints, broken)

    def write(self, document: Document) -> None:
        """Write weights whose sums are 1, and the joints of vertices that had none."""
        sums = self.weights.sum(axis=1, keepdims=True)
        exact = np.abs(sums[:, 0] - 1) <= SUM_TOLERANCE * np.count_nonzero(self.weights, axis=1)
        if not self.broken.any() and exact.all():
            return
        weights = (self.weights / sums).astype(np.float32)
        for number, (of_weights, of_joints) in enumerate(self.names):
            chosen = slice(4 * number, 4 * number + 4)
            document.replace(self.primitive["attributes"][of_weights], weights[:, chosen])
            if self.broken.any():
                document.replace(self.primitive["attributes"][of_joints], self.joints[:, chosen])


def _mend_weights(document: Document, mesh: int, idle: Sequence[int]) -> int:
    """Mend the weights of a mesh; return the number of vertices that had none."""
    primitives = document.gltf["meshes"][mesh]["primitives"]
    found = [each for primitive in primitives if (each := _Weighted.of(document, primitive, idle)) is not None]
    if not found:
        return 0
    width = max(each.weights.shape[1] for each in found)
    weights, joints = (
        np.concatenate([np.pad(getattr(each, name), ((0, 0), (0, width - each.weights.shape[1]))) for each in found])
        for name in ("weights", "joints")
    )
    places, broken = (np.concatenate([getattr(each, name) for each in found]) for name in ("places", "broken"))
    valid = np.flatnonzero(~broken)
    tree = scipy.spatial.cKDTree(places[valid]) if len(valid) else None
    for each in found:
        own = each.weights.shape[1]
        if tree is None:
            each.weights[:], each.joints = np.eye(1, own), np.zeros_like(each.joints)
        elif each.broken.any():
            nearest = valid[tree.query(each.places[each.broken])[1]]
            each.weights[each.broken] = weights[nearest, :own]
            each.joints[each.broken] = joints[nearest, :own]
        each.write(document)
    return int(broken.sum())
