"""Characters: glTF documents and their surfaces.

A character file of any format is converted to a glTF document first. A glTF file keeps all of its contents.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.assembly import assemble
from engine_bridge.character.document import Document
from engine_bridge.character.document_reader import load_document
from engine_bridge.character.gltf_file import MAGIC, damaged
from engine_bridge.character.scene import shown_nodes, skinning, world_transforms
from engine_bridge.character.schema import Mesh, Node, Primitive
from engine_bridge.character.shading import shaded, unit
from engine_bridge.character.skin_repair import mend_skins
from engine_bridge.character.surface_document import SURFACE_FILES, read_document
from engine_bridge.character.surfaces.surface import MAX_COORDINATE, Piece, Surface, material_for, outside
from puppetline.errors import MeshError, at
from puppetline.files import read_whole
from solver.surface.mesh import SolverMesh, weld

CHARACTER_FILES = (".glb", ".gltf", ".vrm", *SURFACE_FILES)

MAX_PARTS, MAX_VERTICES = 10_000, 10_000_000
"""Maximum numbers of parts and vertices of a character."""

TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN = 4, 5, 6


@dataclass(frozen=True)
class Part:
    """A primitive of a mesh as a node shows it.

    Attributes
    ----------
    node, primitive : int
        Index of the node in the document, and of the primitive in the node's mesh.
    to_world : (1 or n, 4, 4) float64
        The node's transform, or each vertex's own if it has a skin; for column vectors.
    vertices : (n, 3) float64
        World positions at rest: with the rest weights of the file's morph targets, and its skeleton at rest.
    triangles : (t, 3) int64
    normals : (n, 3) float64 or None
        World unit normals, None if the file has none.
    """

    node: int
    primitive: int
    to_world: NDArray[np.float64]
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64] | None


@dataclass(frozen=True)
class CharacterMesh:
    """What a file shows of a character: its document, and the surfaces that move or stay still.

    Attributes
    ----------
    document : Document
    parts : list of Part
        All surfaces, in the order of nodes and primitives.
    still : tuple of Part
        Surfaces that do not move, of nodes at the top of the scene.
    """

    document: Document
    parts: list[Part]
    still: tuple[Part, ...] = ()

    @property
    def vertices(self) -> NDArray[np.float64]:
        """World positions (N, 3) float64 of all parts, one after another."""
        return np.concatenate([part.vertices for part in self.parts])

    @property
    def triangles(self) -> NDArray[np.int64]:
        """Triangles (T, 3) int64 of all parts as indices into `vertices`."""
        return np.concatenate(
            [part.triangles + place.start for part, place in zip(self.parts, self.vertex_slices, strict=True)]
        )

    @property
    def vertex_slices(self) -> list[slice]:
        """Slices of the parts in `vertices` and in `SolverMesh.of_render`."""
        ends = np.cumsum([len(part.vertices) for part in self.parts]).tolist()
        return [slice(start, end) for start, end in pairwise([0, *ends])]

    @property
    def whole(self) -> "CharacterMesh":
        """The character with the surfaces that do not move."""
        return replace(self, parts=[*self.parts, *self.still], still=())

    @property
    def joints(self) -> set[int]:
        """Nodes of the joints of all skins, except of those that only move what stays still."""
        gltf = self.document.gltf
        still, used = ({gltf["nodes"][part.node].get("skin") for part in parts} for parts in (self.still, self.parts))
        skins = [skin for number, skin in enumerate(gltf["skins"]) if number in used or number not in still]
        return {joint for skin in skins for joint in skin["joints"]}

    def primitive(self, part: Part) -> Primitive:
        """Return a part's primitive in the document."""
        gltf = self.document.gltf
        return gltf["meshes"][gltf["nodes"][part.node]["mesh"]]["primitives"][part.primitive]

    def solver_mesh(self) -> SolverMesh:
        """Weld all parts into the solver's mesh."""
        return weld(self.vertices, self.triangles, self.document.name)


def load_character(path: Path, cache: Path | None = None) -> CharacterMesh:
    """Read a character from a glTF or surface file, whose format is recognised by content and then by ending.

    Parameters
    ----------
    path : Path
    cache : Path, optional
        Folder for converted surface files, see `engine_bridge.character.surface_document.read_document`.

    Raises
    ------
    MeshError
    """
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise MeshError(path, found=found, expected="a mesh", fix="Check the path to the character's mesh.")
    content = read_whole(path, "a mesh", MeshError)
    if content[:4] == MAGIC or content[:4096].lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        return from_document(load_document(path, content))
    return from_document(read_document(path, content, cache))


def make_character(
    title: str, vertices: NDArray[np.float64], triangles: NDArray[np.int64], colors: NDArray[np.floating] | None = None
) -> CharacterMesh:
    """Create a character of one surface.

    Parameters
    ----------
    title : str
        Name of its node and mesh.
    vertices : (n, 3) float64
    triangles : (t, 3) int64
    colors : (n, 3) float, optional
        Linear RGB.

    Raises
    ------
    MeshError
        There is no surface.
    """
    rgba = None if colors is None else np.column_stack([colors, np.ones(len(colors))])
    piece = Piece(title, vertices, triangles, material=material_for(rgba), colors=rgba)
    return from_document(assemble(shaded(Surface([piece]), title), title))


@np.errstate(over="ignore", invalid="ignore")  # positions that are not finite are refused
def from_document(document: Document) -> CharacterMesh:
    """Find the surfaces in a document's scene; mend its skins, see `mend_skins`.

    Raises
    ------
    MeshError
        There is no surface, data are inconsistent, or positions are not finite.
    """
    _check_size(document)
    mend_skins(document)
    world = world_transforms(document)
    parts = [part for node in shown_nodes(document) for part in _parts(document, node, world)]
    if not parts:
        raise MeshError(
            document.name,
            found="no triangles in the scene",
            expected="a character with triangles",
            fix="Export the mesh, not only cameras, lights, lines or points.",
        )
    return CharacterMesh(document, parts)


