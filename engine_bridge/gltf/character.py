"""A character: a glTF document and the surfaces in it that are to move.

Whatever file a character comes in, it becomes a glTF document first, so that there is one way out. A document that was
glTF already keeps its materials, textures and nodes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import igl
import numpy as np
import pygltflib
from numpy.typing import NDArray
from pygltflib import GLTF2, Asset, Attributes, Material, Mesh, Node, PbrMetallicRoughness, Primitive, Scene
from scipy.spatial.transform import Rotation

from engine_bridge import obj
from engine_bridge.gltf.document import MAGIC, Document, damaged
from puppetline.errors import MeshError, at
from solver.mesh import SolverMesh, weld

SURFACE_FILES = (".obj", ".off", ".ply", ".stl")

UNPACKERS = {
    "KHR_draco_mesh_compression": "npx @gltf-transform/cli copy IN.glb OUT.glb",
    "EXT_meshopt_compression": "npx @gltf-transform/cli copy IN.glb OUT.glb",
    "KHR_mesh_quantization": "npx @gltf-transform/cli dequantize IN.glb OUT.glb",
}
"""Extensions under which positions are not plain floats, and what turns them into such."""


@dataclass(frozen=True)
class Part:
    """One primitive of one mesh as one node shows it.

    Attributes
    ----------
    node, primitive : int
        Index of the node in the document, of the primitive in the node's mesh.
    to_world : (4, 4) float64
        The node's transform, column vectors.
    vertices : (n, 3) float64
        World positions.
    triangles : (t, 3) int64
    normals : (n, 3) float64 or None
        World unit normals, None where the file has none.
    colors : (n, 3) float64 or None
        Linear RGB, for pictures.
    """

    node: int
    primitive: int
    to_world: NDArray[np.float64]
    vertices: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64] | None
    colors: NDArray[np.float64] | None


@dataclass(frozen=True)
class Character:
    """A character ready to be moved.

    Attributes
    ----------
    document : Document
    parts : list of Part
        Every surface of it, in the order of nodes and primitives.
    notes : list of str
        What had to be changed or left out when it was read.
    """

    document: Document
    parts: list[Part]
    notes: list[str] = field(default_factory=list)

    @property
    def vertices(self) -> NDArray[np.float64]:
        """(N, 3) float64: the world positions of all parts, one after another."""
        return np.concatenate([part.vertices for part in self.parts])

    @property
    def triangles(self) -> NDArray[np.int64]:
        """(T, 3) int64: the triangles of all parts as indices into `vertices`."""
        starts = np.cumsum([0] + [len(part.vertices) for part in self.parts])
        return np.concatenate([part.triangles + start for part, start in zip(self.parts, starts, strict=False)])

    @property
    def colors(self) -> NDArray[np.float64] | None:
        """(N, 3) linear RGB for pictures, or None where no part has a colour."""
        if all(part.colors is None for part in self.parts):
            return None
        grey = [np.full_like(part.vertices, 0.6) if part.colors is None else part.colors for part in self.parts]
        return np.concatenate(grey)

    def solver_mesh(self) -> SolverMesh:
        """Weld all parts into the surface that is solved for."""
        return weld(self.vertices, self.triangles, self.document.name)


def load_character(path: Path) -> Character:
    """Read a character from a glTF or surface file, found by content and then by ending.

    Raises
    ------
    MeshError
    """
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise MeshError(path, found=found, expected="a mesh", fix="Check the path to the character's mesh.")
    try:
        with path.open("rb") as file:
            head = file.read(4096)
    except OSError as error:
        raise MeshError(
            path,
            found=f"that it cannot be read ({error.strerror})",
            expected="a mesh",
            fix="Check the file's permissions.",
        ) from error
    if head[:4] == MAGIC or head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{"):
        document = Document.load(path)
        try:
            return _from_document(document)
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            # pygltflib hands over whatever the JSON says: indices that lead nowhere, texts for numbers
            raise damaged(path, f"a description that contradicts itself ({error})") from error
    if path.suffix.lower() not in SURFACE_FILES:
        raise MeshError(
            path,
            found=f"a file of kind {path.suffix or 'unknown'!r}",
            expected=f".glb, .gltf, {', '.join(SURFACE_FILES)}",
            fix="Export the character as .glb from your editor.",
        )
    vertices, triangles, colors = obj.read(path) if path.suffix.lower() == ".obj" else _read_surface(path)
    return make_character(path.stem, vertices, triangles, colors, name=str(path))


def _read_surface(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64], None]:
    try:
        vertices, triangles = igl.read_triangle_mesh(str(path))[:2]
        return np.reshape(vertices, (-1, 3)).astype(np.float64), np.reshape(triangles, (-1, 3)).astype(np.int64), None
    except (RuntimeError, ValueError) as error:
        raise MeshError(
            path,
            found=f"content that is no {path.suffix} mesh ({error})",
            expected="a whole mesh file",
            fix="Export the mesh again.",
        ) from error


def make_character(
    title: str,
    vertices: NDArray[np.float64],
    triangles: NDArray[np.int64],
    colors: NDArray[np.floating] | None = None,
    *,
    name: str | None = None,
) -> Character:
    """Make a character of one plain surface.

    Parameters
    ----------
    title : str
        Name of its node and mesh.
    vertices : (n, 3) float64
    triangles : (t, 3) int64
    colors : (n, 3) float, optional
        Linear RGB.
    name : str, optional
        What error messages call it.

    Raises
    ------
    MeshError
        No surface.
    """
    document = Document(GLTF2(asset=Asset(version="2.0", generator="puppetline")), name=name or title)
    mesh = weld(vertices, triangles, document.name)
    normals = igl.per_vertex_normals(mesh.vertices, mesh.faces)[mesh.of_render]
    normals = np.where(np.isfinite(normals).all(axis=1, keepdims=True), normals, [0.0, 1.0, 0.0])
    attributes = Attributes(
        POSITION=document.add(vertices.astype(np.float32), pygltflib.ARRAY_BUFFER, bounds=True),
        NORMAL=document.add(_unit(normals).astype(np.float32), pygltflib.ARRAY_BUFFER),
    )
    if colors is not None:
        rgba = np.column_stack([np.clip(colors, 0, 1), np.ones(len(colors))])
        attributes.COLOR_0 = document.add(np.round(rgba * 255).astype(np.uint8), pygltflib.ARRAY_BUFFER)
        document.gltf.accessors[attributes.COLOR_0].normalized = True
    indices = document.add(triangles.astype(np.uint32).ravel(), pygltflib.ELEMENT_ARRAY_BUFFER)
    surface = PbrMetallicRoughness(
        baseColorFactor=[1.0, 1.0, 1.0, 1.0] if colors is not None else [0.62, 0.6, 0.57, 1.0],
        metallicFactor=0.0,
        roughnessFactor=0.7,
    )
    gltf = document.gltf
    gltf.materials = [Material(name=title, pbrMetallicRoughness=surface)]
    gltf.meshes = [Mesh(name=title, primitives=[Primitive(attributes=attributes, indices=indices, material=0)])]
    gltf.nodes = [Node(name=title, mesh=0)]
    gltf.scenes, gltf.scene = [Scene(nodes=[0])], 0
    return _from_document(document)


def _from_document(document: Document) -> Character:
    for extension in document.gltf.extensionsRequired or []:
        if extension in UNPACKERS:
            raise MeshError(
                document.name,
                found=f"data packed with {extension}",
                expected="plain floats",
                fix=f"Unpack it first: {UNPACKERS[extension]}",
            )
    notes: list[str] = []
    parts = [part for node, to_world in _shown_nodes(document) for part in _parts(document, node, to_world, notes)]
    if not parts:
        raise MeshError(
            document.name,
            found="no triangles in the scene",
            expected="a character with a surface",
            fix="Export the mesh itself, not only cameras, lights, lines or points.",
        )
    return Character(document, parts, notes)


def top_nodes(gltf: GLTF2) -> list[int]:
    """Return the nodes of the shown scene, or those that are nobody's children where a file has no scene."""
    if gltf.scenes:
        return list(gltf.scenes[gltf.scene or 0].nodes or [])
    children = {child for node in gltf.nodes for child in node.children or []}
    return [index for index in range(len(gltf.nodes)) if index not in children]


