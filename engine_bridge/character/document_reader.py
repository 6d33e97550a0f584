"""Reads a glTF file as a document: joins and decompresses its buffers, and embeds the image files that it names."""

import io
from pathlib import Path
from typing import Any

from PIL import Image

from engine_bridge.character import draco, meshopt
from engine_bridge.character.document import ARRAY_BUFFER, COMPONENTS, ELEMENT_ARRAY_BUFFER, MESHOPT, Document
from engine_bridge.character.gltf_file import MAGIC, buffer_bytes, damaged, file_beside, parse_description, split_glb
from engine_bridge.character.schema import Buffer, BufferView
from puppetline.errors import MeshError
from puppetline.files import read_whole

IMAGE_SIGNATURES = {
    b"\x89PNG": "image/png",
    b"\xff\xd8": "image/jpeg",
    b"RIFF": "image/webp",
    b"\xabKTX 20": "image/ktx2",
}
"""First bytes of images, with their media types."""

DRACO = "KHR_draco_mesh_compression"

COMPRESSIONS = (DRACO, MESHOPT, "KHR_meshopt_compression")
"""Extensions that compress arrays."""

UNPACK_COMMAND = "npx @gltf-transform/cli copy IN.glb OUT.glb"
"""Command that decompresses the arrays of a file."""


def load_document(path: Path, content: bytes | None = None) -> Document:
    """Read a .glb or .gltf file with its buffers and images.

    Parameters
    ----------
    path : Path
    content : bytes, optional
        Content of that file if it has been read already.

    Raises
    ------
    MeshError
        The file is not glTF 2.0, is damaged, requires a decompression that is not installed, or names a missing buffer.
    """
    if content is None:
        content = read_whole(path, "a glTF file", MeshError)
    text, binary = split_glb(path, content) if content[:4] == MAGIC else (content, b"")
    description, nulls = parse_description(path, text)
    document = Document(description, name=str(path))
    if nulls:
        document.notes.append(f"Properties that are null are read as absent: {', '.join(nulls)}.")
    _drop_compressed(document)
    _join_buffers(document, path, binary)
    _decompress_primitives(document)
    _drop_decompressed(document)
    _embed_images(document, path)
    return document


def _drop_compressed(document: Document) -> None:
    """Refuse arrays that are only present compressed, and drop compressed copies of plain ones.

    A viewer that supports the extension would show the compressed copy, whose vertices have another order.
    """
    for extension in COMPRESSIONS:
        required = extension in document.gltf["extensionsRequired"]
        if required and (extension == DRACO or (extension == MESHOPT and meshopt.is_installed())):
            continue
        if required or _only_compressed(document, extension):
            install = (
                ", or install the package that reads it: pip install 'puppetline[meshopt]'"
                if extension == MESHOPT
                else ""
            )
            raise MeshError(
                document.name,
                found=f"data compressed with {extension}",
                expected="uncompressed arrays",
                fix=f"Decompress the file: {UNPACK_COMMAND}{install}",
            )
        for mesh in document.gltf["meshes"]:
            for primitive in mesh["primitives"]:
                primitive.get("extensions", {}).pop(extension, None)
        for packed in (*document.gltf["bufferViews"], *document.gltf["buffers"]):
            packed.get("extensions", {}).pop(extension, None)
        if extension in document.gltf["extensionsUsed"]:
            document.gltf["extensionsUsed"].remove(extension)
            document.notes.append(f"The copy of the mesh that is compressed with {extension} is omitted.")


def _only_compressed(document: Document, extension: str) -> bool:
    """Return whether positions of some primitive are only present in an extension."""
    return any(
        extension in primitive.get("extensions", {})
        and "bufferView" not in document.gltf["accessors"][primitive["attributes"]["POSITION"]]
        for mesh in document.gltf["meshes"]
        for primitive in mesh["primitives"]
        if "POSITION" in primitive["attributes"]
    )


def _join_buffers(document: Document, path: Path, binary: bytes) -> None:
    """Join all buffers into one, in which each file is stored once."""
    starts: list[int] = []
    joined: dict[Path | int, tuple[int, int]] = {}
    for number, buffer in enumerate(document.gltf["buffers"]):
        uri = buffer.get("uri")
        source = number if uri is None or uri.startswith("data:") else file_beside(path, uri) or number
        if source not in joined:
            start = document.append(buffer_bytes(path, uri, binary if number == 0 else b""))
            joined[source] = start, len(document.blob) - start
        start, length = joined[source]
        if length < buffer["byteLength"] and not _is_filled_by_decompression(buffer):
            raise damaged(path, f"{length:,} bytes of data of {buffer['byteLength']:,} announced")
        starts.append(start)
    for view in document.gltf["bufferViews"]:
        about = view.get("extensions", {}).pop(MESHOPT, None)
        if about is None:
            view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
        else:
            view["byteOffset"] = _decompress(document, view, about, starts)
        view["buffer"] = 0


