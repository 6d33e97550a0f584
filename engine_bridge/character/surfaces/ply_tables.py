"""PLY, text and binary, as tables of named columns."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.surface import count, damaged
from engine_bridge.character.surfaces.text import decoded, filled_lines, unreadable
from puppetline.errors import at

TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4",
    "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip

Order = Literal["little", "big"]

ORDERS: dict[str, Order | None] = {"ascii": None, "binary_little_endian": "little", "binary_big_endian": "big"}
"""Byte order of each format; None for text."""

HEAD = re.compile(rb"ply[ \t]*(\r\n|\r|\n)")
END = re.compile(rb"^end_header[ \t]*(?:\r\n|\r|\n|$)", re.MULTILINE)

MAX_HEADER_BYTES = 2**18
"""Maximum size of a header in bytes."""


@dataclass
class Column:
    """A property of an element, and its values.

    Attributes
    ----------
    kind : dtype
        Type in the header.
    kind_of_length : dtype or None
        For a list, the type of the lengths.
    values : (n,) or (m,) number
        One value per row, or all lists one after another.
    lengths : (n,) int64 or None
        Lengths of the lists.
    """

    kind: np.dtype[Any]
    kind_of_length: np.dtype[Any] | None = None
    values: NDArray[Any] = field(default_factory=lambda: np.empty(0))
    lengths: NDArray[np.int64] | None = None


Table = dict[str, Column]


@dataclass(frozen=True)
class Element:
    """A table's name, its number of rows, and its columns."""

    name: str
    rows: int
    columns: Table


def matches(head: bytes) -> bool:
    """Return whether the beginning of a file is that of a PLY file."""
    return HEAD.match(head) is not None


def read_tables(path: Path, content: bytes) -> tuple[dict[str, Table], list[tuple[int, str]]]:
    """Read all elements of a PLY file.

    Returns
    -------
    tables : dict
        Columns by the names of element and property.
    images : list of (line, name)
        Comments that name a texture file.

    Raises
    ------
    MeshError
        A part of the file cannot be read; the message has the line, or the element and row.
    """
    end = END.search(content[:MAX_HEADER_BYTES].replace(b"\r", b"\n"))
    if not matches(content) or end is None:
        raise damaged(path, "no PLY header", "'ply' … 'end_header'")
    length = end.end()
    if content[length - 1 : length + 1] == b"\r\n":
        length += 1
    order, elements, images = _header(path, content[:length])
    if order is None:
        _read_text(path, content, length, elements)
    else:
        for element in elements:
            length = _read_binary(path, content, length, element, order)
    return {element.name: element.columns for element in elements}, images


def _header(path: Path, content: bytes) -> tuple[Order | None, list[Element], list[tuple[int, str]]]:
    """Return the byte order, the elements with properties, and the images in the lines up to ``end_header``."""
    word = ""
    elements: list[Element] = []
    images = []
    for number, line in filled_lines(decoded(path, content)):
        match line.split():
            case ["format", stated, *_] if stated in ORDERS:
                word = stated
            case ["element", name, rows] if re.fullmatch("[0-9]{1,18}", rows):
                elements.append(Element(name, int(rows), {}))
            case ["property", "list", length, kind, name] if elements and TYPES.get(length, "f")[0] != "f":
                elements[-1].columns[name] = Column(_type(path, number, kind), np.dtype(TYPES[length]))
            case ["property", kind, name] if elements:
                elements[-1].columns[name] = Column(_type(path, number, kind))
            case ["comment", "TextureFile", *_]:
                images.append((number, line.split(None, 2)[-1]))
            case ["ply" | "comment" | "obj_info" | "end_header", *_]:
                pass
            case _:
                raise damaged(at(path, line=number), repr(line[:60]), "a statement of a PLY header")
    if not word:
        raise damaged(path, "no format", f"'format', {' or '.join(ORDERS)}, '1.0'")
    return ORDERS[word], [element for element in elements if element.columns], images


def _type(path: Path, line: int, name: str) -> np.dtype[Any]:
    if name not in TYPES:
        raise damaged(at(path, line=line), f"the type {name[:20]!r}", ", ".join(TYPES))
    return np.dtype(TYPES[name])


def _read_text(path: Path, content: bytes, start: int, elements: list[Element]) -> None:
    """Read the rows of all elements, each of which is a line."""
    header = decoded(path, content[:start]).count("\n")
    lines = [line for line in filled_lines(decoded(path, content)) if line[0] > header]
    for element in elements:
        own, lines = lines[: element.rows], lines[element.rows :]
        if len(own) < element.rows:
            there = f"{count(len(own), 'line')} for {count(element.rows, 'row')}"
            raise damaged(at(path, field=f"element {element.name}"), there, "a complete PLY file")
        values: list[list[float]] = [[] for _ in element.columns]
        lengths: list[list[int]] = [[] for _ in element.columns]
        for number, line in own:
            words = line.split()
            place = 0
            try:
                for index, column in enumerate(element.columns.values()):
                    length = 1
                    if column.kind_of_length is not None:
                        length = int(words[place])
                        lengths[index].append(length)
                        place += 1
                    if not 0 <= length <= len(words) - place:
                        raise ValueError("too few numbers")
                    values[index].extend(map(float, words[place : place + length]))
                    place += length
            except (ValueError, IndexError):
                names = (name if c.kind_of_length is None else f"n {name}…" for name, c in element.columns.items())
                raise unreadable(path, number, line, " ".join(names)) from None
        for column, own_values, own_lengths in zip(element.columns.values(), values, lengths, strict=True):
            _fill(column, np.array(own_values), own_lengths)


def _read_binary(path: Path, content: bytes, start: int, element: Element, order: Order) -> int:
    """Read the rows of an element, whose bytes begin at `start`, and return their end."""
    where, there = at(path, field=f"element {element.name}"), len(content) - start
    columns = list(element.columns.values())
    if element.rows * sum((column.kind_of_length or column.kind).itemsize for column in columns) > there:
        there_are = f"{count(there, 'byte')} for {count(element.rows, 'row')}"
        raise damaged(where, there_are, "a complete PLY file")
    values = [bytearray() for _ in columns]
    lengths: list[list[int]] = [[] for _ in columns]
    place = start
    for row in range(element.rows):
        for index, column in enumerate(columns):
            length = 1
            if column.kind_of_length is not None:
                digits = content[place : place + column.kind_of_length.itemsize]
                length = int.from_bytes(digits, order, signed=column.kind_of_length.kind == "i")
                lengths[index].append(length)
                place += column.kind_of_length.itemsize
            end = place + length * column.kind.itemsize
            if not place <= end <= len(content):
                raise damaged(where, f"{count(length, 'value')} in row {row}", "as many as the file has")
            values[index] += content[place:end]
            place = end
    for column, own_values, own_lengths in zip(columns, values, lengths, strict=True):
        stored = column.kind.newbyteorder("<" if order == "little" else ">")
        _fill(column, np.frombuffer(own_values, stored), own_lengths)
    return place


def _fill(column: Column, values: NDArray[Any], lengths: list[int]) -> None:
    column.values = values
    if column.kind_of_length is not None:
        column.lengths = np.array(lengths, dtype=np.int64)
