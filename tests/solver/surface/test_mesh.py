import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from puppetline.errors import MeshError
from solver.surface import mesh as solver_mesh
from solver.surface.mesh import Repairs, snap, weld

from ..shapes import joined

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
CUBE = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])

COARSE = solver_mesh.MIN_VERTICES


@pytest.fixture(autouse=True)
def small_meshes(monkeypatch):
    """Do not split coarse meshes, so that tests of welding can use a cube."""
    monkeypatch.setattr(solver_mesh, "MIN_VERTICES", 0)


def split_cube():
    """A cube whose sides each have four vertices of their own, as in game assets."""
    positions = CORNERS[QUADS].reshape(-1, 3)
    quads = np.arange(24).reshape(6, 4)
    return positions, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


@pytest.mark.parametrize("seed", range(2))
def test_seams_with_the_rounding_of_float32_are_welded_and_vertices_ten_tolerances_apart_are_not(seed):
    rng = np.random.default_rng(seed)
    positions, triangles = split_cube()
    positions = positions @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.normal(size=3)
    noisy = positions + rng.uniform(-1e-7, 1e-7, positions.shape)
    mesh = weld(noisy, triangles)
    assert len(mesh.vertices) == 8
    assert_allclose(mesh.vertices[mesh.of_render], positions, rtol=0, atol=1e-6)
    noisy[:4] -= [1e-5 * np.sqrt(3), 0, 0]
    assert len(weld(noisy, triangles).vertices) == 12


def test_isolated_vertices_follow_the_nearest_of_the_surface():
    loose = np.array([[1.2, 1.1, 1.0], [-0.4, 0.1, 0.9], [1e9, -3.0, 0.2]])  # the farthest does not coarsen the welding
    mesh = weld(np.concatenate([loose, CORNERS]), CUBE + 3)
    assert_array_equal(mesh.vertices, CORNERS)
    assert_array_equal(mesh.faces, CUBE)
    assert_array_equal(mesh.vertices[mesh.of_render[:3]], [[1, 1, 1], [0, 0, 1], [1, 0, 0]])
    assert mesh.diagonal == pytest.approx(np.sqrt(3))


def test_degenerate_and_double_faces_are_dropped_and_repairs_counted_and_reported():
    middle, loose = [[0.5, 0.0, 0.0]], [[3.0, 3, 3], [4.0, 4, 4]]
    positions = np.concatenate([CORNERS, middle, loose, CORNERS[[2, 5, 5]]])
    faces = np.concatenate(
        [[[0, 8, 4], [0, 4, 4]], CUBE, CUBE[[3], [1, 2, 0]][None], CUBE[[7], ::-1], CUBE[[7]], [[1, 12, 13]]]
    )
    faces[faces == 2] = 11
    mesh = weld(positions, faces)
    assert mesh.repairs == Repairs(welded=2, degenerate=3, doubled=3, isolated=4)
    assert_array_equal(mesh.vertices[mesh.faces], CORNERS[CUBE])
    assert [note.split()[0] for note in mesh.repairs.describe()] == ["2", "3", "3", "4"]
    assert weld(mesh.vertices, mesh.faces).repairs.describe() == []


# --- parts that meet at a point


TWO_CUBES = np.concatenate([CORNERS, CORNERS + 1])  # the last corner of the one is the first of the other


@pytest.mark.parametrize("seed", range(2))
def test_parts_that_meet_at_a_point_each_have_a_vertex_there(seed):
    faces = np.random.default_rng(seed).permutation(np.concatenate([CUBE, CUBE + 8]))
    mesh = weld(TWO_CUBES, faces)
    assert (mesh.parts, len(mesh.vertices)) == (2, 16)
    assert_array_equal(mesh.vertices[mesh.faces], TWO_CUBES[faces])
    assert_array_equal(mesh.vertices[mesh.of_render], TWO_CUBES)
    assert_array_equal(mesh.of_render[faces], mesh.faces)
    assert mesh.repairs == Repairs()


def test_the_other_side_of_a_two_sided_part_follows_the_same_part():
    faces = np.concatenate([CUBE, CUBE + 8, CUBE[:, ::-1] + 16, CUBE[:, ::-1] + 24])
    mesh = weld(np.concatenate([TWO_CUBES, TWO_CUBES]), faces)
    assert (mesh.parts, len(mesh.vertices)) == (2, 16)
    assert_array_equal(mesh.of_render[16:], mesh.of_render[:16])
    assert mesh.repairs == Repairs(welded=16, doubled=24)


def test_parts_that_share_an_edge_are_one():
    shifted = CORNERS + np.array([1, 1, 0])
    mesh = weld(np.concatenate([CORNERS, shifted]), np.concatenate([CUBE, CUBE + 8]))
    assert (mesh.parts, len(mesh.vertices), mesh.nonmanifold_edges) == (1, 14, 1)
    assert mesh.repairs == Repairs(welded=2)


# --- which side is out


def sides(mesh):
    """Corner positions of each face, beginning with the smallest index: equal for faces turned the same way."""
    first = mesh.faces.argmin(axis=1)[:, None]
    return np.take_along_axis(mesh.faces, (first + np.arange(3)) % 3, axis=1)


