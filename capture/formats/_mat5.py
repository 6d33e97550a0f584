"""A reader of arrays of real numbers, also in structures and cells, in MATLAB 5 files, after the published layout.

SciPy reads these files too, but a damaged file makes its compiled reader end the whole process. Here it is an error.

A file has a header of 128 bytes, followed by elements: a tag with type and length, the content, and padding to 8 bytes.
An array is an element that contains the elements flags, dimensions, name and numbers. Most programs compress it with
zlib into another element.
"""

import struct
import zlib
from dataclasses import dataclass, replace
from math import prod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Order = Literal["<", ">"]
"""Byte order of numbers, in the notation of `struct` and NumPy."""

HEADER_BYTES = 128
ARRAY_TYPE, COMPRESSED_TYPE = 14, 15
NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""NumPy names of the types in which numbers are stored; a stored type may be smaller than the array's own type."""
NUMBER_CLASSES = range(6, 16)
OTHER_CLASSES = {1: "cells", 2: "structure", 3: "object", 4: "text", 5: "sparse matrix"}
"""Array classes of double, single and integers, and what arrays of the other classes hold."""
COMPLEX_FLAG = 0x800
MAX_ARRAY_HEAD_BYTES = 4096
"""Number of bytes of an array's element that are decompressed to read its flags, dimensions and name."""
MAX_PARTS = 200_000
"""Maximum number of fields or cells of an array that are read."""
MAX_ARRAY_BYTES = 64 * 2**20
"""Maximum size of an array: more than an hour of 20 joints. A file of 64 KiB can decompress to as much."""


class Mat5Error(Exception):
    """The file is not a complete MATLAB 5 file; the message completes “a file in which …”."""


@dataclass(frozen=True, slots=True)
class Variable:
    """An array of the file whose numbers are not read yet.

    Attributes
    ----------
    shape : tuple of int
        Dimensions as the file states them, unchecked.
    kind : str
        "numbers", or what the array holds instead of real numbers.
    content : memoryview
        Content of the array's element.
    compressed : bool
        Whether the content is compressed.
    order : "<" or ">"
        Byte order.
    """

    shape: tuple[int, ...]
    kind: str
    content: memoryview
    compressed: bool
    order: Order

    def description(self) -> str:
        """Return what the array holds, and the names of a structure's fields.

        Raises
        ------
        Mat5Error
            The array is larger than 64 MiB or incomplete.
        """
        if self.kind != "structure":
            return self.kind
        fields, _ = self._fields()
        return f"structure of {', '.join(fields[:12])}{' …' if len(fields) > 12 else ''}"

    def parts(self) -> dict[str, "Variable"]:
        """Return the fields of a structure, or the cells of cells by their numbers from 1; nothing of other arrays.

        Raises
        ------
        Mat5Error
            The array is larger than 64 MiB or incomplete.
        """
        names: list[str] = []
        if self.kind == "structure":
            names, rest = self._fields()
        elif self.kind == "cells":
            *_, rest = _array_head(self._array(), self.order)
        else:
            return {}
        count = prod(self.shape)
        found: dict[str, Variable] = {}
        while rest and len(found) < min(count * (len(names) or 1), MAX_PARTS):
            _, content, rest = _split_element(rest, self.order)
            index = len(found)
            name = names[index % len(names)] if names else str(index + 1)
            if names and count > 1:
                name = f"{index // len(names) + 1}.{name}"
            found[name] = _variable(content, order=self.order)[1]
        return found

    def document(self, depth: int = 8) -> Any:
        """Return the array as dictionaries, lists, texts and few numbers, to some depth; tables are lists of rows.

        Raises
        ------
        Mat5Error
            The array is larger than 64 MiB or incomplete.
        """
        if self.kind == "numbers":
            return np.squeeze(self.numbers()).tolist() if prod(self.shape) < MAX_PARTS else []
        if self.kind == "text":
            return self.text()
        own = {name: part.document(depth - 1) for name, part in self.parts().items()} if depth else {}
        count = prod(self.shape)
        if self.kind == "structure" and count == 1:
            return own
        values: list[Any] = [{} for _ in range(count)] if self.kind == "structure" else list(own.values())
        for name, value in own.items() if self.kind == "structure" else ():
            index, field = name.split(".", 1)
            values[int(index) - 1][field] = value
        rows = self.shape[0] if min(self.shape, default=0) > 1 else 0
        return [values[row::rows] for row in range(rows)] or values

    def text(self) -> str:
        """Return the text of an array of letters.

        Raises
        ------
        Mat5Error
            The array is larger than 64 MiB or incomplete.
        """
        *_, rest = _array_head(self._array(), self.order)
        kind, stored, _ = _split_element(rest, self.order)
        return bytes(stored).decode("utf-16-le" if kind in (4, 17) else "utf-8", errors="replace").strip()

    def _fields(self) -> tuple[list[str], memoryview]:
        """Return the names of a structure's fields, and the bytes of their arrays."""
        *_, rest = _array_head(self._array(), self.order)
        _, length, rest = _split_element(rest, self.order)
        _, names, rest = _split_element(rest, self.order)
        size = int.from_bytes(length, "little" if self.order == "<" else "big") or 1
        return [bytes(names[k : k + size]).split(b"\0")[0].decode("latin-1") for k in range(0, len(names), size)], rest

    def _array(self) -> memoryview:
        return _decompressed(self.content, self.order, MAX_ARRAY_BYTES) if self.compressed else self.content

    def numbers(self) -> NDArray[np.float64]:
        """Read the array.

        Raises
        ------
        Mat5Error
            The array is larger than 64 MiB or incomplete.
        """
        *_, rest = _array_head(self._array(), self.order)
        kind, stored, _ = _split_element(rest, self.order)
        if kind not in NUMBER_TYPES or len(stored) != np.dtype(NUMBER_TYPES[kind]).itemsize * prod(self.shape):
            raise Mat5Error(f"an array of {' × '.join(map(str, self.shape))} is incomplete")
        numbers = np.frombuffer(stored, np.dtype(NUMBER_TYPES[kind]).newbyteorder(self.order))
        return numbers.astype(np.float64).reshape(self.shape, order="F")


