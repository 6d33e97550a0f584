import struct

import numpy as np
import pytest

from engine_bridge.character.surfaces.ply_tables import TYPES, matches, read_tables
from puppetline.errors import MeshError

KINDS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
CODES = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "f4": "f", "f8": "d"}


def read(written, content):
    path = written("a.ply", content)
    return read_tables(path, path.read_bytes())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", TYPES)
def test_numbers_and_lists_of_every_type(written, kind, name):
    code = CODES[TYPES[name]]
    values = [[3, [1, 2]], [100, []], [7, [9, 8, 7]]]
    length = "uchar" if TYPES[name][0] == "f" else name
    head = f"ply\nformat {kind} 1.0\nelement a 3\nproperty {name} one\nproperty list {length} {name} some\nend_header\n"
    if kind == "ascii":
        body = "".join(" ".join(map(str, [one, len(some), *some])) + "\n" for one, some in values).encode()
    else:
        body = b"".join(
            struct.pack(f"{KINDS[kind]}{code}{CODES[TYPES[length]]}{len(some)}{code}", one, len(some), *some)
            for one, some in values
        )
    table = read(written, head.encode() + body)[0]["a"]
    assert (table["one"].values.tolist(), table["one"].lengths) == ([3, 100, 7], None)
    assert (table["some"].values.tolist(), table["some"].lengths.tolist()) == ([1, 2, 9, 8, 7], [2, 0, 3])
    assert table["one"].kind == np.dtype(TYPES[name])


@pytest.mark.parametrize("kind", ["binary_little_endian", "binary_big_endian"])
def test_lists_of_one_length_are_read_as_those_of_many(written, kind):
    head = f"ply\nformat {kind} 1.0\nelement a {{}}\nproperty uchar one\n"
    head += "property list short int some\nproperty list uchar float more\nend_header\n"
    rng = np.random.default_rng(3)
    rows = [
        (one, some, more)
        for one, some, more in zip(
            rng.integers(0, 256, 50), rng.integers(-9, 9, (50, 4)), rng.random((50, 2)), strict=True
        )
    ]
    body = b"".join(struct.pack(KINDS[kind] + "Bh4iB2f", one, 4, *some, 2, *more) for one, some, more in rows)
    longer = body + struct.pack(KINDS[kind] + "BhiB", 1, 1, 5, 0)
    alike = read(written, head.format(50).encode() + body)[0]["a"]
    each = read(written, head.format(51).encode() + longer)[0]["a"]
    np.testing.assert_array_equal(alike["one"].values, [row[0] for row in rows])
    np.testing.assert_array_equal(alike["some"].values.reshape(50, 4), [row[1] for row in rows])
    np.testing.assert_allclose(alike["more"].values.reshape(50, 2), [row[2] for row in rows], rtol=1e-6)
    for name, more in (("one", 1), ("some", 1), ("more", 0)):
        np.testing.assert_array_equal(each[name].values[: len(each[name].values) - more], alike[name].values)


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_any_line_end_of_the_header(written, end):
    head = end.join(
        [
            "ply",
            "format binary_big_endian 1.0",
            "obj_info x",
            "comment TextureFile a b.png",
            "element a 2",
            "property ushort one",
            "end_header",
            "",
        ]
    )
    tables, pictures = read(written, head.encode() + struct.pack(">HH", 0x0D0B, 0x0A01))
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


def refused(written, content):
    with pytest.raises(MeshError) as error:
        read(written, content)
    return error.value.where.partition("a.ply")[2], error.value.found


@pytest.mark.parametrize(
    ("line", "text"),
    [
        (2, "format ebcdic 1.0"), (2, "format"), (3, "element vertex many"), (3, "element vertex -1"),
        (3, "element vertex"), (3, f"element vertex {'9' * 40}"), (3, "property int x"),
        (4, "property list float int x"), (4, "property int"), (4, "say what"),
    ],
)  # fmt: skip
def test_a_header_line_that_does_not_fit_is_named(written, line, text):
    lines = ["ply", "format ascii 1.0", "element vertex 1", "property float x", "end_header", "1", ""]
    lines[line - 1] = text
    assert refused(written, "\n".join(lines)) == (f", line {line}", repr(text[:60]))


@pytest.mark.parametrize("version", ["", " 1.0", " 1.1", " 1.0 "])
def test_the_format_may_have_any_version_or_none(written, version):
    table, _ = read(written, f"ply\nformat ascii{version}\nelement a 2\nproperty int x\nend_header\n5\n7\n")
    assert table["a"]["x"].values.tolist() == [5, 7]


def test_a_type_that_is_not_known_is_named(written):
    text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n1\n"
    assert refused(written, text) == (", line 4", "the type 'half'")


@pytest.mark.parametrize(
    "text", ["", "plywood\n", "ply\nformat ascii 1.0\n", "ply\nformat ascii 1.0\nelement a 1\ncomment end_header\n"]
)
def test_a_file_without_a_header_is_refused(written, text):
    assert refused(written, text) == ("", "no PLY header")


@pytest.mark.parametrize(
    ("rows", "place", "found"),
    [
        ("1 2 3 4\n", "element a", "1 line for 2 rows"),
        ("1 2 3 4\n\n1 2 3\n", "line 9", "'1 2 3'"),
        ("1 2 3 4\n1 -1 3 4\n", "line 8", "'1 -1 3 4'"),
        ("1 1e300 3 4\n1 1 3 4\n", "line 7", "'1 1e300 3 4'"),
        ("1 nan 3 4\n1 1 3 4\n", "line 7", "'1 nan 3 4'"),
        ("1 1 x\n1 1 3 4\n", "line 7", "'1 1 x'"),
        ("1 1 0\n1 1 \0 4\n", "line 8", "bytes that are not text"),
    ],
)
def test_rows_of_text_that_do_not_fit_are_named(written, rows, place, found):
    head = "ply\nformat ascii 1.0\nelement a 2\nproperty int one\nproperty list uchar int some\nend_header\n"
    assert refused(written, head + rows) == (f", {place}", found)


@pytest.mark.parametrize("rows", [3, 2**31, 10**17])
def test_more_rows_than_the_bytes_hold_are_refused_before_any_memory_is_taken(written, rows):
    head = f"ply\nformat binary_little_endian 1.0\nelement a {rows}\nproperty int one\nend_header\n"
    assert refused(written, head.encode() + bytes(8)) == (", element a", f"8 bytes for {rows:,} rows")


@pytest.mark.parametrize(("length", "row"), [(-1, 0), (2**31 - 1, 0), (5, 1), (-3, 1)])
def test_lists_longer_than_the_bytes_or_shorter_than_nothing_are_refused(written, length, row):
    head = b"ply\nformat binary_little_endian 1.0\nelement a 2\nproperty list int double some\nend_header\n"
    lists = [struct.pack("<id", 1, 0.5)] * row + [struct.pack("<i", length)] + [bytes(16)] * (2 - row)
    assert refused(written, head + b"".join(lists)) == (", element a", f"{length:,} values in row {row}")


def test_only_a_word_of_its_own_is_a_beginning():
    assert matches(b"ply\nformat")
    assert matches(b"ply \r\n")
    assert not matches(b"plywood\n")
    assert not matches(b" ply\n")
