import numpy as np
import pytest

from engine_bridge.character.surfaces import off
from engine_bridge.character.surfaces.surface import linear
from puppetline.errors import MeshError


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
    np.testing.assert_array_equal(piece.positions, cube.vertices)
    np.testing.assert_array_equal(piece.triangles, cube.triangles)
    assert (surface.notes, piece.normals, piece.uvs, piece.colors) == ([], None, None, None)


def test_colours_of_faces_are_noted(cube, written):
    surface = read(written("a.off", text(cube, after=" 255 0 0")))
    np.testing.assert_array_equal(surface.pieces[0].triangles, cube.triangles)
    assert surface.notes == ["Colours of faces are omitted; glTF supports them at vertices only."]


@pytest.mark.parametrize(
    ("keyword", "more"),
    [
        ("COFF", " 255 128 0 255"), ("COFF", " 255 128 0"), ("COFF", " 1.0 0.50196 0.0"), ("NOFF", " 0 0 2"),
        ("STOFF", " 0.25 0.75"), ("CNOFF", " 0 0 2 255 128 0 255"), ("STCNOFF", " 0 0 2 255 128 0 255 0.25 0.75"),
    ],
)  # fmt: skip
def test_normals_colours_and_texture_coordinates_of_vertices_are_read(cube, written, keyword, more):
    (piece,) = read(written("a.off", text(cube, f"{keyword}\n8 6 0\n", more))).pieces
    np.testing.assert_array_equal(piece.positions, cube.vertices)
    if "N" in keyword:
        np.testing.assert_array_equal(piece.normals, [[0, 0, 2]] * 8)
    if "C" in keyword:
        np.testing.assert_allclose(piece.colors, linear(np.array([[255.0, 128.0, 0.0]] * 8)), atol=1e-5)
    if "ST" in keyword:
        np.testing.assert_array_equal(piece.uvs, [[0.25, 0.25]] * 8)
    assert [value is None for value in (piece.normals, piece.colors, piece.uvs)] == [
        part not in keyword for part in ("N", "C", "ST")
    ]


@pytest.mark.parametrize(
    ("content", "line", "found"),
    [
        ("OFF\n", None, "no counts"),
        ("OFF\nmany\n", 2, "'many'"),
        ("OFF\n3 -1 0\n", 2, "'3 -1 0'"),
        ("OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n", 2, "'3 0 0'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n3 0 1 2\n", 2, "3 vertices and 1 face announced"),
        ("OFF\n4000000000 99999999999999999999 0\n", 2, "4,000,000,000 vertices and 999,999,999,999 faces announced"),
        ("OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", 4, "'1 0'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 nan\n0 1 0\n3 0 1 2\n", 4, "'1 0 nan'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", 6, "'3 0 1 3'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n", 6, "'3 0 1 -1'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n4 0 1 2\n", 6, "'4 0 1 2'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n1e300 0 1 2\n", 6, "'1e300 0 1 2'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 1.5\n", 6, "'3 0 1 1.5'"),
        ("NOFF\n3 1 0\n0 0 0 0 0 1\n1 0 0\n0 1 0 0 0 1\n3 0 1 2\n", 4, "'1 0 0'"),
        ("OFF BINARY\n\0\0", None, "a binary OFF file"),
        ("4OFF\n3 1 0\n", None, "vertices with another dimension"),
    ],
)
def test_a_contradictory_line_is_refused_with_its_number(written, content, line, found):
    path = written("a.off", content)
    with pytest.raises(MeshError) as error:
        read(path)
    assert (error.value.where, error.value.found) == (f"{path}, line {line}" if line else str(path), found)


def test_small_faces_and_further_lines_are_noted(written):
    surface = read(written("a.off", "OFF\n3 2 0\n0 0 0\n1 0 0\n0 1 0\n2 0 1\n3 0 1 2\n0 1\n"))
    assert surface.pieces[0].triangles.tolist() == [[0, 1, 2]]
    assert surface.notes == ["1 line after the last face omitted.", "1 face with fewer than 3 corners omitted."]


@pytest.mark.parametrize("name", ["cheburashka.off", "dog_10k.off", "fertility_genus4.off", "nasty/two_triangles.off"])
def test_real_files_hold_their_own_numbers(real_data, name):
    path = real_data / "mesh" / name
    (piece,) = read(path).pieces
    numbers = [line.split() for line in path.read_text().split("\n")[1:] if line.strip()]
    vertices = int(numbers[0][0])
    np.testing.assert_array_equal(piece.positions, np.array(numbers[1 : vertices + 1], dtype=float))
    np.testing.assert_array_equal(piece.triangles, np.array(numbers[vertices + 1 :], dtype=int)[:, 1:])
