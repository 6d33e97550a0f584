import struct

import numpy as np
import pytest

from engine_bridge.character.surfaces import stl
from puppetline.errors import MeshError


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
@pytest.mark.parametrize("attribute", [0, 0x8000 + 0x7C1F])
def test_a_binary_file_is_read_facet_by_facet(cube, written, header, attribute):
    surface = read(written("a.stl", binary(cube, header, attribute)))
    (piece,) = surface.pieces
    np.testing.assert_array_equal(piece.positions, cube.vertices[cube.triangles].reshape(-1, 3))
    np.testing.assert_array_equal(piece.triangles, np.arange(36).reshape(-1, 3))
    assert (surface.faceted, surface.notes, piece.normals) == (True, [], None)


def test_solids_of_a_text_become_pieces_in_capitals_or_not(cube, written):
    content = text(cube, "left arm").upper() + "\n" + text(cube, "") + "solid empty\nendsolid\n"
    first, second = read(written("a.stl", content)).pieces
    assert (first.name, second.name) == ("LEFT ARM", "")
    for piece in (first, second):
        np.testing.assert_array_equal(piece.positions[piece.triangles], cube.vertices[cube.triangles])


def test_bytes_after_the_last_facet_are_noted(cube, written):
    surface = read(written("a.stl", binary(cube) + b"abc"))
    assert (len(surface.pieces[0].triangles), surface.notes) == (12, ["3 bytes after the last facet omitted."])


@pytest.mark.parametrize("facets", [13, 2**31, 2**32 - 1])
def test_a_binary_file_with_fewer_facets_than_it_says_is_refused(cube, written, facets):
    content = bytearray(binary(cube))
    content[80:84] = struct.pack("<I", facets)
    with pytest.raises(MeshError) as error:
        read(written("a.stl", bytes(content)))
    assert error.value.found == f"{facets:,} facets announced and data for 12"


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e30, np.frombuffer(b"\1\0\xa0\x7f", "<f4")[0]])
def test_a_facet_that_is_nowhere_is_named(cube, written, bad):
    content = bytearray(binary(cube))
    content[84 + 7 * 50 + 16 : 84 + 7 * 50 + 20] = np.float32(bad).tobytes()
    with pytest.raises(MeshError) as error:
        read(written("a.stl", bytes(content)))
    assert error.value.where.endswith("a.stl, facet 7")


@pytest.mark.parametrize(
    ("line", "instead", "where", "found"),
    [
        (4, "vertex 0 0", 4, "'0 0'"),
        (4, "vertex 0 0 nan", 4, "'0 0 nan'"),
        (4, "vortex 0 0 0", 8, "a facet with 2 vertices"),
        (4, "", 8, "a facet with 2 vertices"),
        (8, "", 15, "a facet with 6 vertices"),
    ],
)
def test_a_line_that_does_not_fit_is_named(cube, written, line, instead, where, found):
    lines = text(cube).split("\n")
    lines[line - 1] = instead
    with pytest.raises(MeshError) as error:
        read(written("a.stl", "\n".join(lines)))
    assert error.value.found == found
    assert error.value.where.endswith(f"line {where}")


def test_a_text_that_is_cut_off_is_refused(cube, written):
    whole = text(cube)
    for end in (whole.rindex("endfacet"), whole.rindex("endloop"), whole.rindex("vertex"), whole.index("outer")):
        with pytest.raises(MeshError, match="the end of the file within a solid"):
            read(written("a.stl", whole[:end]))


def test_a_text_that_ends_after_a_facet_is_read_with_a_note(cube, written):
    whole = text(cube)
    note = "The file ends without 'endsolid'; facets may be missing."
    for end in (whole.rindex("endsolid"), whole.rindex("endsolid") - 1):
        surface = read(written("a.stl", whole[:end]))
        np.testing.assert_array_equal(surface.pieces[0].positions, cube.vertices[cube.triangles].reshape(-1, 3))
        assert (surface.pieces[0].name, surface.notes) == ("a cube", [note])


def test_lines_that_are_none_of_the_format_are_left_out_with_a_note(cube, written):
    whole = text(cube)
    odd = whole.replace("  endfacet\n", "  endfacet\n  color 1 0 0\n", 2).replace("solid a", "; by hand\nsolid a", 1)
    odd = "solid a cube\n# by hand\n" + odd.split("\n", 2)[2] + "made by nobody\n"
    surface = read(written("a.stl", odd))
    (piece,) = surface.pieces
    np.testing.assert_array_equal(piece.positions, cube.vertices[cube.triangles].reshape(-1, 3))
    assert surface.notes == ["4 lines not understood and omitted; the first is line 2."]


def test_a_text_without_facets_is_refused(written):
    with pytest.raises(MeshError, match="no facets"):
        read(written("a.stl", "solid a\nendsolid a\n"))


def test_a_real_scan_has_the_file_s_own_floats(real_data):
    path = real_data / "mesh/nasty/busted.STL"
    (piece,) = read(path).pieces
    raw = np.frombuffer(path.read_bytes()[84:], "<u1").reshape(-1, 50)[:, 12:48].copy().view("<f4")
    np.testing.assert_array_equal(piece.positions.ravel(), raw.ravel())
    assert len(piece.triangles) == 3878
