import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose, assert_array_equal
from PIL import Image

from engine_bridge.character.surfaces import ply
from engine_bridge.character.surfaces.surface import DEFAULT_MATERIAL, linear
from puppetline.errors import MeshError

from ...refusals import refused_place

XYZ = "element vertex {n}\nproperty float x\nproperty float y\nproperty float z\n"
FACES = "element face {n}\nproperty list uchar int vertex_indices\n"


def header(body, kind="ascii"):
    return f"ply\nformat {kind} 1.0\ncomment made by hand\n{body}end_header\n"


def rows(table):
    return "".join(" ".join(f"{value:g}" for value in row) + "\n" for row in table)


def properties(text):
    """Return header lines for a type and names."""
    kind, *names = text.split()
    return "".join(f"property {kind} {name}\n" for name in names)


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


@pytest.mark.parametrize(
    ("more", "values", "rgba"),
    [
        ("uchar red green blue", (255, 128, 1), (1, 128 / 255, 1 / 255, 1)),
        ("uchar blue green red", (1, 0, 0), (0, 0, 1 / 255, 1)),
        ("float red green blue", (1, 0.5, 0), (1, 0.5, 0, 1)),
        ("float r g b", (255, 51, 0), (1, 0.2, 0, 1)),
        ("ushort diffuse_red diffuse_green diffuse_blue alpha", (65535, 13107, 0, 13107), (1, 0.2, 0, 0.2)),
        ("uchar red green blue alpha", (0, 0, 0, 0), (0, 0, 0, 1)),
    ],
)
def test_colours_of_any_kind_and_order_are_read_and_opaque_if_all_were_invisible(cube, read, more, values, rgba):
    surface = read(cube_text(cube, properties(more), values))
    piece = only(surface)
    assert_allclose(piece.colors, linear(np.array([rgba] * 8)), atol=1e-12)
    assert piece.material.alpha_mode == ("BLEND" if rgba[3] < 1 else "OPAQUE")
    assert len(surface.notes) == (not any(values))


@pytest.mark.parametrize("names", ["s t", "u v", "texture_u texture_v"])
def test_texture_coordinates_normals_and_the_picture_are_read(cube, read, tmp_path, names):
    Image.new("RGB", (2, 2), "red").save(tmp_path / "skin of a cube.png")
    more = properties(f"double nx ny nz {names}")
    text = cube_text(cube, more, (0, 3, 4, 0.25, 0.75)).replace("made by hand", "TextureFile skin of a cube.png")
    piece = only(read(text))
    assert_array_equal(piece.normals, [[0, 3, 4]] * 8)
    assert_array_equal(piece.uvs, [[0.25, 0.25]] * 8)
    assert piece.material.texture.content == (tmp_path / "skin of a cube.png").read_bytes()


def test_a_picture_without_texture_coordinates_is_noted(cube, read):
    surface = read(cube_text(cube).replace("made by hand", "TextureFile skin.png"))
    assert (only(surface).material, len(surface.notes)) == (DEFAULT_MATERIAL, 1)


def test_texture_coordinates_of_corners_split_vertices(cube, read):
    body = XYZ.format(n=9) + FACES.format(n=6) + "property list uchar float texcoord\n"
    square = [0, 0, 1, 0, 1, 1, 0, 1]
    faces = [[4, *quad, 8, *square] for quad in cube.quads]
    surface = read(header(body) + rows([*cube.vertices, [9, 9, 9]]) + rows(faces))
    piece = only(surface)
    assert_array_equal(piece.positions[piece.triangles], cube.vertices[cube.triangles])
    fan = np.array([[[0, 1], [1, 1], [1, 0]], [[0, 1], [1, 0], [0, 0]]])
    assert_array_equal(piece.uvs[piece.triangles], np.tile(fan, (6, 1, 1)))
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
    assert_array_equal(only(surface).triangles, cube.triangles)
    ignored, small = surface.notes
    assert all(name in ignored for name in ("vertex quality", "camera", "face red", "edge"))
    assert small.startswith("1 face ")


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("float x", "float a", ""),
        ("element vertex", "element corner", ""),
        ("element face", "element edge", ""),
        ("0 2 3 1", "0 2 3 8", "face 0"),
        ("1 3 7 5", "1 3 -7 5", "face 5"),
        ("1 3 7 5", "1 3 7 0.5", "face 5"),
        ("1 0 1", "1 nan 1", "vertex 5"),
        ("list uchar int ", "int ", "element face"),
    ],
)
def test_a_file_without_a_surface_is_refused(cube, read, tmp_path, old, new, place):
    assert refused_place(MeshError, tmp_path / "a.ply", read, cube_text(cube).replace(old, new)) == place


@pytest.mark.parametrize("encoding", ["ascii", "binary"])
def test_a_file_written_by_trimesh_is_read_back_unchanged(ball, written, encoding):
    mesh = trimesh.Trimesh(ball.vertices, ball.triangles, process=False)
    rng = np.random.default_rng(4)
    mesh.visual.vertex_colors = rng.integers(0, 256, (len(mesh.vertices), 4), dtype=np.uint8)
    path = written("a.ply", mesh.export(file_type="ply", encoding=encoding, vertex_normal=True))
    piece = only(ply.read(path, path.read_bytes()))
    tolerance = 1e-7 if encoding == "binary" else 1e-6
    assert_allclose(piece.positions, mesh.vertices, atol=tolerance)
    assert_array_equal(piece.triangles, mesh.faces)
    assert_allclose(piece.normals, mesh.vertex_normals, atol=tolerance)
    assert_allclose(piece.colors, linear(mesh.visual.vertex_colors / 255), atol=1e-12)
