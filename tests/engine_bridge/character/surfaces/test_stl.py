import struct

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from engine_bridge.character.surfaces import stl
from puppetline.errors import MeshError

from ...refusals import refused, refused_place


def binary(cube, header=b"made by hand", attribute=0):
    facets = b"".join(struct.pack("<12fH", 9, 9, 9, *cube.vertices[t].ravel(), attribute) for t in cube.triangles)
    return header.ljust(80) + struct.pack("<I", len(cube.triangles)) + facets


def facet(corners, word="vertex"):
    lines = "".join(f"      {word} {x:g} {y:g} {z:g}\n" for x, y, z in corners)
    return f"  facet normal 0 0 0\n    outer loop\n{lines}    endloop\n  endfacet\n"


def text(cube, name="a cube"):
    return f"solid {name}\n" + "".join(facet(cube.vertices[t]) for t in cube.triangles) + f"endsolid {name}\n"


def read(path):
    return stl.read(path, path.read_bytes())


@pytest.mark.parametrize("header", [b"made by hand", b"solid for all that facet", b"\0" * 80])
@pytest.mark.parametrize(("attribute", "after"), [(0, b""), (0x8000 + 0x7C1F, b"abc")])
def test_a_binary_file_is_read_facet_by_facet_and_further_bytes_are_noted(cube, written, header, attribute, after):
    surface = read(written("a.stl", binary(cube, header, attribute) + after))
    (piece,) = surface.pieces
    assert_array_equal(piece.positions, cube.vertices[cube.triangles].reshape(-1, 3))
    assert_array_equal(piece.triangles, np.arange(36).reshape(-1, 3))
    assert (surface.faceted, len(surface.notes), piece.normals) == (True, bool(after), None)


def test_solids_of_a_text_become_pieces_in_capitals_or_not(cube, written):
    content = text(cube, "left arm").upper() + "\n" + text(cube, "") + "solid empty\nendsolid\n"
    first, second = read(written("a.stl", content)).pieces
    assert (first.name, second.name) == ("LEFT ARM", "")
    for piece in (first, second):
        assert_array_equal(piece.positions[piece.triangles], cube.vertices[cube.triangles])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e30, np.frombuffer(b"\1\0\xa0\x7f", "<f4")[0]])
def test_a_facet_that_is_nowhere_is_named(cube, written, bad):
    content = bytearray(binary(cube))
    content[84 + 7 * 50 + 16 : 84 + 7 * 50 + 20] = np.float32(bad).tobytes()
    path = written("a.stl", bytes(content))
    assert refused_place(MeshError, path, read, path) == "facet 7"


@pytest.mark.parametrize(
    ("line", "instead", "place"),
    [(4, "vertex 0 0", 4), (4, "vertex 0 0 nan", 4), (4, "vortex 0 0 0", 8), (4, "", 8), (8, "", 15)],
)
def test_a_line_that_does_not_fit_is_named(cube, written, line, instead, place):
    lines = text(cube).split("\n")
    lines[line - 1] = instead
    path = written("a.stl", "\n".join(lines))
    assert refused_place(MeshError, path, read, path) == f"line {place}"


def test_a_text_without_facets_or_that_ends_within_one_is_refused(cube, written):
    for content in ("solid a\nendsolid a\n", text(cube)[:150]):
        refused(MeshError, read, written("a.stl", content))


def test_a_text_that_ends_after_a_facet_or_has_further_lines_is_read_with_a_note(cube, written):
    whole = text(cube)
    odd = whole.replace("  endfacet\n", "  endfacet\n  color 1 0 0\n", 2).replace("\n", "\n# by hand\n", 1)
    for content in (whole[: whole.rindex("endsolid")], whole[: whole.rindex("endsolid") - 1], odd + "made by nobody\n"):
        surface = read(written("a.stl", content))
        (piece,) = surface.pieces
        assert_array_equal(piece.positions, cube.vertices[cube.triangles].reshape(-1, 3))
        assert (piece.name, len(surface.notes)) == ("a cube", 1)
    assert "4 lines" in surface.notes[0]
    assert "line 2." in surface.notes[0]
