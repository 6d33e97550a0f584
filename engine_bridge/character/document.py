"""A glTF document with all its bytes in one buffer; its accessors are read and added as arrays."""

import json
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character import schema
from engine_bridge.character.gltf_file import MAGIC, damaged
from engine_bridge.character.schema import Accessor, BufferView, Gltf, Kind, Primitive
from puppetline.errors import OutputError, at
from puppetline.files import written_whole

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

MAX_GLB_BYTES = 2**32 - 1
"""Maximum size of a .glb, which states its length in 32 bits."""

MESHOPT = "EXT_meshopt_compression"


class Document:
    """A glTF document in memory.

    Attributes
    ----------
    gltf : Gltf
        Description as plain JSON.
    blob : bytearray
        Binary buffer.
    name : str
        Name in error messages.
    notes : list of str
        Sentences about changes and omissions during reading.
    """

    def __init__(self, gltf: Gltf, blob: bytes | bytearray = b"", name: str = "document") -> None:
        self.gltf = gltf
        self.blob = bytearray(blob)
        self.name = name
        self.notes: list[str] = []

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
            The accessor is empty, or refers to bytes outside the buffer.
        """
        accessor, values = self.gltf["accessors"][index], self._stored(index)
        if accessor.get("normalized") and values.dtype.kind != "f":
            values = np.maximum(values / np.float32(np.iinfo(values.dtype).max), np.float32(-1))
        return np.array(values[:, 0] if values.shape[1] == 1 else values)

    def _stored(self, index: int) -> NDArray[Any]:
        """Return an accessor's values (count, width) as they are stored."""
        accessor, where = self.gltf["accessors"][index], at(self.name, field=f"accessors[{index}]")
        dtype = _component(accessor["componentType"], where)
        width, count = TYPE_WIDTHS[accessor["type"]], accessor["count"]
        if not count:
            raise damaged(where, "no values")
        if "bufferView" in accessor:
            values = self._strided(accessor["bufferView"], accessor.get("byteOffset", 0), (count, width), dtype, where)
        elif count > len(self.blob):  # zeros without data in the file must not fill the memory
            raise damaged(where, f"{count:,} values in a file of {len(self.blob):,} bytes")
        else:
            values = np.zeros((count, width), dtype)
        if "sparse" in accessor:
            values = self._with_sparse(accessor, values.copy(), where)
        return values

    def view(self, index: int) -> bytes:
        """Return the bytes of a buffer view."""
        view = self.gltf["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return bytes(self.blob[start : start + view["byteLength"]])

    def attribute(self, primitive: Primitive, name: str, count: int, *widths: int) -> NDArray[Any] | None:
        """Return the values of a primitive's attribute, or None if it has none.

        Parameters
        ----------
        primitive : Primitive
        name : str
            Name in the specification, such as NORMAL or TEXCOORD_0.
        count : int
            Number of vertices.
        widths : int
            Allowed numbers of components.

        Returns
        -------
        (count, width) or None

        Raises
        ------
        MeshError
            The attribute has another number of values or components.
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
        """Return some rows of a buffer view without a copy."""
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
        values : (count,) or (count, 2…4) or (count, 16) float32 or integers of 8 or 16 bits or uint32
        target : int, optional
            ARRAY_BUFFER or ELEMENT_ARRAY_BUFFER for a mesh.
        bounds : bool
            Whether to store minimum and maximum, as positions and key times require.
        """
        rows = _rows(values, target)
        view = self.add_view(rows.tobytes(), target)
        stride = rows.nbytes // max(len(rows), 1)
        if stride != rows.itemsize * math.prod(values.shape[1:]):
            self.gltf["bufferViews"][view]["byteStride"] = stride
        self.gltf["accessors"].append({"bufferView": view, **_described(values, bounds=bounds)})
        return len(self.gltf["accessors"]) - 1

    def add_rows(self, index: int, chosen: NDArray[np.bool_]) -> int:
        """Add the chosen rows (count,) of a vertex attribute's accessor, and return the new accessor's index."""
        old = self.gltf["accessors"][index]
        added = self.add(self._stored(index)[chosen], ARRAY_BUFFER, bounds="min" in old)
        if old.get("normalized"):
            self.gltf["accessors"][added]["normalized"] = True
        return added

    def replace(self, index: int, values: NDArray[Any], *, bounds: bool = False) -> None:
        """Replace the values of an accessor; other arrays in its buffer view stay as they are."""
        accessors, views = self.gltf["accessors"], self.gltf["bufferViews"]
        old = accessors[index]
        self.add(values, bounds=bounds)
        new = accessors.pop()
        before = old.get("bufferView")
        if before is not None and list(self.view_users()).count(before) == 1:
            views[before] = views.pop()
            new["bufferView"] = before
        kept: Any = {name: value for name, value in old.items() if name in ("name", "extras")}
        accessors[index] = {**new, **kept}

    def view_users(self) -> Iterator[int]:
        """Yield the buffer view of each accessor, part of a sparse accessor, and image."""
        for accessor in self.gltf["accessors"]:
            if "bufferView" in accessor:
                yield accessor["bufferView"]
            if "sparse" in accessor:
                yield accessor["sparse"]["indices"]["bufferView"]
                yield accessor["sparse"]["values"]["bufferView"]
        for image in self.gltf["images"]:
            if "bufferView" in image:
                yield image["bufferView"]

    def repack(self) -> None:
        """Drop all bytes that are in no buffer view, and store equal ranges once."""
        blob, places = self.blob, dict[tuple[int, int], int]()
        self.blob = bytearray()
        for view in self.gltf["bufferViews"]:
            place = view.get("byteOffset", 0), view["byteLength"]
            if place not in places:
                places[place] = self.append(blob[place[0] : sum(place)])
            view["byteOffset"] = places[place]

    def add_view(self, content: bytes, target: int | None = None) -> int:
        """Append bytes and return their buffer view's index."""
        view: BufferView = {"buffer": 0, "byteOffset": self.append(content), "byteLength": len(content)}
        if target is not None:
            view["target"] = target
        self.gltf["bufferViews"].append(view)
        return len(self.gltf["bufferViews"]) - 1

    def append(self, content: bytes | bytearray) -> int:
        """Append bytes at a multiple of four, which suits all component types, and return where they begin."""
        self.blob += bytes(-len(self.blob) % 4)
        start = len(self.blob)
        self.blob += content
        return start

    def save(self, path: Path) -> None:
        """Write a .glb, completely or not at all.

        Raises
        ------
        OutputError
        """
        self.append(b"")
        self.gltf["buffers"] = [{"byteLength": len(self.blob)}] if self.blob else []
        text = json.dumps(schema.compact(self.gltf), ensure_ascii=False, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = [(b"JSON", text)] + ([(b"BIN\0", self.blob)] if self.blob else [])
        length = 12 + sum(8 + len(content) for _, content in chunks)
        if length > MAX_GLB_BYTES:
            raise OutputError(
                path,
                found=f"{length / 1e9:.1f} GB to write",
                expected="at most 4.3 GB, the maximum size of a .glb",
                fix="Write fewer morph targets or keyframes with --targets, --tolerance or --fps.",
            )
        with written_whole(path) as beside, beside.open("wb") as file:
            file.write(struct.pack("<4sII", MAGIC, 2, length))
            for kind, content in chunks:
                file.write(struct.pack("<I4s", len(content), kind))
                file.write(content)


def _described(values: NDArray[Any], *, bounds: bool) -> Accessor:
    """Return the accessor of an array, without its position in the buffer."""
    columns = values.reshape(len(values), -1)
    accessor: Accessor = {
        "componentType": next(code for code, known in COMPONENTS.items() if np.dtype(known) == values.dtype),
        "count": len(values),
        "type": ACCESSOR_TYPES[columns.shape[1]],
    }
    if bounds:
        accessor["min"] = columns.min(axis=0).tolist()
        accessor["max"] = columns.max(axis=0).tolist()
    return accessor


def _rows(values: NDArray[Any], target: int | None) -> NDArray[Any]:
    """Return an array's rows as they are stored: those of vertices begin at multiples of four bytes."""
    missing = -values.itemsize * math.prod(values.shape[1:]) % 4 if target == ARRAY_BUFFER else 0
    if not missing:
        return np.ascontiguousarray(values)
    return np.pad(values.reshape(len(values), -1), ((0, 0), (0, missing // values.itemsize)))


def _component(code: int, where: str) -> np.dtype[Any]:
    if code not in COMPONENTS:
        raise damaged(where, f"the component type {code}")
    return np.dtype(COMPONENTS[code])
