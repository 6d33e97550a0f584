"""Makes glTF documents of surfaces from files in other formats."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character import schema
from engine_bridge.character.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Document
from engine_bridge.character.schema import Primitive
from engine_bridge.character.surfaces.surface import ImageFile, Piece, Surface, SurfaceMaterial

MAX_UINT16_INDEX = 65534
"""Largest 16-bit index of a vertex, because 65535 restarts a strip."""


def assemble(surface: Surface, title: str, name: str | None = None) -> Document:
    """Make a glTF document of a surface.

    All pieces with the same name become one node with one mesh, in the order in which the names first appear. Each
    piece is a primitive with its own vertices and triangles. Materials and images are stored once. A surface far from
    the origin is stored relative to its middle, where float32 is exact enough, and its nodes are translated by the
    middle.

    Parameters
    ----------
    surface : Surface
        With unit normals, see `engine_bridge.character.shading.shaded`.
    title : str
        Name of the node and mesh of pieces without a name.
    name : str, optional
        Name of the document in error messages; `title` by default.

    Returns
    -------
    Document
        With the surface's notes.
    """
    document = Document(schema.empty(), name=name or title)
    document.notes += surface.notes
    gltf = document.gltf
    materials: dict[SurfaceMaterial, int] = {}
    textures: dict[ImageFile, int] = {}
    meshes: dict[str, list[Primitive]] = {}
    origin = surface.origin
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


def _primitive(document: Document, piece: Piece, origin: NDArray[np.float64]) -> Primitive:
    last = len(piece.positions) - 1
    indices = piece.triangles.ravel().astype(np.uint16 if last <= MAX_UINT16_INDEX else np.uint32)
    attributes = {"POSITION": document.add((piece.positions - origin).astype(np.float32), ARRAY_BUFFER, bounds=True)}
    if piece.normals is not None:
        attributes["NORMAL"] = document.add(piece.normals.astype(np.float32), ARRAY_BUFFER)
    if piece.uvs is not None:
        attributes["TEXCOORD_0"] = document.add(piece.uvs.astype(np.float32), ARRAY_BUFFER)
    if piece.colors is not None:
        # linear colours need more bits than sRGB
        colors = np.round(np.clip(piece.colors, 0, 1) * 65535).astype(np.uint16)
        attributes["COLOR_0"] = document.add(colors, ARRAY_BUFFER)
        document.gltf["accessors"][attributes["COLOR_0"]]["normalized"] = True
    return {"attributes": attributes, "indices": document.add(indices, ELEMENT_ARRAY_BUFFER)}


def _material(document: Document, material: SurfaceMaterial, textures: dict[ImageFile, int]) -> schema.Material:
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


def _texture(document: Document, image: ImageFile, textures: dict[ImageFile, int]) -> int:
    """Return the index of an image's texture, which is also the index of the image."""
    if image not in textures:
        textures[image] = len(textures)
        view = document.add_view(image.content)
        document.gltf["images"].append({"name": image.name, "mimeType": image.mime, "bufferView": view})
        document.gltf["textures"].append({"source": textures[image]})
    return textures[image]
