"""A glTF document with all its bytes in one buffer: arrays out of accessors, arrays into new ones."""

import base64
import binascii
import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pygltflib
from numpy.typing import NDArray
from pygltflib import GLTF2, Accessor, Buffer, BufferView, Image

from engine_bridge.files import written_whole
from puppetline.errors import MeshError, at

COMPONENTS: dict[int, type] = {
    pygltflib.BYTE: np.int8,
    pygltflib.UNSIGNED_BYTE: np.uint8,
    pygltflib.SHORT: np.int16,
    pygltflib.UNSIGNED_SHORT: np.uint16,
    pygltflib.UNSIGNED_INT: np.uint32,
    pygltflib.FLOAT: np.float32,
}
LARGEST = {pygltflib.BYTE: 127, pygltflib.UNSIGNED_BYTE: 255, pygltflib.SHORT: 32767, pygltflib.UNSIGNED_SHORT: 65535}
"""What 1.0 is stored as in normalised accessors."""
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
KINDS = {1: pygltflib.SCALAR, 2: pygltflib.VEC2, 3: pygltflib.VEC3, 4: pygltflib.VEC4}

MAGIC = b"glTF"


class Document:
    """A glTF document being read or made.

    Attributes
    ----------
    gltf : GLTF2
        The JSON part, as pygltflib's classes.
    blob : bytearray
        The one binary buffer.
    name : str
        What error messages call it.
    """

    def __init__(self, gltf: GLTF2, blob: bytes = b"", name: str = "document") -> None:
        self.gltf = gltf
        self.blob = bytearray(blob)
        self.name = name

    @classmethod
    def load(cls, path: Path) -> "Document":
        """Read a .glb or .gltf file with its buffers.

        Raises
        ------
        MeshError
            Not glTF 2.0, damaged, or a buffer that is missing.
        """
        try:
            content = path.read_bytes()
        except OSError as error:
            raise MeshError(
                path, found=f"that it cannot be read ({error.strerror})", expected="a glTF file", fix="Check the path."
            ) from error
        text, binary = _chunks(path, content) if content[:4] == MAGIC else (content, b"")
        try:
            gltf = GLTF2.from_json(json.dumps(json.loads(text)))
            sizes = [int(buffer.byteLength) for buffer in gltf.buffers]
        except Exception as error:  # pygltflib lets KeyError, TypeError and others through
            raise damaged(path, f"a description that is not glTF JSON ({error})") from error
        document = cls(gltf, name=str(path))
        starts = []
        for buffer, size in zip(gltf.buffers, sizes, strict=True):
            starts.append(document._pad())
            document.blob += _buffer_bytes(path, buffer, size, binary)
        try:
            for view in gltf.bufferViews:
                view.byteOffset = (view.byteOffset or 0) + starts[view.buffer]
                view.byteLength = int(view.byteLength)
                view.buffer = 0
        except (AttributeError, LookupError, TypeError, ValueError) as error:
            raise damaged(at(path, field="bufferViews"), "a part of a buffer that is not there") from error
        document._take_in_images(path)
        return document

    def _take_in_images(self, path: Path) -> None:
        """Bring pictures that lie beside the file into the buffer: the result may be written elsewhere."""
        for index, image in enumerate(self.gltf.images):
            if image.uri is None or image.uri.startswith("data:"):
                continue
            content = _file_beside(path, image.uri)
            start = self._pad()
            self.blob += content
            self.gltf.bufferViews.append(BufferView(buffer=0, byteOffset=start, byteLength=len(content)))
            kind = "image/png" if content.startswith(b"\x89PNG") else "image/jpeg"
            name = image.name or Path(unquote(image.uri)).stem
            self.gltf.images[index] = Image(bufferView=len(self.gltf.bufferViews) - 1, mimeType=kind, name=name)

    def array(self, index: int) -> NDArray[Any]:
        """Return an accessor's values, normalised integers as floats.

        Returns
        -------
        (count,) or (count, width)

        Raises
        ------
        MeshError
            An accessor that points outside the buffer, or one of a kind that is not supported.
        """
        place = f"accessors[{index}]"
        try:
            accessor = self.gltf.accessors[index]
            dtype, width = np.dtype(COMPONENTS[accessor.componentType]), WIDTHS[accessor.type]
            view = self.gltf.bufferViews[accessor.bufferView] if accessor.bufferView is not None else None
        except (IndexError, KeyError, TypeError) as error:
            raise damaged(at(self.name, field=place), "a reference to something that is not there") from error
        if accessor.sparse is not None or view is None:
            raise MeshError(
                at(self.name, field=place),
                found="a sparse accessor",
                expected="plain arrays",
                fix="Export the file without sparse accessors.",
            )
        start = view.byteOffset + (accessor.byteOffset or 0)
        row = dtype.itemsize * width
        stride = view.byteStride or row
        if accessor.count < 1 or start + stride * (accessor.count - 1) + row > len(self.blob):
            raise damaged(at(self.name, field=place), f"{accessor.count} values that lie outside the file's data")
        values = np.ndarray(
            (accessor.count, width), dtype, buffer=self.blob, offset=start, strides=(stride, dtype.itemsize)
        )
        if accessor.normalized:
            values = np.maximum(values / np.float32(LARGEST[accessor.componentType]), np.float32(-1))
        return np.array(values[:, 0] if width == 1 else values)

    def add(self, values: NDArray[Any], target: int | None = None, *, bounds: bool = False) -> int:
        """Append an array and return its accessor's index.

        Parameters
        ----------
        values : (count,) or (count, 2…4) float32, uint8, uint16 or uint32
        target : int, optional
            pygltflib.ARRAY_BUFFER or ELEMENT_ARRAY_BUFFER for data of a mesh.
        bounds : bool
            Store minimum and maximum, which positions and key times need.
        """
        component = next(code for code, kind in COMPONENTS.items() if np.dtype(kind) == values.dtype)
        start = self._pad()
        self.blob += np.ascontiguousarray(values).tobytes()
        self.gltf.bufferViews.append(
            BufferView(buffer=0, byteOffset=start, byteLength=len(self.blob) - start, target=target)
        )
        columns = values.reshape(len(values), -1)
        accessor = Accessor(
            bufferView=len(self.gltf.bufferViews) - 1,
            componentType=component,
            count=len(values),
            type=KINDS[columns.shape[1]],
        )
        if bounds:
            accessor.min = [float(value) for value in columns.min(axis=0)]
            accessor.max = [float(value) for value in columns.max(axis=0)]
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1

    def save(self, path: Path) -> None:
        """Write a .glb, whole or not at all.

        Raises
        ------
        OutputError
        """
        self._pad()
        self.gltf.buffers = [Buffer(byteLength=len(self.blob))]
        self.gltf.set_binary_blob(bytes(self.blob))
        with written_whole(path) as beside:
            beside.write_bytes(b"".join(self.gltf.save_to_bytes()))

    def _pad(self) -> int:
        """Fill up to the alignment that every component type is content with; return the length."""
        self.blob += bytes(-len(self.blob) % 4)
        return len(self.blob)


