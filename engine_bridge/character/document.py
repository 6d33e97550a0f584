"""A glTF document with all its bytes in one buffer: arrays out of accessors, arrays into new ones."""

import base64
import binascii
import io
import json
import re
import struct
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from engine_bridge.character import schema
from engine_bridge.character.schema import Accessor, BufferView, Gltf, Kind, Primitive
from puppetline.errors import MeshError, OutputError, at
from puppetline.files import read_whole, written_whole

COMPONENTS: dict[int, type] = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
TYPE_WIDTHS: dict[Kind, int] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
ACCESSOR_TYPES: dict[int, Kind] = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963

MAGIC = b"glTF"
MAX_GLB_BYTES = 2**32 - 1
"""Bytes; a .glb states its length in 32 bits."""

IMAGE_SIGNATURES = {
    b"\x89PNG": "image/png",
    b"\xff\xd8": "image/jpeg",
    b"RIFF": "image/webp",
    b"\xabKTX 20": "image/ktx2",
}
"""How pictures begin."""

INTEGER_NUMBER = re.compile(r"-?[1-9][0-9]*\.0+|0\.0+")
"""A whole number with a fraction of zero: where glTF wants an integer, it is one."""

SPARE_NESTING_LEVELS = 200
"""How much deeper than a file's its description could be nested."""

UNPACK_COMMANDS = {
    "KHR_draco_mesh_compression": "npx @gltf-transform/cli copy IN.glb OUT.glb",
    "EXT_meshopt_compression": "npx @gltf-transform/cli copy IN.glb OUT.glb",
    "KHR_meshopt_compression": "npx @gltf-transform/cli copy IN.glb OUT.glb",
}
"""Extensions that pack arrays, and what unpacks them."""


