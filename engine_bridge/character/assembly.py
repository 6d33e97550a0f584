"""A glTF document of a surface that came in another kind of file."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character import schema
from engine_bridge.character.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Document
from engine_bridge.character.schema import Primitive
from engine_bridge.character.surfaces.surface import Material, Picture, Piece, Surface

MAX_UINT16_INDEX = 65534
"""The last vertex that a 16-bit index may name: 65535 restarts a strip."""

MAX_ORIGIN_DISTANCE = 10.0
"""Diagonals from the origin beyond which a float32 position is off by more than some 1e-6 of the diagonal."""


def assemble(surface: Surface, title: str, name: str | None = None) -> Document:
    """Make a glTF document of a surface.

    All pieces of one name become one node with one mesh, in the order in which the names first appear; each piece is a
    primitive with the vertices and triangles that it has. Materials and pictures are there once each. A surface far
    from the origin is stored around its own middle, where float32 is exact enough, and its nodes carry it there.

    Parameters
    ----------
    surface : Surface
        With unit normals, see `engine_bridge.character.shading.shaded`.
    title : str
        Name of pieces that have none.
    name : str, optional
        What error messages call the document, if not its title.

    Returns
    -------
    Document
        With the surface's notes.
    """
    document = Document(schema.empty(), name=name or title)
    document.notes += surface.notes
    gltf = document.gltf
    materials: dict[Material, int] = {}
    textures: dict[Picture, int] = {}
    meshes: dict[str, list[Primitive]] = {}
    origin = _origin(surface)
    for piece in surface.pieces:
        if piece.material not in materials:
            materials[piece.material] = len(gltf["materials"])
            gltf["materials"].append(_material(document, piece.material, textures))
        primitive = _primitive(document, piece, origin)
        primitive["material"] = materials[piece.material]
        meshes.setdefault(piece.name or title, []).append(primitive)
    for index, (label, primitives) in enumerate(meshes.items()):
        gltf["meshes"].append({"name": label, "primitives": primitives})
        gltf["nodes"].append({"name": label, "mesh": index})
        if origin.any():
            gltf["nodes"][index]["translation"] = origin.tolist()
    gltf["scenes"], gltf["scene"] = [{"nodes": list(range(len(meshes)))}], 0
    return document


def _origin(surface: Surface) -> NDArray[np.float64]:
    """Return where positions are stored from: the world's origin, or a far surface's middle, a float32 exactly."""
    low = np.min([piece.positions.min(axis=0) for piece in surface.pieces], axis=0)
    high = np.max([piece.positions.max(axis=0) for piece in surface.pieces], axis=0)
    middle = (low + high) / 2
    if np.linalg.norm(middle) > MAX_ORIGIN_DISTANCE * np.linalg.norm(high - low):
        return middle.astype(np.float32).astype(np.float64)
    return np.zeros(3)


def _primitive(document: Document, piece: Piece, origin: NDArray[np.float64]) -> Primitive:
    last = len(piece.positions) - 1
    indices = piece.triangles.ravel().astype(np.uint16 if last <= MAX_UINT16_INDEX else np.uint32)
    attributes = {"POSITION": document.add((piece.positions - origin).astype(np.float32), ARRAY_BUFFER, bounds=True)}
    if piece.normals is not None:
        attributes["NORMAL"] = document.add(piece.normals.astype(np.float32), ARRAY_BUFFER)
    if piece.uvs is not None:
        attributes["TEXCOORD_0"] = document.add(piece.uvs.astype(np.float32), ARRAY_BUFFER)
    if piece.colors is not None:
        # linear light needs more than the 8 bits that sRGB does with
        colors = np.round(np.clip(piece.colors, 0, 1) * 65535).astype(np.uint16)
        attributes["COLOR_0"] = document.add(colors, ARRAY_BUFFER)
        document.gltf["accessors"][attributes["COLOR_0"]]["normalized"] = True
    return {"attributes": attributes, "indices": document.add(indices, ELEMENT_ARRAY_BUFFER)}


def _material(document: Document, material: Material, textures: dict[Picture, int]) -> schema.Material:
    surface: schema.Surface = {
        "baseColorFactor": list(material.base_color),
        "metallicFactor": material.metallic,
        "roughnessFactor": material.roughness,
    }
    made: schema.Material = {"pbrMetallicRoughness": surface, "doubleSided": material.double_sided}
    if material.name:
        made["name"] = material.name
    if material.texture:
        surface["baseColorTexture"] = {"index": _texture(document, material.texture, textures)}
    if material.normal_texture:
        made["normalTexture"] = {"index": _texture(document, material.normal_texture, textures)}
    if any(material.emissive):
        made["emissiveFactor"] = list(material.emissive)
    if material.alpha_mode != "OPAQUE":
        made["alphaMode"] = material.alpha_mode
    return made


def _texture(document: Document, picture: Picture, textures: dict[Picture, int]) -> int:
    """Return the index of a picture's texture, which is also that of its image."""
    if picture not in textures:
        textures[picture] = len(textures)
        view = document.add_view(picture.content)
        document.gltf["images"].append({"name": picture.name, "mimeType": picture.mime, "bufferView": view})
        document.gltf["textures"].append({"source": textures[picture]})
    return textures[picture]