def variables(data: bytes) -> dict[str, Variable]:
    """Return the arrays in the bytes of a whole file, by name.

    Raises
    ------
    Mat5Error
        The file is damaged, incomplete, or not a MATLAB 5 file.
    """
    if data[126:HEADER_BYTES] not in (b"IM", b"MI"):
        raise Mat5Error("the header is not MATLAB's")
    order: Order = "<" if data[126:HEADER_BYTES] == b"IM" else ">"
    found = {}
    rest = memoryview(data)[HEADER_BYTES:]
    while rest:
        kind, content, rest = _split_element(rest, order, padded=False)
        if kind not in (ARRAY_TYPE, COMPRESSED_TYPE):
            raise Mat5Error(f"an element of type {kind} is in the place of an array")
        compressed = kind == COMPRESSED_TYPE
        head = _decompressed(content, order, MAX_ARRAY_HEAD_BYTES) if compressed else content
        name, own = _variable(head, order=order)
        found[name] = replace(own, content=content, compressed=compressed)
    return found


def _variable(content: memoryview, *, order: Order) -> tuple[str, Variable]:
    """Return the name of an array, and the array, whose element has this content."""
    if not content:  # an empty field
        return "", Variable((0,), "nothing", content, False, order)
    flags, shape, name, _ = _array_head(content, order)
    what = OTHER_CLASSES.get(flags & 0xFF, "unknown data")
    if flags & 0xFF in NUMBER_CLASSES:
        what = "complex numbers" if flags & COMPLEX_FLAG else "numbers"
    return name, Variable(shape, what, content, False, order)


def _split_element(data: memoryview, order: Order, *, padded: bool = True) -> tuple[int, memoryview, memoryview]:
    """Return the type and content of the first element, and the bytes after it."""
    try:
        kind, length = struct.unpack_from(f"{order}II", data)
    except struct.error:
        raise Mat5Error("the data end within an element") from None
    start = 8
    if kind >> 16:  # a small element: up to four bytes of content replace the length
        kind, length, start = kind & 0xFFFF, kind >> 16, 4
        end = 8
    else:
        end = start + length
    if start + length > min(end, len(data)):
        raise Mat5Error(f"an element of {length} bytes is incomplete")
    return kind, data[start : start + length], data[end + (-end % 8 if padded else 0) :]


def _decompressed(content: memoryview, order: Order, limit: int) -> memoryview:
    """Decompress up to `limit` bytes of an array and return the content of its element."""
    try:
        data = zlib.decompressobj().decompress(content, limit)
    except zlib.error as error:
        raise Mat5Error(f"compressed data are damaged ({error})") from error
    if len(data) < 8 or struct.unpack_from(f"{order}I", data)[0] != ARRAY_TYPE:
        raise Mat5Error("compressed data are not an array")
    return memoryview(data)[8:]


def _array_head(array: memoryview, order: Order) -> tuple[int, tuple[int, ...], str, memoryview]:
    """Return the flags, dimensions and name of an array, and the bytes after them."""
    _, flags, rest = _split_element(array, order)
    _, dimensions, rest = _split_element(rest, order)
    _, name, rest = _split_element(rest, order)
    if len(flags) != 8 or len(dimensions) % 4:
        raise Mat5Error("the head of an array is damaged")
    shape = struct.unpack(f"{order}{len(dimensions) // 4}i", dimensions)
    if min(shape, default=-1) < 0:
        raise Mat5Error(f"an array has the dimensions {shape}")
    return struct.unpack_from(f"{order}I", flags)[0], shape, bytes(name).decode("latin-1"), rest