def _shown_nodes(document: Document) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """Walk the shown scene: each node that has a mesh, with its world transform, in the order of the file."""
    gltf = document.gltf
    waiting = [(root, np.eye(4)) for root in reversed(top_nodes(gltf))]
    seen: set[int] = set()
    while waiting:
        index, above = waiting.pop()
        if index in seen or not 0 <= index < len(gltf.nodes):
            raise MeshError(
                at(document.name, field=f"nodes[{index}]"),
                found="a node that is its own ancestor, is shared, or is not there",
                expected="a tree of nodes",
                fix="The file is damaged: export it again.",
            )
        seen.add(index)
        node = gltf.nodes[index]
        to_world = above @ _local_transform(node)
        if node.mesh is not None:
            yield index, to_world
        waiting.extend((child, to_world) for child in reversed(node.children or []))


def _local_transform(node: Node) -> NDArray[np.float64]:
    if node.matrix is not None:
        return np.array(node.matrix, dtype=np.float64).reshape(4, 4).T
    transform = np.eye(4)
    turn = Rotation.from_quat(node.rotation).as_matrix() if node.rotation else np.eye(3)
    transform[:3, :3] = turn * np.array(node.scale or [1.0, 1.0, 1.0])
    transform[:3, 3] = node.translation or [0.0, 0.0, 0.0]
    return transform


