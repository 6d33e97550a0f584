"""A glTF document of a surface that came in another kind of file."""

import numpy as np

from engine_bridge.gltf import schema
from engine_bridge.gltf.document import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Document
from engine_bridge.gltf.schema import Primitive
from engine_bridge.surfaces.surface import Material, Picture, Piece, Surface

LARGEST_SHORT = 65534
"""The last vertex that a 16-bit index may name: 65535 restarts a strip."""


def assemble(surface: Surface, title: str, name: str | None = None) -> Document:
    """Make a glTF document of a surface.

    All pieces of one name become one node with one mesh, in the order in which the names first appear; each piece is a
    primitive with the vertices and triangles that it has. Materials and pictures are there once each.

    Parameters
    ----------
    surface : Surface
        With unit normals, see `engine_bridge.surfaces.shading.shaded`.
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
    for piece in surface.pieces:
        if piece.material not in materials:
            materials[piece.material] = len(gltf["materials"])
            gltf["materials"].append(_material(document, piece.material, textures))
        primitive = _primitive(document, piece)
        primitive["material"] = materials[piece.material]
        meshes.setdefault(piece.name or title, []).append(primitive)
    for index, (label, primitives) in enumerate(meshes.items()):
        gltf["meshes"].append({"name": label, "primitives": primitives})
        gltf["nodes"].append({"name": label, "mesh": index})
    gltf["scenes"], gltf["scene"] = [{"nodes": list(range(len(meshes)))}], 0
    return document


def _primitive(document: Document, piece: Piece) -> Primitive:
    last = len(piece.positions) - 1
    indices = piece.triangles.ravel().astype(np.uint16 if last <= LARGEST_SHORT else np.uint32)
    attributes = {"POSITION": document.add(piece.positions.astype(np.float32), ARRAY_BUFFER, bounds=True)}
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
