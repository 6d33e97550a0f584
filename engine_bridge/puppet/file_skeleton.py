"""Skeleton in a character's file: its joints, and shown nodes without a joint above them; or its rigid parts."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh
from engine_bridge.character.scene import tree, world_transforms
from engine_bridge.puppet.skin_joints import are_nested, part_nodes


@dataclass(frozen=True, eq=False)
class FileSkeleton:
    """Joints of a character's file, parents before their children.

    Attributes
    ----------
    nodes, parents, above : (j,) list of int
        Node of each joint, the row of the joint on which it hangs, and that of the nearest joint above it in the file,
        which is another one for parts; −1 for none.
    positions : (j, 3) float64
        For a loose node, the middle of the vertices that it shows; for a part, where it turns.
    loose : dict
        Rows of shown nodes without a skin and without a joint above them, with their names.
    diagonal : float
        Diagonal of the character's bounding box.
    of_parts : bool
        Whether these are rigid parts instead of joints.
    """

    nodes: list[int]
    parents: list[int]
    above: list[int]
    positions: NDArray[np.float64]
    loose: dict[int, str]
    diagonal: float
    of_parts: bool = False

    @classmethod
    def of(cls, character: CharacterMesh) -> "FileSkeleton":
        """Take the joints of all skins; without skins, the nodes above nested parts, or parts as `part_joints` does."""
        nested = character.joints or are_nested(character)
        return cls._of_joints(character) if nested else cls._of_parts(character)

    @classmethod
    def _of_joints(cls, character: CharacterMesh) -> "FileSkeleton":
        document, gltf = character.document, character.document.gltf
        walk = tree(document)
        above = {node: parent for node, parent in walk if parent is not None}
        middles, loose = _middles(character), set[int]()
        joints = character.joints or {other for node in middles for other in _path_to_top(node, above)}
        for node, _ in walk:
            hangs = not (joints | loose).isdisjoint(_path_to_top(node, above))
            if node in middles and "skin" not in gltf["nodes"][node] and not hangs:
                loose.add(node)
        nodes = [node for node, _ in walk if node in joints or node in loose]
        rows = {node: row for row, node in enumerate(nodes)}
        parents = _nearest_above(nodes, above)
        positions = world_transforms(document)[np.array(nodes, dtype=np.int64), :3, 3]
        for node in loose:
            positions[rows[node]] = middles[node]
        names = {rows[node]: gltf["nodes"][node].get("name", f"node {node}") for node in sorted(loose)}
        return cls(nodes, parents, parents, positions, names, _diagonal(character))

    @classmethod
    def _of_parts(cls, character: CharacterMesh) -> "FileSkeleton":
        from engine_bridge.puppet.part_joints import part_joints  # it takes SciPy with it, which a service seldom needs

        parts = dict(zip(part_nodes(character), part_joints(character), strict=False))
        walk = tree(character.document)
        nodes = [node for node, _ in walk if node in parts]
        rows = {node: row for row, node in enumerate(nodes)}
        shown = [*parts]
        parents = [-1 if parts[node].parent < 0 else rows[shown[parts[node].parent]] for node in nodes]
        above = _nearest_above(nodes, {node: parent for node, parent in walk if parent is not None})
        positions = np.array([parts[node].place for node in nodes]).reshape(-1, 3)
        return cls(nodes, parents, above, positions, {}, _diagonal(character), True)

    def __len__(self) -> int:
        return len(self.nodes)

    @cached_property
    def paths_to_top(self) -> list[list[int]]:
        """Rows of each joint and its ancestors, from the joint to the top."""
        above = {row: parent for row, parent in enumerate(self.parents) if parent >= 0}
        return [_path_to_top(row, above) for row in range(len(self))]


def _nearest_above(nodes: list[int], above: dict[int, int]) -> list[int]:
    """Return the row of the nearest of some nodes above each of them, −1 for none."""
    rows = {node: row for row, node in enumerate(nodes)}
    return [next((rows[other] for other in _path_to_top(node, above)[1:] if other in rows), -1) for node in nodes]


def _diagonal(character: CharacterMesh) -> float:
    return float(np.linalg.norm(np.ptp(character.vertices, axis=0)))


def _path_to_top(node: int, above: dict[int, int]) -> list[int]:
    path = [node]
    while path[-1] in above:
        path.append(above[path[-1]])
    return path


def _middles(character: CharacterMesh) -> dict[int, NDArray[np.float64]]:
    """Return the middle of the vertices that each node shows."""
    shown: dict[int, list[NDArray[np.float64]]] = {}
    for part in character.parts:
        shown.setdefault(part.node, []).append(part.vertices)
    whole = {node: np.concatenate(parts) for node, parts in shown.items()}
    return {node: (positions.min(axis=0) + positions.max(axis=0)) / 2 for node, positions in whole.items()}
