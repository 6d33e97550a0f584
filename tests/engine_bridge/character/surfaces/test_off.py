import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.surfaces import off
from engine_bridge.character.surfaces.surface import linear
from puppetline.errors import MeshError

from ...refusals import refused_place


def text(cube, head="OFF\n8 6 12\n", more="", after=""):
    vertices = "".join(f"{x:g} {y:g} {z:g}{more}\n" for x, y, z in cube.vertices)
    return head + vertices + "".join(f"4 {a} {b} {c} {d}{after}\n" for a, b, c, d in cube.quads)


def read(path):
    return off.read(path, path.read_bytes())


@pytest.mark.parametrize(
    "head",
    [
        "OFF\n8 6 12\n",
        "OFF 8 6 0\n",
        "OFF8 6 0\n",
        "# made by hand\n\nOFF # a cube\n\n8 6 # six\n",
        "8 6 12\n",
        "\ufeffOFF\r\n8 6 0\r\n",
    ],
)
def test_all_ways_to_begin_give_the_same_surface(cube, written, head):
    surface = read(written("a.off", text(cube, head)))
    (piece,) = surface.pieces
    assert_array_equal(piece.positions, cube.vertices)
    assert_array_equal(piece.triangles, cube.triangles)
    assert (surface.notes, piece.normals, piece.uvs, piece.colors) == ([], None, None, None)


def test_colours_of_faces_small_faces_and_further_lines_are_noted(cube, written):
    surface = read(written("a.off", text(cube, "OFF 8 7 0\n", after=" 255 0 0") + "2 0 1\n0 1\n"))
    assert_array_equal(surface.pieces[0].triangles, cube.triangles)
    assert len(surface.notes) == 3


@pytest.mark.parametrize(
    ("keyword", "more"),
    [
        ("COFF", " 255 128 0 255"), ("COFF", " 255 128 0"), ("COFF", " 1.0 0.50196 0.0"), ("NOFF", " 0 0 2"),
        ("STOFF", " 0.25 0.75"), ("CNOFF", " 0 0 2 255 128 0 255"), ("STCNOFF", " 0 0 2 255 128 0 255 0.25 0.75"),
    ],
)  # fmt: skip
def test_normals_colours_and_texture_coordinates_of_vertices_are_read(cube, written, keyword, more):
    (piece,) = read(written("a.off", text(cube, f"{keyword}\n8 6 0\n", more))).pieces
    assert_array_equal(piece.positions, cube.vertices)
    if "N" in keyword:
        assert_array_equal(piece.normals, [[0, 0, 2]] * 8)
    if "C" in keyword:
        assert_allclose(piece.colors, linear(np.array([[255.0, 128.0, 0.0]] * 8)), atol=1e-5)
    if "ST" in keyword:
        assert_array_equal(piece.uvs, [[0.25, 0.25]] * 8)
    assert [value is None for value in (piece.normals, piece.colors, piece.uvs)] == [
        part not in keyword for part in ("N", "C", "ST")
    ]


@pytest.mark.parametrize(
    ("content", "place"),
    [
        ("OFF\n", ""),
        ("OFF BINARY\n\0\0", ""),
        ("4OFF\n3 1 0\n", ""),
        ("OFF\nmany\n", "line 2"),
        ("OFF\n3 -1 0\n", "line 2"),
        ("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", "line 2"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n3 0 1 2\n", "line 2"),
        ("OFF\n4000000000 99999999999999999999 0\n", "line 2"),
        ("NOFF\n3 1 0\n0 0 0 0 0 1\n1 0 0\n0 1 0 0 0 1\n3 0 1 2\n", "line 4"),
        *((f"OFF\n3 1 0\n0 0 0\n{vertex}\n0 1 0\n3 0 1 2\n", "line 4") for vertex in ("1 0", "1 0 nan")),
        *(
            (f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n{face}\n", "line 6")
            for face in ("3 0 1 3", "3 0 1 -1", "4 0 1 2", "1e300 0 1 2", "3 0 1 1.5")
        ),
    ],
)
def test_a_contradictory_line_is_refused_with_its_number(written, content, place):
    path = written("a.off", content)
    assert refused_place(MeshError, path, read, path) == place
