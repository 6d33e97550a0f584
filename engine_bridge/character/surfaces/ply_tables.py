"""PLY, text and binary, as tables of named columns."""

import re
from dataclasses import dataclass
from itertools import repeat
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.surfaces.surface import count, damaged
from engine_bridge.character.surfaces.text import Rows, decoded, filled_lines, spans
from puppetline.errors import MeshError, at

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


@dataclass(frozen=True)
class Property:
    """A column's name, its type, and for lists the type of their lengths."""

    name: str
    kind: np.dtype[Any]
    kind_of_length: np.dtype[Any] | None


@dataclass(frozen=True)
class Element:
    """A table's name, its number of rows, and its columns."""

    name: str
    rows: int
    properties: list[Property]


@dataclass(frozen=True)
class Column:
    """The values of a property.

    Attributes
    ----------
    kind : dtype
        Type in the header.
    values : (n,) or (m,) number
        One value per row, or all lists one after another.
    lengths : (n,) int64 or None
        Lengths of the lists.
    """

    kind: np.dtype[Any]
    values: NDArray[Any]
    lengths: NDArray[np.int64] | None


Table = dict[str, Column]


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
        return _text_tables(path, content, length, elements), images
    tables = {}
    for element in elements:
        tables[element.name], length = _BinaryElement(path, content, length, element, order).read()
    return tables, images


def _header(path: Path, content: bytes) -> tuple[Order | None, list[Element], list[tuple[int, str]]]:
    """Return the byte order, the elements with properties, and the images in the lines up to ``end_header``."""
    word = ""
    elements: list[Element] = []
    images = []
    for number, line in enumerate(decoded(path, content).split("\n"), 1):
        match line.split():
            case ["format", stated, *_] if stated in ORDERS:
                word = stated
            case ["element", name, rows] if re.fullmatch("[0-9]{1,18}", rows):
                elements.append(Element(name, int(rows), []))
            case ["property", "list", length, kind, name] if elements and TYPES.get(length, "f")[0] != "f":
                elements[-1].properties.append(Property(name, _type(path, number, kind), np.dtype(TYPES[length])))
            case ["property", kind, name] if elements:
                elements[-1].properties.append(Property(name, _type(path, number, kind), None))
            case ["comment", "TextureFile", *_]:
                images.append((number, line.split(None, 2)[-1].strip()))
            case ["ply" | "comment" | "obj_info" | "end_header", *_] | []:
                pass
            case _:
                raise damaged(at(path, line=number), repr(line[:60]), "a statement of a PLY header")
    if not word:
        raise damaged(path, "no format", f"'format', {' or '.join(ORDERS)}, '1.0'")
    return ORDERS[word], [element for element in elements if element.properties], images


def _type(path: Path, line: int, name: str) -> np.dtype[Any]:
    if name not in TYPES:
        raise damaged(at(path, line=line), f"the type {name[:20]!r}", ", ".join(TYPES))
    return np.dtype(TYPES[name])


def _text_tables(path: Path, content: bytes, start: int, elements: list[Element]) -> dict[str, Table]:
    header = decoded(path, content[:start]).count("\n")
    lines = [line for line in filled_lines(decoded(path, content)) if line[0] > header]
    tables = {}
    for element in elements:
        own, lines = lines[: element.rows], lines[element.rows :]
        if len(own) < element.rows:
            there = f"{count(len(own), 'line')} for {count(element.rows, 'row')}"
            raise damaged(at(path, field=f"element {element.name}"), there, "a complete PLY file")
        expected = " ".join(
            prop.name if prop.kind_of_length is None else f"n {prop.name}…" for prop in element.properties
        )
        tables[element.name] = _text_columns(
            Rows(path, expected, [line for line, _ in own], [text for _, text in own]), element
        )
    return tables


def _text_columns(rows: Rows, element: Element) -> Table:
    values, ends = rows.numbers, np.cumsum(rows.widths)
    place, table = ends - rows.widths, {}
    for prop in element.properties:
        rows.refuse(place >= ends)
        lengths = None
        if prop.kind_of_length is not None:
            stated = values[place]
            rows.refuse(~((stated >= 0) & (stated < ends - place) & (stated == np.floor(stated))))
            lengths = stated.astype(np.int64)
            place = place + 1
        table[prop.name] = Column(prop.kind, values[place if lengths is None else spans(place, lengths)], lengths)
        place = place + (1 if lengths is None else lengths)
    return table