def _parts(document: Document, node: int, to_world: NDArray[np.float64], notes: list[str]) -> Iterator[Part]:
    shown = document.gltf.nodes[node]
    mesh = document.gltf.meshes[shown.mesh]
    title = mesh.name or shown.name or f"mesh {shown.mesh}"
    if shown.skin is not None:
        raise MeshError(
            at(document.name, field=f"nodes[{node}].skin"),
            found=f"{title!r} bound to a skeleton",
            expected="a mesh without a rig",
            fix="Apply the armature in your editor and export without it; Puppetline needs no rig.",
        )
    for index, primitive in enumerate(mesh.primitives):
        if primitive.attributes.POSITION is None:
            continue
        positions = document.array(primitive.attributes.POSITION).astype(np.float64)
        triangles = _triangles(document, primitive, len(positions))
        if triangles is None:
            notes.append(f"{title}: points or lines stay where they are")
            continue
        normals = _values(document, primitive, "NORMAL", len(positions))
        colors = _values(document, primitive, "COLOR_0", len(positions))
        if triangles.size and not 0 <= triangles.min() <= triangles.max() < len(positions):
            raise damaged(
                at(document.name, field=f"meshes[{shown.mesh}].primitives[{index}].indices"),
                f"vertex {int(triangles.max())} of {len(positions)}",
            )
        linear, offset = to_world[:3, :3], to_world[:3, 3]
        if np.linalg.det(linear) < 0:  # a mirror turns triangles over
            triangles = triangles[:, ::-1]
        yield Part(
            node=node,
            primitive=index,
            to_world=to_world,
            vertices=positions @ linear.T + offset,
            triangles=triangles,
            normals=None if normals is None else _unit(normals @ np.linalg.pinv(linear)),
            colors=_colors(document, primitive, colors, len(positions)),
        )


def _values(document: Document, primitive: Primitive, name: str, count: int) -> NDArray[Any] | None:
    """Return an attribute's values, one for each of the primitive's vertices, or None where it has no such."""
    accessor = getattr(primitive.attributes, name)
    if accessor is None:
        return None
    values = document.array(accessor)
    if len(values) != count:
        raise damaged(at(document.name, field=f"accessors[{accessor}]"), f"{len(values)} values for {count} vertices")
    return values


def _triangles(document: Document, primitive: Primitive, count: int) -> NDArray[np.int64] | None:
    """Return a primitive's triangles, or None where it is made of points or lines."""
    indices = np.arange(count) if primitive.indices is None else document.array(primitive.indices).astype(np.int64)
    mode = pygltflib.TRIANGLES if primitive.mode is None else primitive.mode
    if mode == pygltflib.TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if mode == pygltflib.TRIANGLE_STRIP:
        strip = np.column_stack([indices[:-2], indices[1:-1], indices[2:]])
        strip[1::2] = strip[1::2, [1, 0, 2]]
        return strip
    if mode == pygltflib.TRIANGLE_FAN:
        return np.column_stack([np.full(len(indices) - 2, indices[0]), indices[1:-1], indices[2:]])
    return None


def _colors(
    document: Document, primitive: Primitive, own: NDArray[Any] | None, count: int
) -> NDArray[np.float64] | None:
    """Return what a picture can show of a primitive's look: vertex colours times the material's base colour."""
    material = document.gltf.materials[primitive.material] if primitive.material is not None else None
    surface = material.pbrMetallicRoughness if material else None
    if own is None and surface is None:
        return None
    base = np.array((surface.baseColorFactor if surface else None) or [1.0] * 4, dtype=np.float64)[:3]
    return base * (np.ones((count, 3)) if own is None else own[:, :3])


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-30)
