import itertools
import struct

import numpy as np
import pytest

from engine_bridge.character.surfaces.ply_tables import TYPES, read_tables
from puppetline.errors import MeshError

from ...refusals import refused_place

KINDS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}


def read(written, content):
    path = written("a.ply", content)
    return read_tables(path, path.read_bytes())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", TYPES)
@pytest.mark.parametrize(
    "lists", [[[1, 2], [], [9, 8, 7]], [[1, 2], [4, 5], [9, 8]]], ids=["many lengths", "one length"]
)
def test_numbers_and_lists_of_every_type(written, kind, name, lists):
    code, numbers = CODES[TYPES[name]], [3, 100, 7]
    length = "uchar" if TYPES[name][0] == "f" else name
    head = f"ply\nformat {kind} 1.0\nelement a 3\nproperty {name} one\nproperty list {length} {name} some\nend_header\n"
    rows = [(one, len(some), *some) for one, some in zip(numbers, lists, strict=True)]
    if kind == "ascii":
        body = "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    else:
        body = b"".join(struct.pack(f"{KINDS[kind]}{code}{CODES[TYPES[length]]}{row[1]}{code}", *row) for row in rows)
    table = read(written, head.encode() + body)[0]["a"]
    assert (table["one"].values.tolist(), table["one"].lengths) == (numbers, None)
    assert (table["some"].values.tolist(), table["some"].lengths.tolist()) == (
        [*itertools.chain(*lists)],
        list(map(len, lists)),
    )
    assert table["one"].kind == np.dtype(TYPES[name])


@pytest.mark.parametrize(("end", "version"), [("\n", ""), ("\r\n", " 1.1"), ("\r", " 1.0 ")])
def test_any_line_end_of_the_header_and_any_version_or_none(written, end, version):
    head = f"ply\nformat binary_big_endian{version}\nobj_info x\ncomment TextureFile a b.png\nelement a 2\n"
    head += "property ushort one\nend_header\n"
    tables, pictures = read(written, head.replace("\n", end).encode() + struct.pack(">HH", 0x0D0B, 0x0A01))
    assert tables["a"]["one"].values.tolist() == [0x0D0B, 0x0A01]
    assert pictures == [(4, "a b.png")]


def test_elements_without_properties_or_rows_are_skipped(written):
    head = "ply\nformat ascii 1.0\nelement none 9\nelement empty 0\nproperty int a\nproperty list uchar int b\n"
    head += "element a 1\nproperty int a\nend_header\n"
    for kind, body in (("ascii", b"\n5\n"), ("binary_little_endian", struct.pack("<i", 5))):
        tables, _ = read(written, head.replace("ascii", kind).encode() + body)
        assert tables["a"]["a"].values.tolist() == [5]
        assert [len(tables["empty"][name].values) for name in "ab"] == [0, 0]
        assert tables["empty"]["b"].lengths.tolist() == []
        assert "none" not in tables


def place_of(written, content):
    """Return the place that the error for a file names."""
    path = written("a.ply", content)
    return refused_place(MeshError, path, read_tables, path, path.read_bytes())


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (2, "format ebcdic 1.0"), (2, "format"), (3, "element vertex many"), (3, "element vertex -1"),
        (3, "element vertex"), (3, f"element vertex {'9' * 40}"), (3, "property int x"),
        (4, "property list float int x"), (4, "property int"), (4, "say what"), (4, "property half x"),
    ],
)  # fmt: skip
def test_a_header_line_that_does_not_fit_is_named(written, line, text):
    lines = ["ply", "format ascii 1.0", "element vertex 1", "property float x", "end_header", "1", ""]
    lines[line - 1] = text
    assert place_of(written, "\n".join(lines)) == f"line {line}"


@pytest.mark.parametrize(
    "text", ["", "plywood\n", "ply\nformat ascii 1.0\n", "ply\nformat ascii 1.0\nelement a 1\ncomment end_header\n"]
)
def test_a_file_without_a_header_is_refused(written, text):
    assert place_of(written, text) == ""


@pytest.mark.parametrize(
    ("rows", "place"),
    [
        ("1 2 3 4\n", "element a"),
        ("1 2 3 4\n\n1 2 3\n", "line 9"),
        ("1 2 3 4\n1 -1 3 4\n", "line 8"),
        ("1 1e300 3 4\n1 1 3 4\n", "line 7"),
        ("1 nan 3 4\n1 1 3 4\n", "line 7"),
        ("1 1 x\n1 1 3 4\n", "line 7"),
        ("1 1 0\n1 1 \0 4\n", "line 8"),
    ],
)
def test_rows_of_text_that_do_not_fit_are_named(written, rows, place):
    head = "ply\nformat ascii 1.0\nelement a 2\nproperty int one\nproperty list uchar int some\nend_header\n"
    assert place_of(written, head + rows) == place


@pytest.mark.parametrize(
    ("count", "kind", "body"),
    [
        *((count, "int", bytes(8)) for count in (3, 2**31, 10**17)),
        *(
            (2, "list int double", struct.pack("<id", 1, 0.5) * row + struct.pack("<i", length) + bytes(32 - 16 * row))
            for length, row in ((-1, 0), (2**31 - 1, 0), (5, 1), (-3, 1))
        ),
    ],
)
def test_more_values_than_the_bytes_hold_are_refused_before_any_memory_is_taken(written, count, kind, body):
    head = f"ply\nformat binary_little_endian 1.0\nelement a {count}\nproperty {kind} some\nend_header\n"
    assert place_of(written, head.encode() + body) == "element a"