def _check_size(document: Document) -> None:
    """Refuse a huge scene, which a small file can have, because nodes can share meshes, and primitives arrays."""
    gltf = document.gltf
    parts = vertices = 0
    for node in shown_nodes(document):
        for primitive in gltf["meshes"][gltf["nodes"][node]["mesh"]]["primitives"]:
            parts += 1
            if "POSITION" in primitive["attributes"]:
                # a count beyond the file is refused when the array is read
                count = gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
                vertices += min(count, len(document.blob))
            if parts > MAX_PARTS or vertices > MAX_VERTICES:
                raise MeshError(
                    document.name,
                    found="a scene with too many parts or vertices",
                    expected=f"at most {MAX_PARTS:,} parts and {MAX_VERTICES:,} vertices",
                    fix="Export the character alone, or simplify it in an editor.",
                )


def _parts(document: Document, node: int, world: NDArray[np.float64]) -> Iterator[Part]:
    shown = document.gltf["nodes"][node]
    mesh = document.gltf["meshes"][shown["mesh"]]
    weights = rest_weights(shown, mesh)
    for index, primitive in enumerate(mesh["primitives"]):
        if "POSITION" not in primitive["attributes"]:
            continue
        count = _vertex_count(document, primitive)
        positions = _at_rest(document, primitive, "POSITION", count, weights)
        normals = _at_rest(document, primitive, "NORMAL", count, weights)
        triangles = _triangles(document, primitive, count)
        if positions is None or triangles is None:
            title = mesh.get("name") or shown.get("name") or f"mesh {shown['mesh']}"
            document.notes.append(f"{title}: points and lines are not moved")
            continue
        if triangles.size and not 0 <= triangles.min() <= triangles.max() < count:
            place = at(document.name, field=f"meshes[{shown['mesh']}].primitives[{index}].indices")
            raise damaged(place, f"vertex {int(triangles.max())} of {count}")
        to_world = world[None, node]
        if "skin" in shown:
            to_world = skinning(document, primitive, shown["skin"], count, world)
        if not (np.abs(to_world) <= MAX_COORDINATE).all():
            raise damaged(at(document.name, field=f"nodes[{node}]"), "a transform that is not finite")
        linear, offset = to_world[:, :3, :3], to_world[:, :3, 3]
        if np.linalg.det(linear).mean() < 0:  # a mirror turns triangles over
            triangles = triangles[:, ::-1]
        if normals is not None:
            normals = unit((normals[:, None] @ np.linalg.pinv(linear))[:, 0], otherwise=0.0)
        vertices = (linear @ positions[:, :, None])[:, :, 0] + offset
        if (bad := outside(vertices)).any():
            place = at(document.name, field=f"meshes[{shown['mesh']}].primitives[{index}].attributes.POSITION")
            vertex = int(bad.argmax())
            raise damaged(place, f"a position of vertex {vertex} that is not finite or too large")
        yield Part(
            node=node, primitive=index, to_world=to_world, vertices=vertices, triangles=triangles, normals=normals
        )


def _vertex_count(document: Document, primitive: Primitive) -> int:
    """Return the number of a primitive's vertices, which all of its attributes must have."""
    counts = {index: document.gltf["accessors"][index]["count"] for index in primitive["attributes"].values()}
    count = counts[primitive["attributes"]["POSITION"]]
    for index, other in counts.items():
        if other != count:
            raise damaged(at(document.name, field=f"accessors[{index}]"), f"{other:,} values for {count:,} vertices")
    return count


def rest_weights(node: Node, mesh: Mesh) -> list[float]:
    """Return the weights of a mesh's morph targets at rest: the node's, else the mesh's."""
    there = max((len(primitive.get("targets", [])) for primitive in mesh["primitives"]), default=0)
    weights = node.get("weights") or mesh.get("weights") or []
    return [*map(float, weights), *[0.0] * there][:there]


def _at_rest(
    document: Document, primitive: Primitive, name: str, count: int, weights: list[float]
) -> NDArray[np.float64] | None:
    """Return positions or normals in the primitive's space, with its morph targets at rest."""
    base = document.attribute(primitive, name, count, 3)
    if base is None:
        return None
    values = base.astype(np.float64)
    for target, weight in zip(primitive.get("targets", []), weights, strict=False):
        moved = document.attribute({"attributes": target}, name, count, 3) if weight else None
        if moved is not None:
            values += weight * moved
    return values


def _triangles(document: Document, primitive: Primitive, count: int) -> NDArray[np.int64] | None:
    """Return a primitive's triangles, or None for points and lines."""
    mode = primitive.get("mode", TRIANGLES)
    if mode not in (TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN):
        return None
    indices = np.arange(count)
    if "indices" in primitive:
        indices = document.array(primitive["indices"])
        if indices.ndim != 1 or indices.dtype.kind != "u":
            raise damaged(
                at(document.name, field=f"accessors[{primitive['indices']}]"), "indices that are not unsigned integers"
            )
        indices = indices.astype(np.int64)
    if mode == TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    first = indices[:-2] if mode == TRIANGLE_STRIP else np.full(max(len(indices) - 2, 0), indices[0])
    triangles = np.column_stack([first, indices[1:-1], indices[2:]])
    if mode == TRIANGLE_STRIP:
        triangles[1::2] = triangles[1::2, [1, 0, 2]]
    return triangles