class Document:
    """A glTF document being read or made.

    Attributes
    ----------
    gltf : Gltf
        The description, as plain JSON.
    blob : bytearray
        The one binary buffer.
    name : str
        What error messages call it.
    notes : list of str
        What had to be changed or left out when it was read.
    """

    def __init__(self, gltf: Gltf, blob: bytes | bytearray = b"", name: str = "document") -> None:
        self.gltf = gltf
        self.blob = bytearray(blob)
        self.name = name
        self.notes: list[str] = []

    @classmethod
    def load(cls, path: Path, content: bytes | None = None) -> "Document":
        """Read a .glb or .gltf file with its buffers and pictures.

        Parameters
        ----------
        path : Path
        content : bytes, optional
            Of that file, where it has been read already.

        Raises
        ------
        MeshError
            Not glTF 2.0, damaged, packed, or a file beside it that is missing.
        """
        if content is None:
            content = read_whole(path, "a glTF file", MeshError)
        text, binary = _chunks(path, content) if content[:4] == MAGIC else (content, b"")
        description, nulls = _description(path, text)
        document = cls(description, name=str(path))
        if nulls:
            document.notes.append(f"Properties that are null are read as absent: {', '.join(nulls)}.")
        document._refuse_packed()
        document._take_in_buffers(path, binary)
        document._take_in_images(path)
        return document

    def copy(self) -> "Document":
        """Return a document that can be changed without changing this one."""
        return Document(schema.copied(self.gltf), self.blob, self.name)

    def array(self, index: int) -> NDArray[Any]:
        """Return an accessor's values, normalised integers as floats.

        Returns
        -------
        (count,) or (count, width)

        Raises
        ------
        MeshError
            An accessor that points outside the buffer.
        """
        accessor, where = self.gltf["accessors"][index], at(self.name, field=f"accessors[{index}]")
        dtype, width, count = (
            _component(accessor["componentType"], where),
            TYPE_WIDTHS[accessor["type"]],
            accessor["count"],
        )
        if not count:
            raise damaged(where, "no values")
        if "bufferView" in accessor:
            values = self._strided(accessor["bufferView"], accessor.get("byteOffset", 0), (count, width), dtype, where)
        elif count > len(self.blob):  # all zeros, whose number nothing in the file vouches for
            raise damaged(where, f"{count:,} values in a file of {len(self.blob):,} bytes")
        else:
            values = np.zeros((count, width), dtype)
        if "sparse" in accessor:
            values = self._with_sparse(accessor, values.copy(), where)
        if accessor.get("normalized") and dtype.kind != "f":
            values = np.maximum(values / np.float32(np.iinfo(dtype).max), np.float32(-1))
        return np.array(values[:, 0] if width == 1 else values)

    def attribute(self, primitive: Primitive, name: str, count: int, *widths: int) -> NDArray[Any] | None:
        """Return a primitive's values of one name, or None where it has none.

        Parameters
        ----------
        primitive : Primitive
        name : str
            As the specification spells it: NORMAL, TEXCOORD_0.
        count : int
            Number of vertices.
        widths : int
            How many numbers a vertex may have.

        Returns
        -------
        (count, width) or None

        Raises
        ------
        MeshError
            Another number of values.
        """
        if name not in primitive["attributes"]:
            return None
        index = primitive["attributes"][name]
        values = self.array(index)
        if values.ndim != 2 or values.shape[1] not in widths or len(values) != count:
            found = f"{len(values)} values of {'×'.join(map(str, values.shape[1:])) or 1} for {count} vertices' {name}"
            raise damaged(at(self.name, field=f"accessors[{index}]"), found)
        return values

    def _strided(
        self, view_index: int, offset: int, shape: tuple[int, int], dtype: np.dtype[Any], where: str
    ) -> NDArray[Any]:
        """Look at some rows of a buffer view."""
        view = self.gltf["bufferViews"][view_index]
        start = view.get("byteOffset", 0) + offset
        row = dtype.itemsize * shape[1]
        stride = view.get("byteStride", row)
        if stride < row or start + stride * (shape[0] - 1) + row > len(self.blob):
            raise damaged(where, f"{shape[0]:,} values that lie outside the file's data")
        return np.ndarray(shape, dtype, buffer=self.blob, offset=start, strides=(stride, dtype.itemsize))

    def _with_sparse(self, accessor: Accessor, values: NDArray[Any], where: str) -> NDArray[Any]:
        sparse = accessor["sparse"]
        if not sparse["count"]:
            return values
        indices, changed = sparse["indices"], sparse["values"]
        kind = _component(indices["componentType"], where)
        rows = self._strided(indices["bufferView"], indices.get("byteOffset", 0), (sparse["count"], 1), kind, where)
        if kind.kind != "u" or rows.max() >= len(values):
            raise damaged(where, f"a sparse value for number {rows.max()} of {len(values)}")
        shape = (sparse["count"], values.shape[1])
        values[rows[:, 0]] = self._strided(
            changed["bufferView"], changed.get("byteOffset", 0), shape, values.dtype, where
        )
        return values

    def add(self, values: NDArray[Any], target: int | None = None, *, bounds: bool = False) -> int:
        """Append an array and return its accessor's index.

        Parameters
        ----------
        values : (count,) or (count, 2…4) or (count, 16) float32, uint8, uint16 or uint32
        target : int, optional
            ARRAY_BUFFER or ELEMENT_ARRAY_BUFFER for data of a mesh.
        bounds : bool
            Store minimum and maximum, which positions and key times need.
        """
        columns = values.reshape(len(values), -1)
        accessor: Accessor = {
            "bufferView": self.add_view(np.ascontiguousarray(values).tobytes(), target),
            "componentType": next(code for code, kind in COMPONENTS.items() if np.dtype(kind) == values.dtype),
            "count": len(values),
            "type": ACCESSOR_TYPES[columns.shape[1]],
        }
        if bounds:
            accessor["min"] = columns.min(axis=0).tolist()
            accessor["max"] = columns.max(axis=0).tolist()
        self.gltf["accessors"].append(accessor)
        return len(self.gltf["accessors"]) - 1

    def add_view(self, content: bytes, target: int | None = None) -> int:
        """Append bytes and return their buffer view's index."""
        view: BufferView = {"buffer": 0, "byteOffset": self._pad(), "byteLength": len(content)}
        if target is not None:
            view["target"] = target
        self.blob += content
        self.gltf["bufferViews"].append(view)
        return len(self.gltf["bufferViews"]) - 1

    def save(self, path: Path) -> None:
        """Write a .glb, whole or not at all.

        Raises
        ------
        OutputError
        """
        self._pad()
        self.gltf["buffers"] = [{"byteLength": len(self.blob)}] if self.blob else []
        text = json.dumps(schema.compact(self.gltf), ensure_ascii=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = [(b"JSON", text)] + ([(b"BIN\0", self.blob)] if self.blob else [])
        length = 12 + sum(8 + len(content) for _, content in chunks)
        if length > MAX_GLB_BYTES:
            raise OutputError(
                path,
                found=f"{length / 1e9:.1f} GB to write",
                expected="no more than 4.3 GB, which is all that a .glb can hold",
                fix="Write fewer morph targets or fewer keyframes: --targets, --tolerance, --fps.",
            )
        with written_whole(path) as beside, beside.open("wb") as file:
            file.write(struct.pack("<4sII", MAGIC, 2, length))
            for kind, content in chunks:
                file.write(struct.pack("<I4s", len(content), kind))
                file.write(content)

    def _pad(self) -> int:
        """Fill up to the alignment that every component type is content with; return the length."""
        self.blob += bytes(-len(self.blob) % 4)
        return len(self.blob)

    def _refuse_packed(self) -> None:
        """Refuse arrays that only an extension can unpack; forget the packed copy of those that are there plainly.

        A viewer that knows the extension would show the packed copy, whose vertices are in another order.
        """
        for extension, command in UNPACK_COMMANDS.items():
            if extension in self.gltf["extensionsRequired"] or self._only_packed(extension):
                raise MeshError(
                    self.name,
                    found=f"data packed with {extension}",
                    expected="plain arrays",
                    fix=f"Unpack it first: {command}",
                )
            for mesh in self.gltf["meshes"]:
                for primitive in mesh["primitives"]:
                    primitive.get("extensions", {}).pop(extension, None)
            for packed in (*self.gltf["bufferViews"], *self.gltf["buffers"]):
                packed.get("extensions", {}).pop(extension, None)
            if extension in self.gltf["extensionsUsed"]:
                self.gltf["extensionsUsed"].remove(extension)
                self.notes.append(f"The copy of the mesh that is packed with {extension} is left out.")

    def _only_packed(self, extension: str) -> bool:
        """Tell whether there are primitives whose positions stand nowhere but in an extension."""
        return any(
            extension in primitive.get("extensions", {})
            and "bufferView" not in self.gltf["accessors"][primitive["attributes"]["POSITION"]]
            for mesh in self.gltf["meshes"]
            for primitive in mesh["primitives"]
            if "POSITION" in primitive["attributes"]
        )

    def _take_in_buffers(self, path: Path, binary: bytes) -> None:
        """Join all buffers into one; a file is there once, however many buffers name it."""
        starts: list[int] = []
        taken: dict[Path | int, tuple[int, int]] = {}
        for number, buffer in enumerate(self.gltf["buffers"]):
            uri = buffer.get("uri")
            source = number if uri is None or uri.startswith("data:") else _file_beside(path, uri)
            if source not in taken:
                start = self._pad()
                self.blob += _buffer_bytes(path, uri, binary if number == 0 else b"")
                taken[source] = start, len(self.blob) - start
            start, there = taken[source]
            if there < buffer["byteLength"]:
                raise damaged(path, f"{there:,} bytes of data of {buffer['byteLength']:,} announced")
            starts.append(start)
        for view in self.gltf["bufferViews"]:
            view["byteOffset"] = view.get("byteOffset", 0) + starts[view["buffer"]]
            view["buffer"] = 0

    def _take_in_images(self, path: Path) -> None:
        """Bring pictures that lie beside the file into the buffer: the result may be written elsewhere."""
        taken: dict[Path | str, tuple[str, int]] = {}
        for image in self.gltf["images"]:
            uri = image.get("uri")
            if uri is None or uri.startswith("data:"):
                continue
            file = _beside(path, uri)
            source = file or uri
            if source not in taken:
                content = self._picture(file, uri)
                kind = next((kind for start, kind in IMAGE_SIGNATURES.items() if content.startswith(start)), None)
                taken[source] = kind or image.get("mimeType", "image/jpeg"), self.add_view(content)
            if file:
                image.setdefault("name", file.stem)
            image["mimeType"], image["bufferView"] = taken[source]
            del image["uri"]

    def _picture(self, file: Path | None, uri: str) -> bytes:
        """Read a picture, and take white and a note for one that cannot be had."""
        try:
            if file:
                return file.read_bytes()
            fault = "is not a file in the folder of the glTF"
        except FileNotFoundError:
            fault = "is not there"
        except OSError as error:
            fault = f"cannot be read ({error.strerror})"
        self.notes.append(f"The picture {uri[:60]!r} {fault}: white takes its place.")
        return _white_pixel()


def _description(path: Path, text: bytes) -> tuple[Gltf, list[str]]:
    """Parse and check the JSON; return it, and the names of the properties that were null."""

    def refuse(name: str) -> NoReturn:
        raise ValueError(f"{name} is no JSON number")

    try:
        values = json.loads(text, parse_constant=refuse, parse_float=_number)
        if not isinstance(values, dict):
            raise ValueError(f"a {type(values).__name__} and not an object")
        nulls = schema.drop_nulls(values)
        gltf = schema.checked(values)
        _check_that_it_can_be_written(values)
    except (ValueError, RecursionError) as error:
        raise damaged(path, f"a description that is not glTF ({error})") from error
    if gltf["asset"]["version"].partition(".")[0] != "2":
        raise damaged(at(path, field="asset.version"), f"glTF {gltf['asset']['version'][:20]}")
    return gltf, nulls


def _number(text: str) -> float:
    return int(text.partition(".")[0]) if INTEGER_NUMBER.fullmatch(text) else float(text)


def _check_that_it_can_be_written(values: dict[str, Any]) -> None:
    """Raise an error for numbers like 1e999, halves of characters, and brackets nested too deeply.

    What writes it will stand deeper in the call stack: so much nesting must be to spare.
    """
    deeper: Any = values
    for _ in range(SPARE_NESTING_LEVELS):
        deeper = [deeper]
    json.dumps(deeper, ensure_ascii=False, allow_nan=False).encode()


def _chunks(path: Path, content: bytes) -> tuple[bytes, bytes]:
    """Split a .glb into its JSON and its binary chunk."""
    version, length = struct.unpack("<II", content[4:12].ljust(8, b"\0"))
    if version != 2 or length > len(content):
        raise damaged(path, f"glTF version {version}, {length:,} bytes announced and {len(content):,} there")
    chunks: dict[bytes, bytes] = {}
    place = 12
    while place + 8 <= length:
        size, kind = struct.unpack_from("<I4s", content, place)
        chunks.setdefault(kind, content[place + 8 : place + 8 + size])
        place += 8 + size
    if b"JSON" not in chunks:
        raise damaged(path, "no JSON chunk")
    return chunks[b"JSON"], chunks.get(b"BIN\0", b"")


def _component(code: int, where: str) -> np.dtype[Any]:
    if code not in COMPONENTS:
        raise damaged(where, f"the component type {code}")
    return np.dtype(COMPONENTS[code])


def _buffer_bytes(path: Path, uri: str | None, binary: bytes) -> bytes:
    """Return one buffer's bytes: the binary chunk, a data URI, or a file in the same folder or below."""
    if uri is None:
        return binary
    if uri.startswith("data:"):
        try:
            digits = "".join(uri.partition(",")[2].split())  # some programs break lines and leave the padding out
            return base64.b64decode(digits.rstrip("=") + "=" * (-len(digits.rstrip("=")) % 4), validate=True)
        except (binascii.Error, ValueError) as error:
            raise damaged(path, f"a data URI that is not base64 ({error})") from error
    try:
        return _file_beside(path, uri).read_bytes()
    except OSError as error:
        raise _not_beside(path, uri) from error


def _file_beside(path: Path, uri: str) -> Path:
    """Return where a file is that a glTF cannot do without."""
    file = _beside(path, uri)
    if file is None:
        raise _not_beside(path, uri)
    return file


def _beside(path: Path, uri: str) -> Path | None:
    """Return where a file that a glTF names must lie, in its folder or below, or None for a name of anything else."""
    try:
        file = (path.parent / unquote(uri).replace("\\", "/")).resolve()
        if file.is_relative_to(path.parent.resolve()) and (file.is_file() or not file.exists()):
            return file
    except (OSError, ValueError):  # a name too long, a zero byte in it, links in a circle
        pass
    return None


def _not_beside(path: Path, uri: str) -> MeshError:
    return MeshError(
        path,
        found=f"a reference to {uri!r}, which is not a file beside it",
        expected="all buffers in the file's own folder",
        fix="Copy those files beside it, or export as .glb.",
    )


def _white_pixel() -> bytes:
    png = io.BytesIO()
    Image.new("RGB", (1, 1), "white").save(png, "PNG")
    return png.getvalue()


def damaged(where: str | Path, found: str) -> MeshError:
    """Make the error for a file that cannot be what was exported."""
    return MeshError(where, found=found, expected="a whole glTF 2.0 file", fix="Export or download the file again.")