def _decompress(document: Document, view: BufferView, about: Any, starts: list[int]) -> int:
    """Append the bytes of a compressed buffer view, and return where they begin."""
    try:
        start = starts[about["buffer"]] + about.get("byteOffset", 0)
        content = meshopt.decode(bytes(document.blob[start : start + about["byteLength"]]), about)
        if len(content) != view["byteLength"]:
            raise ValueError(f"{len(content):,} bytes for {view['byteLength']:,}")
    except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
        raise damaged(
            document.name, f"a buffer view compressed with {MESHOPT} that cannot be read ({error})"
        ) from error
    return document.append(content)


def _decompress_primitives(document: Document) -> None:
    """Append the arrays of primitives that are compressed by `DRACO`; some may share their compressed bytes."""
    accessors, views = document.gltf["accessors"], document.gltf["bufferViews"]
    compressed = set[int]()
    for primitive in [each for mesh in document.gltf["meshes"] for each in mesh["primitives"]]:
        about = primitive.get("extensions", {}).pop(DRACO, None)
        if about is None:
            continue
        try:
            corners, values = draco.decode(document.view(about["bufferView"]), about["attributes"])
            arrays = [(primitive["indices"], corners, ELEMENT_ARRAY_BUFFER)]
            arrays += [(primitive["attributes"][name], each, ARRAY_BUFFER) for name, each in values.items()]
            for index, array, target in arrays:
                accessor = accessors[index]
                if len(array) < accessor["count"]:  # three.js and others show what the compressed bytes hold
                    raise ValueError(f"{len(array):,} values for {accessor['count']:,}")
                document.add(array.astype(COMPONENTS[accessor["componentType"]]), target, bounds="min" in accessor)
                accessor.update({"byteOffset": 0, **accessors.pop()})
        except (AttributeError, KeyError, IndexError, TypeError, ValueError) as error:
            raise damaged(document.name, f"triangles compressed with {DRACO} that cannot be read ({error})") from error
        compressed.add(about["bufferView"])
    for index in compressed:  # so that other views keep their numbers, while `repack` drops the compressed bytes
        views[index] = {**views[-1]}


def _drop_decompressed(document: Document) -> None:
    """Drop the bytes and names of compressions that were decompressed, which are those that are required."""
    if {*COMPRESSIONS} & {*document.gltf["extensionsRequired"]}:
        for names in (document.gltf["extensionsRequired"], document.gltf["extensionsUsed"]):
            names[:] = [name for name in names if name not in COMPRESSIONS]
        document.repack()


def _embed_images(document: Document, path: Path) -> None:
    """Copy image files into the buffer, because the document may be written to another folder."""
    embedded: dict[Path | str, tuple[str, int]] = {}
    for image in document.gltf["images"]:
        uri = image.get("uri")
        if uri is None or uri.startswith("data:"):
            continue
        file = file_beside(path, uri)
        source = file or uri
        if source not in embedded:
            content = _image(document, file, uri)
            kind = next((kind for start, kind in IMAGE_SIGNATURES.items() if content.startswith(start)), None)
            embedded[source] = kind or image.get("mimeType", "image/jpeg"), document.add_view(content)
        if file:
            image.setdefault("name", file.stem)
        image["mimeType"], image["bufferView"] = embedded[source]
        del image["uri"]


def _image(document: Document, file: Path | None, uri: str) -> bytes:
    """Read an image; if it cannot be read, add a note and return a white pixel."""
    try:
        if file:
            return file.read_bytes()
        fault = "is not a file in the folder of the glTF"
    except FileNotFoundError:
        fault = "is missing"
    except OSError as error:
        fault = f"cannot be read ({error.strerror})"
    document.notes.append(f"The image {uri[:60]!r} {fault}; it is shown in white.")
    png = io.BytesIO()
    Image.new("RGB", (1, 1), "white").save(png, "PNG")
    return png.getvalue()


def _is_filled_by_decompression(buffer: Buffer) -> bool:
    """Return whether a buffer may lack its bytes in the file, because decompression fills it."""
    about = buffer.get("extensions", {}).get(MESHOPT)
    return isinstance(about, dict) and about.get("fallback") is True
