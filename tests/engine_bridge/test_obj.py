import numpy as np
import pytest

from engine_bridge.obj import read
from puppetline.errors import MeshError


def written(tmp_path, text):
    path = tmp_path / "mesh.obj"
    path.write_text(text)
    return path


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def test_polygons_become_fans_whatever_stands_behind_the_index(tmp_path):
    vertices, triangles, colors = read(written(tmp_path, f"o square\n{SQUARE}vt 0 0\nvn 0 0 1\nf 1/1/1 2//1 3/1 4\n"))
    np.testing.assert_array_equal(vertices, [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    np.testing.assert_array_equal(triangles, [[0, 1, 2], [0, 2, 3]])
    assert colors is None


def test_negative_indices_count_back_from_the_last_vertex_so_far(tmp_path):
    _, triangles, _ = read(written(tmp_path, f"{SQUARE}f -4 -3 -2\nv 5 5 5\nf -4 -3 -1\n"))
    np.testing.assert_array_equal(triangles, [[0, 1, 2], [1, 2, 4]])


def test_a_backslash_continues_a_line(tmp_path):
    _, triangles, _ = read(written(tmp_path, f"{SQUARE}f 1 \\\n2 \\\n3\n"))
    np.testing.assert_array_equal(triangles, [[0, 1, 2]])


def test_colours_behind_the_coordinates_are_kept(tmp_path):
    vertices, _, colors = read(written(tmp_path, "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n"))
    np.testing.assert_array_equal(colors, np.eye(3))
    assert vertices.shape == (3, 3)


@pytest.mark.parametrize(
    ("line", "found"), [("v 1 x 0", "'v 1 x 0'"), ("f 1 2 zwei", "'f 1 2 zwei'"), ("f 0 1 2", "'f 0 1 2'")]
)
def test_a_line_that_cannot_be_read_is_named(tmp_path, line, found):
    with pytest.raises(MeshError) as error:
        read(written(tmp_path, f"{SQUARE}{line}\n"))
    assert error.value.where.endswith("mesh.obj, line 5")
    assert error.value.found == found


@pytest.mark.parametrize(
    ("text", "found"), [("", "no vertices"), ("v 1 2\n", "a vertex with fewer than 3 coordinates")]
)
def test_a_file_without_vertices_is_refused(tmp_path, text, found):
    with pytest.raises(MeshError) as error:
        read(written(tmp_path, text))
    assert error.value.found == found


def test_real_files_with_quads_continuations_and_negative_indices(real_data):
    mesh = real_data / "mesh"
    sizes = {
        path: [len(part) for part in read(mesh / path)[:2]]
        for path in ("beast_32k_quads.obj", "nasty/negative_indices.obj", "nasty/wallhole.obj")
    }
    assert sizes == {
        "beast_32k_quads.obj": [32311, 64618],
        "nasty/negative_indices.obj": [8, 12],
        "nasty/wallhole.obj": [92, 66],
    }
