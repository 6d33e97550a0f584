"""Real numeric arrays out of MATLAB 5 files, by the file's published layout.

SciPy reads these files too, but a damaged one makes its compiled reader end the whole process; here it is an error.

A file is a header of 128 bytes and then elements: a tag of type and length, the content, padding to 8 bytes. An array
is an element of the elements flags, dimensions, name and numbers, usually packed with zlib into an element of its own.
"""

import struct
import zlib
from dataclasses import dataclass
from math import prod
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Order = Literal["<", ">"]
"""Of bytes in a number, as `struct` and NumPy write it."""

HEADER = 128
MATRIX, COMPRESSED = 14, 15
NUMBER_TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
"""NumPy's names for the types that numbers are stored as, which may be smaller than the array's own."""
NUMBER_CLASSES = range(6, 16)
"""double, single and the integers; a lower class is a cell, structure, object, text or sparse array."""
COMPLEX = 0x800
HEAD = 4096
"""Bytes of an array's element within which flags, dimensions and name end, with room to spare."""
MAX_BYTES = 64 * 2**20
"""More than an hour of 20 joints; zlib would unpack a file of 64 KiB to as much."""


class Mat5Error(Exception):
    """The file is not, or no longer, a MATLAB 5 file; the message completes “a file in which …”."""


@dataclass(frozen=True, slots=True)
class Variable:
    """An array of the file, not yet read.

    Attributes
    ----------
    shape : tuple of int
        As claimed.
    is_real : bool
        Whether it holds real numbers, and not text, cells or complex ones.
    content : memoryview
        Its element's content.
    packed : bool
        Whether that is packed.
    order : "<" or ">"
        Of bytes.
    """

    shape: tuple[int, ...]
    is_real: bool
    content: memoryview
    packed: bool
    order: Order

    def numbers(self) -> NDArray[np.float64]:
        """Read the array.

        Raises
        ------
        Mat5Error
            It is larger than 64 MiB, or not all of it is there.
        """
        matrix = _unpacked(self.content, self.order, MAX_BYTES) if self.packed else self.content
        *_, rest = _head(matrix, self.order)
        kind, stored, _ = _element(rest, self.order)
        if kind not in NUMBER_TYPES or len(stored) != np.dtype(NUMBER_TYPES[kind]).itemsize * prod(self.shape):
            raise Mat5Error(f"the numbers of an array of {' × '.join(map(str, self.shape))} are not all there")
        numbers = np.frombuffer(stored, np.dtype(NUMBER_TYPES[kind]).newbyteorder(self.order))
        return numbers.astype(np.float64).reshape(self.shape, order="F")


def variables(data: bytes) -> dict[str, Variable]:
    """List the arrays of a file.

    Parameters
    ----------
    data : bytes
        The whole file.

    Raises
    ------
    Mat5Error
    """
    if data[126:HEADER] not in (b"IM", b"MI"):
        raise Mat5Error("the header is not MATLAB's")
    order: Order = "<" if data[126:HEADER] == b"IM" else ">"
    found = {}
    rest = memoryview(data)[HEADER:]
    while rest:
        kind, content, rest = _element(rest, order, padded=False)
        if kind not in (MATRIX, COMPRESSED):
            raise Mat5Error(f"an element of type {kind} stands in the place of an array")
        packed = kind == COMPRESSED
        flags, shape, name, _ = _head(_unpacked(content, order, HEAD) if packed else content, order)
        is_real = flags & 0xFF in NUMBER_CLASSES and not flags & COMPLEX
        found[name] = Variable(shape, is_real, content, packed, order)
    return found


def _element(data: memoryview, order: Order, *, padded: bool = True) -> tuple[int, memoryview, memoryview]:
    """Split off the first element: its type, its content, and what follows."""
    try:
        kind, length = struct.unpack_from(f"{order}II", data)
    except struct.error:
        raise Mat5Error("the data end within an element") from None
    start = 8
    if kind >> 16:  # up to four bytes stand where the length would
        kind, length, start = kind & 0xFFFF, kind >> 16, 4
        end = 8
    else:
        end = start + length
    if start + length > min(end, len(data)):
        raise Mat5Error(f"an element of {length} bytes is cut short")
    return kind, data[start : start + length], data[end + (-end % 8 if padded else 0) :]


def _unpacked(content: memoryview, order: Order, limit: int) -> memoryview:
    """Unpack up to `limit` bytes of a packed array and return what stands in its element."""
    try:
        unpacked = zlib.decompressobj().decompress(content, limit)
    except zlib.error as error:
        raise Mat5Error(f"packed data are damaged ({error})") from error
    if len(unpacked) < 8 or struct.unpack_from(f"{order}I", unpacked)[0] != MATRIX:
        raise Mat5Error("packed data are no array")
    return memoryview(unpacked)[8:]


def _head(matrix: memoryview, order: Order) -> tuple[int, tuple[int, ...], str, memoryview]:
    """Read the flags, dimensions and name of an array, and return what follows."""
    _, flags, rest = _element(matrix, order)
    _, dimensions, rest = _element(rest, order)
    _, name, rest = _element(rest, order)
    if len(flags) != 8 or len(dimensions) % 4:
        raise Mat5Error("the head of an array is damaged")
    shape = struct.unpack(f"{order}{len(dimensions) // 4}i", dimensions)
    if min(shape, default=-1) < 0:
        raise Mat5Error(f"an array has the dimensions {shape}")
    return struct.unpack_from(f"{order}I", flags)[0], shape, bytes(name).decode("latin-1"), rest