def flipped(faces, chosen):
    return np.where(chosen[:, None], faces[:, ::-1], faces)


@pytest.mark.parametrize(
    ("surface", "share"),
    [*(("closed", share) for share in (0.01, 0.5, 0.9, 1.0)), ("dome", 0.15), ("hollow", 0.15), ("dome", 0.5)],
)
def test_a_closed_surface_faces_outwards_and_an_open_one_as_most_of_it_does_in_the_file_or_outwards(
    figure, surface, share
):
    dome = figure.faces[(figure.vertices[figure.faces][:, :, 1] > 1.3).all(axis=1)]  # open below
    faces = {"closed": figure.faces, "dome": dome, "hollow": dome[:, ::-1]}[surface]
    chosen = np.random.default_rng(1).random(len(faces)) < share
    mesh, whole = weld(figure.vertices, flipped(faces, chosen)), weld(figure.vertices, faces)
    assert_array_equal(sides(mesh), sides(whole))
    assert (mesh.repairs.turned, whole.repairs.turned) == (chosen.sum(), 0)


def test_each_part_is_turned_by_itself(figure):
    mesh = weld(*joined((figure.vertices, figure.faces[:, ::-1]), (figure.vertices + 9.0, figure.faces)))
    assert mesh.parts == 2
    assert mesh.repairs.turned == len(figure.faces)
    assert_array_equal(sides(mesh)[: len(figure.faces)], sides(figure))


def test_neighbours_agree_around_an_edge_of_three_faces(figure):
    """A fin on an edge of the figure, and randomly flipped faces."""
    a, b = figure.edges[100]
    tip = figure.vertices[[a, b]].mean(axis=0) * 1.5
    faces = np.concatenate([figure.faces, [[a, b, len(figure.vertices)]]])
    chosen = np.random.default_rng(2).random(len(faces)) < 0.3
    mesh = weld(np.concatenate([figure.vertices, [tip]]), flipped(faces, chosen))
    assert mesh.nonmanifold_edges == 1
    assert mesh.border_edges == 2
    assert_array_equal(sides(mesh)[:-1], sides(figure))


def test_a_surface_with_one_side_only_is_no_obstacle():
    """A Möbius strip of five triangles has no outside to agree on."""
    faces = (np.arange(5)[:, None] + np.arange(3)) % 5
    mesh = weld(np.random.default_rng(0).normal(size=(5, 3)), faces)
    assert_array_equal(np.sort(mesh.faces, axis=1), np.sort(faces, axis=1))
    assert mesh.border_edges == 5
    assert mesh.parts == 1


# --- too coarse


def test_a_coarse_surface_is_split_and_render_vertices_stay_at_their_places(monkeypatch):
    monkeypatch.setattr(solver_mesh, "MIN_VERTICES", COARSE)
    positions, triangles = split_cube()
    mesh = weld(positions, triangles)
    assert len(mesh.vertices) == 386
    assert_array_equal(mesh.vertices[mesh.of_render], positions)
    assert (mesh.parts, mesh.border_edges, mesh.nonmanifold_edges) == (1, 0, 0)
    assert mesh.repairs == Repairs(welded=16, split=12 * 64 - 12)
    assert_allclose(igl.doublearea(mesh.vertices, mesh.faces), 1 / 64)
    normals = igl.per_face_normals(mesh.vertices, mesh.faces, np.zeros(3))
    assert np.all(np.einsum("tx,tx->t", normals, mesh.vertices[mesh.faces].mean(axis=1) - 0.5) > 0)


def positions_with(value):
    positions = CORNERS.copy()
    positions[5, 1] = value
    return positions


@pytest.mark.parametrize(
    ("positions", "triangles", "found"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), "0 vertices"),
        (CORNERS, np.zeros((0, 3)), "0 triangles"),
        (positions_with(np.nan), CUBE, "vertex 5"),
        (CORNERS, [[0, 1, 2], [0, 8, 1]], "index 8 in triangle 1"),
        (CORNERS, [[0, 1, -2], [0, 3, 1]], "index -2 in triangle 0"),
        (np.ones((8, 3)), CUBE, "one point"),
        (CORNERS, CUBE[:3], "3 faces"),
        (CORNERS * [1, 0, 0], CUBE, "0 faces"),
        (CORNERS, np.repeat(CUBE[:1], 9, axis=0), "1 faces"),
    ],
)
def test_an_invalid_surface_is_refused(positions, triangles, found):
    with pytest.raises(MeshError) as caught:
        weld(positions, np.asarray(triangles, dtype=np.int64), name="dragon.glb")
    assert caught.value.where == "dragon.glb"
    assert found in caught.value.found


def test_snap_finds_what_a_search_of_the_whole_surface_finds(figure):
    rng = np.random.default_rng(3)
    near = figure.vertices[rng.integers(0, len(figure.vertices), 50)] + 0.05 * rng.normal(size=(50, 3))
    for points in (near, 5 * rng.normal(size=(50, 3)), near[:1]):
        expected = igl.point_mesh_squared_distance(points, figure.vertices, figure.faces)[2]
        corners, blend = snap(figure, points)
        found = np.einsum("hc,hcx->hx", blend, figure.vertices[corners])
        assert_allclose(found, expected.reshape(-1, 3), rtol=0, atol=1e-12)
