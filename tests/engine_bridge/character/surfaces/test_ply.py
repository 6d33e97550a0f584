import struct

import numpy as np
import pytest
import trimesh
from PIL import Image

from engine_bridge.character.surfaces import ply
from engine_bridge.character.surfaces.surface import DEFAULT_MATERIAL, linear
from puppetline.errors import MeshError

XYZ = "element vertex {n}\nproperty float x\nproperty float y\nproperty float z\n"
FACES = "element face {n}\nproperty list uchar int vertex_indices\n"


def header(body, kind="ascii"):
    return f"ply\nformat {kind} 1.0\ncomment made by hand\n{body}end_header\n"


def rows(table):
    return "".join(" ".join(f"{value:g}" for value in row) + "\n" for row in table)


def cube_text(cube, more="", values=(), faces=None):
    vertices = [[*vertex, *values] for vertex in cube.vertices]
    faces = faces or [[4, *quad] for quad in cube.quads]
    return header(XYZ.format(n=8) + more + FACES.format(n=len(faces))) + rows(vertices) + rows(faces)


@pytest.fixture
def read(written):
    return lambda content: ply.read(path := written("a.ply", content), path.read_bytes())


def only(surface):
    (piece,) = surface.pieces
    return piece


def test_polygons_become_triangles(cube, read):
    surface = read(cube_text(cube))
    piece = only(surface)
    np.testing.assert_array_equal(piece.positions, cube.vertices)
    np.testing.assert_array_equal(piece.triangles, cube.triangles)
    assert (piece.material, piece.normals, piece.uvs, piece.colors, surface.notes) == (
        DEFAULT_MATERIAL,
        None,
        None,
        None,
        [],
    )


@pytest.mark.parametrize(
    ("more", "values", "rgba"),
    [
        ("property uchar red\nproperty uchar green\nproperty uchar blue\n", (255, 128, 1), (1, 128 / 255, 1 / 255, 1)),
        ("property uchar blue\nproperty uchar green\nproperty uchar red\n", (1, 0, 0), (0, 0, 1 / 255, 1)),
        ("property float red\nproperty float green\nproperty float blue\n", (1, 0.5, 0), (1, 0.5, 0, 1)),
        ("property float r\nproperty float g\nproperty float b\n", (255, 51, 0), (1, 0.2, 0, 1)),
        (
            "property ushort diffuse_red\nproperty ushort diffuse_green\nproperty ushort diffuse_blue\n"
            "property uchar alpha\n",
            (65535, 13107, 0, 51),
            (1, 0.2, 0, 0.2),
        ),
    ],
)
def test_colours_of_any_kind_and_order_are_read(cube, read, more, values, rgba):
    piece = only(read(cube_text(cube, more, values)))
    np.testing.assert_allclose(piece.colors, linear(np.array([rgba] * 8)), atol=1e-12)
    assert piece.material.alpha_mode == ("BLEND" if rgba[3] < 1 else "OPAQUE")


def test_colours_that_would_all_be_invisible_are_opaque(cube, read):
    more = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
    surface = read(cube_text(cube, more, (0, 0, 0, 0)))
    np.testing.assert_array_equal(only(surface).colors, [[0, 0, 0, 1]] * 8)
    assert surface.notes == ["All vertices would be invisible and were made opaque."]


@pytest.mark.parametrize("names", [("s", "t"), ("u", "v"), ("texture_u", "texture_v")])
def test_texture_coordinates_normals_and_the_picture_are_read(cube, read, tmp_path, names):
    Image.new("RGB", (2, 2), "red").save(tmp_path / "skin of a cube.png")
    more = "".join(f"property double {name}\n" for name in ("nx", "ny", "nz", *names))
    text = cube_text(cube, more, (0, 3, 4, 0.25, 0.75)).replace("made by hand", "TextureFile skin of a cube.png")
    piece = only(read(text))
    np.testing.assert_array_equal(piece.normals, [[0, 3, 4]] * 8)
    np.testing.assert_array_equal(piece.uvs, [[0.25, 0.25]] * 8)
    assert piece.material.texture.content == (tmp_path / "skin of a cube.png").read_bytes()


def test_a_picture_without_texture_coordinates_is_noted(cube, read):
    surface = read(cube_text(cube).replace("made by hand", "TextureFile skin.png"))
    assert (only(surface).material, surface.notes) == (
        DEFAULT_MATERIAL,
        ["The image 'skin.png' is omitted, because there are no texture coordinates."],
    )


