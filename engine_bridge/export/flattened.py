"""A character at rest as plain surfaces, for shaders that move vertices.

Such a shader needs positions in the file's coordinates, and numbers at each vertex. The document has no transforms of
nodes, no skeleton, no morph targets and no animations. Its materials and images are those of the character.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character import schema
from engine_bridge.character.assembly import MAX_UINT16_INDEX
from engine_bridge.character.character import CharacterMesh, Part
from engine_bridge.character.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Document
from engine_bridge.character.schema import Mesh, Primitive, copied
from engine_bridge.character.shading import unit
from puppetline.errors import MeshError, at

KEPT_SETS = 2
"""Number of the character's sets of texture coordinates that are kept; engines read no others."""

APPEARANCE_KEYS = ("asset", "materials", "textures", "samplers", "images")
"""Keys of a document's description that are copied."""


def flatten(character: CharacterMesh, normals: NDArray[np.floating], sets: Sequence[NDArray[np.float32]]) -> Document:
    """Return a document of a character at rest.

    Each node that shows a surface becomes a node without a transform. Each part becomes a primitive with its vertices,
    texture coordinates, colours and tangents in the same order.

    Parameters
    ----------
    character : CharacterMesh
    normals : (N, 3) float
        Unit normals of all parts, one after another; zero for vertices without a direction.
    sets : sequence of (N, 2) float32
        Values of TEXCOORD_2 and the following sets.

    Returns
    -------
    Document

    Raises
    ------
    MeshError
        An image of a material uses a set of texture coordinates that is replaced.
    """
    document = _with_the_look_of(character.document)
    meshes: dict[int, Mesh] = {}
    for part, place in zip(character.parts, character.vertex_slices, strict=True):
        if part.node not in meshes:
            meshes[part.node] = _new_mesh(document, character, part)
        own = character.primitive(part)
        primitive = _primitive(document, character, part, normals[place], [values[place] for values in sets])
        if "material" in own:
            primitive["material"] = own["material"]
        meshes[part.node]["primitives"].append(primitive)
    document.gltf["scenes"] = [{"nodes": list(range(len(meshes)))}]
    document.gltf["scene"] = 0
    return document


def _with_the_look_of(source: Document) -> Document:
    """Return a document with the materials and images of another one, and no nodes."""
    whole: dict[str, Any] = {**source.gltf}
    look: Any = copied({name: whole[name] for name in APPEARANCE_KEYS if name in whole})
    for index, material in enumerate(look["materials"]):
        if max(_values(material, "texCoord"), default=0) >= KEPT_SETS:
            raise MeshError(
                at(source.name, field=f"materials[{index}]"),
                found="an image on the third or a later set of texture coordinates",
                expected="images on the first or second set, because isoline coordinates use the others",
                fix="Assign the image to the first set in an editor.",
            )
    document = Document(schema.empty(), name=source.name)
    document.gltf.update(look)
    for image in document.gltf["images"]:
        if "bufferView" in image:
            image["bufferView"] = document.add_view(source.view(image["bufferView"]))
    used = {name for extensions in _values(look, "extensions") for name in extensions}
    document.gltf["extensionsUsed"] = [name for name in source.gltf["extensionsUsed"] if name in used]
    document.gltf["extensionsRequired"] = [name for name in source.gltf["extensionsRequired"] if name in used]
    return document


def _values(json: Any, name: str) -> Iterable[Any]:
    """Yield all values of a key in nested JSON."""
    waiting = [json]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            if name in value:
                yield value[name]
            waiting.extend(value.values())
        elif isinstance(value, list):
            waiting.extend(value)


def _new_mesh(document: Document, character: CharacterMesh, part: Part) -> Mesh:
    """Add a node and an empty mesh, with the names of a part's node and mesh; return the mesh."""
    node = character.document.gltf["nodes"][part.node]
    shown = character.document.gltf["meshes"][node["mesh"]]
    mesh: Mesh = {"primitives": []}
    document.gltf["meshes"].append(mesh)
    document.gltf["nodes"].append({"mesh": len(document.gltf["meshes"]) - 1})
    if "name" in shown:
        mesh["name"] = shown["name"]
    if "name" in node:
        document.gltf["nodes"][-1]["name"] = node["name"]
    return mesh


def _primitive(
    document: Document,
    character: CharacterMesh,
    part: Part,
    normals: NDArray[np.floating],
    sets: Sequence[NDArray[np.float32]],
) -> Primitive:
    source, own, count = character.document, character.primitive(part), len(part.vertices)
    # glTF requires unit normals
    directed = np.where(normals.any(axis=1, keepdims=True), normals, [0.0, 1.0, 0.0])
    none = np.zeros((count, 2), np.float32)
    texture = [source.attribute(own, f"TEXCOORD_{number}", count, 2) for number in range(KEPT_SETS)]
    # glTF requires consecutive sets
    numbered = [*(none if values is None else values for values in texture), *sets]
    arrays = {
        "NORMAL": directed,
        "TANGENT": _tangents(source, own, part),
        **{f"TEXCOORD_{number}": values for number, values in enumerate(numbered)},
        "COLOR_0": source.attribute(own, "COLOR_0", count, 3, 4),
    }
    attributes = {"POSITION": document.add(part.vertices.astype(np.float32), ARRAY_BUFFER, bounds=True)}
    for name, values in arrays.items():
        if values is not None:
            attributes[name] = document.add(values.astype(np.float32), ARRAY_BUFFER)
    indices = part.triangles.ravel().astype(np.uint16 if count - 1 <= MAX_UINT16_INDEX else np.uint32)
    return {"attributes": attributes, "indices": document.add(indices, ELEMENT_ARRAY_BUFFER)}


def _tangents(source: Document, own: Primitive, part: Part) -> NDArray[np.float64] | None:
    """Return a part's tangents (n, 4) in file coordinates, None without normals or tangents."""
    tangents = source.attribute(own, "TANGENT", len(part.vertices), 4)
    if tangents is None or part.normals is None:
        return None
    linear = part.to_world[:, :3, :3]
    turned = unit((linear @ tangents[:, :3, None].astype(np.float64))[:, :, 0], otherwise=[1.0, 0.0, 0.0])
    # a mirror flips normal × tangent, but not the third direction
    side = np.where(tangents[:, 3] < 0, -1.0, 1.0) * np.where(np.linalg.det(linear) < 0, -1.0, 1.0)
    return np.column_stack([turned, side])