def _chunks(path: Path, content: bytes) -> tuple[bytes, bytes]:
    """Split a .glb into its JSON and its binary chunk."""
    version, length = np.frombuffer(content[4:12].ljust(8, b"\0"), "<u4")
    if version != 2 or length > len(content):
        raise damaged(path, f"glTF version {version}, {length:,} bytes announced and {len(content):,} there")
    chunks: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= length:
        size = int.from_bytes(content[place : place + 4], "little")
        chunks.setdefault(content[place + 4 : place + 8], content[place + 8 : place + 8 + size])
        place += 8 + size
    if b"JSON" not in chunks:
        raise damaged(path, "no JSON chunk")
    return chunks[b"JSON"], chunks.get(b"BIN\0", b"")


def _buffer_bytes(path: Path, buffer: Buffer, size: int, binary: bytes) -> bytes:
    """Return one buffer's bytes: the binary chunk, a data URI, or a file in the same folder or below."""
    uri = buffer.uri
    if uri is None:
        found = binary
    elif uri.startswith("data:"):
        try:
            found = base64.b64decode(uri.partition(",")[2], validate=True)
        except binascii.Error as error:
            raise damaged(path, f"a data URI that is not base64 ({error})") from error
    else:
        found = _file_beside(path, uri)
    if len(found) < size:
        raise damaged(path, f"{len(found):,} bytes of data of {size:,} announced")
    return found[:size]


def _file_beside(path: Path, uri: str) -> bytes:
    """Read a file that a glTF names, which must lie in its folder or below."""
    try:
        file = (path.parent / unquote(uri)).resolve(strict=True)
        if not file.is_relative_to(path.parent.resolve()):
            raise ValueError(uri)
        return file.read_bytes()
    except (OSError, ValueError) as error:  # ValueError for a zero byte in the name, too
        raise MeshError(
            path,
            found=f"a reference to {uri!r}, which is not a file beside it",
            expected="all buffers and pictures in the file's own folder",
            fix="Copy those files beside it, or export as .glb.",
        ) from error


def damaged(where: str | Path, found: str) -> MeshError:
    """Make the error for a file that cannot be what was exported."""
    return MeshError(where, found=found, expected="a whole glTF 2.0 file", fix="Export or download the file again.")