class _BinaryElement:
    """Reader of an element, whose bytes begin at `start`."""

    def __init__(self, path: Path, content: bytes, start: int, element: Element, order: Order) -> None:
        self.path = path
        self.content = content
        self.start = start
        self.element = element
        self.order = order

    def read(self) -> tuple[Table, int]:
        """Return the columns, and the start of the next element."""
        rows, there = self.element.rows, len(self.content) - self.start
        least = sum((prop.kind_of_length or prop.kind).itemsize for prop in self.element.properties)
        if rows * least > there:
            raise self._damaged(f"{count(there, 'byte')} for {count(rows, 'row')}", "a complete PLY file")
        return self._read_alike() or self._read_each()

    def _read_alike(self) -> tuple[Table, int] | None:
        """Read rows whose lists are as long as those of the first row, the usual case; return None for other rows."""
        rows, properties = self.element.rows, self.element.properties
        if not rows:
            return None
        lengths = [first[0] if first else 1 for _, first in self._walk(1)[0]]
        columns = list(enumerate(zip(properties, lengths, strict=True)))
        fields = [(f"values{index}", self._stored(prop.kind), (length,)) for index, (prop, length) in columns]
        for index, (prop, _) in reversed(columns):
            if prop.kind_of_length is not None:
                fields.insert(index, (f"length{index}", self._stored(prop.kind_of_length), (1,)))
        row = np.dtype(fields)
        if rows * row.itemsize > len(self.content) - self.start:
            return None
        read = np.frombuffer(self.content, row, rows, self.start)
        table = {}
        for index, (prop, length) in columns:
            is_list = prop.kind_of_length is not None
            if is_list and (read[f"length{index}"] != length).any():
                return None
            of_lists = np.full(rows, length, dtype=np.int64) if is_list else None
            table[prop.name] = Column(prop.kind, read[f"values{index}"].ravel(), of_lists)
        return table, self.start + rows * row.itemsize

    def _read_each(self) -> tuple[Table, int]:
        """Read rows whose lists have any length."""
        found, end = self._walk(self.element.rows)
        table = {}
        for prop, (places, lengths) in zip(self.element.properties, found, strict=True):
            size = prop.kind.itemsize
            parts = (
                self.content[place : place + size * length]
                for place, length in zip(places, lengths or repeat(1), strict=False)
            )
            values = np.frombuffer(b"".join(parts), self._stored(prop.kind))
            of_lists = None if prop.kind_of_length is None else np.array(lengths, dtype=np.int64)
            table[prop.name] = Column(prop.kind, values, of_lists)
        return table, end

    def _walk(self, rows: int) -> tuple[list[tuple[list[int], list[int]]], int]:
        """Return each property's offsets and list lengths in the first rows, and the end of these rows."""
        found: list[tuple[list[int], list[int]]] = [([], []) for _ in self.element.properties]
        sizes = [(prop.kind.itemsize, prop.kind_of_length) for prop in self.element.properties]
        place = self.start
        for row in range(rows):
            for (places, lengths), (size, kind_of_length) in zip(found, sizes, strict=True):
                length = 1
                if kind_of_length is not None:
                    digits = self.content[place : place + kind_of_length.itemsize]
                    length = int.from_bytes(digits, self.order, signed=kind_of_length.kind == "i")
                    place += kind_of_length.itemsize
                    lengths.append(length)
                places.append(place)
                place += size * length
                if length < 0 or place > len(self.content):
                    raise self._damaged(f"a list of {length} in row {row}", "a list that fits into the file")
        return found, place

    def _stored(self, kind: np.dtype[Any]) -> np.dtype[Any]:
        return kind.newbyteorder("<" if self.order == "little" else ">")

    def _damaged(self, found: str, expected: str) -> MeshError:
        return damaged(at(self.path, field=f"element {self.element.name}"), found, expected)