def test_texture_coordinates_of_corners_split_vertices(cube, read):
    body = XYZ.format(n=9) + FACES.format(n=6) + "property list uchar float texcoord\n"
    square = [0, 0, 1, 0, 1, 1, 0, 1]
    faces = [[4, *quad, 8, *square] for quad in cube.quads]
    surface = read(header(body) + rows([*cube.vertices, [9, 9, 9]]) + rows(faces))
    piece = only(surface)
    np.testing.assert_array_equal(piece.positions[piece.triangles], cube.vertices[cube.triangles])
    fan = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]])
    np.testing.assert_array_equal(piece.uvs[piece.triangles], np.tile(fan, (6, 1, 1)))
    corners = {(vertex, *square[2 * k : 2 * k + 2]) for quad in cube.quads for k, vertex in enumerate(quad)}
    assert len(piece.positions) == len(corners)
    assert surface.notes == ["1 vertex without a face omitted."]


def test_strips_end_at_minus_one_or_with_their_list(read):
    body = XYZ.format(n=6) + "element tristrips 2\nproperty list int int vertex_indices\n"
    points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]]
    strips = [[9, 0, 1, 2, 3, -1, 2, 3, 4, 5], [7, 1, 3, 3, 5, -1, 0, 1]]
    piece = only(read(header(body) + rows(points) + rows(strips)))
    assert piece.triangles.tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]]


def test_a_property_that_is_not_converted_is_noted(cube, read):
    body = (
        XYZ.format(n=8) + "property float quality\nelement camera 1\nproperty float f\nproperty float g\n"
        + FACES.format(n=7) + "property uchar red\nelement edge 0\nproperty int a\nelement nothing 5\n"
    )  # fmt: skip
    faces = [[4, *quad, 9] for quad in cube.quads] + [[2, 0, 1, 9]]
    surface = read(header(body) + rows([[*v, 1] for v in cube.vertices]) + "1 2\n" + rows(faces))
    np.testing.assert_array_equal(only(surface).triangles, cube.triangles)
    assert surface.notes == [
        "Ignored: vertex quality, camera, face red, edge.",
        "1 face with fewer than 3 corners omitted.",
    ]


def points_only(cube):
    return header(XYZ.format(n=8)) + rows(cube.vertices)


@pytest.mark.parametrize(
    ("make", "found", "where"),
    [
        (points_only, "no faces", ""),
        (lambda cube: points_only(cube).replace("float x", "float a"), "no vertices", ""),
        (lambda cube: header(FACES.format(n=1)) + "3 0 1 2\n", "no vertices", ""),
        (lambda cube: cube_text(cube).replace("0 2 3 1", "0 2 3 8"), "vertex 8", ", face 0"),
        (lambda cube: cube_text(cube).replace("1 3 7 5", "1 3 -7 5"), "vertex -7", ", face 5"),
        (lambda cube: cube_text(cube).replace("1 3 7 5", "1 3 7 0.5"), "vertex 0.5", ", face 5"),
        (lambda cube: cube_text(cube).replace("1 0 1", "1 nan 1"), "[1.0, nan, 1.0]", ", vertex 5"),
        (lambda cube: cube_text(cube).replace("list uchar int ", "int "), "one corner per face", ", element face"),
    ],
)
def test_a_file_without_a_surface_is_refused(cube, read, tmp_path, make, found, where):
    with pytest.raises(MeshError) as error:
        read(make(cube))
    assert (error.value.found, error.value.where) == (found, f"{tmp_path / 'a.ply'}{where}")


@pytest.mark.parametrize("order", ["<", ">"])
def test_mixed_polygons_in_a_binary_file_are_read(cube, read, order):
    kind = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    content = header(XYZ.format(n=8) + "property uchar red\n" + FACES.format(n=7), kind).encode()
    content += b"".join(struct.pack(order + "3fB", *vertex, 7) for vertex in cube.vertices)
    faces = [*cube.quads[:5], [1, 3, 7], [1, 7, 5]]
    content += b"".join(struct.pack(f"{order}B{len(face)}i", len(face), *face) for face in faces)
    piece = only(read(content))
    np.testing.assert_array_equal(piece.positions, cube.vertices)
    np.testing.assert_array_equal(piece.triangles, cube.triangles)


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
@pytest.mark.parametrize("name", ["homer_6k.obj", "cheburashka.off"])
def test_a_file_written_by_trimesh_is_read_back_unchanged(real_data, written, encoding, name):
    mesh = trimesh.load(real_data / "mesh" / name, process=False)
    rng = np.random.default_rng(4)
    mesh.visual.vertex_colors = rng.integers(0, 256, (len(mesh.vertices), 4), dtype=np.uint8)
    path = written("a.ply", mesh.export(file_type="ply", encoding=encoding, vertex_normal=True))
    piece = only(ply.read(path, path.read_bytes()))
    tolerance = 1e-7 if encoding == "binary" else 1e-6
    np.testing.assert_allclose(piece.positions, mesh.vertices, atol=tolerance)
    np.testing.assert_array_equal(piece.triangles, mesh.faces)
    np.testing.assert_allclose(piece.normals, mesh.vertex_normals, atol=tolerance)
    np.testing.assert_allclose(piece.colors, linear(mesh.visual.vertex_colors / 255), atol=1e-12)
