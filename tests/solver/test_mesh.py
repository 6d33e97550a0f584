import numpy as np
import pytest

from puppetline.errors import MeshError
from solver.mesh import SolverMesh, snap, undirected_edges, weld

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
CUBE = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])

TRIANGLE = SolverMesh(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]), np.arange(3))


def split_cube():
    """A cube as game assets have it: each side with its own four vertices."""
    positions = CORNERS[QUADS].reshape(-1, 3)
    quads = np.arange(24).reshape(6, 4)
    return positions, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def test_split_vertices_are_welded_and_every_render_vertex_keeps_its_place():
    positions, triangles = split_cube()
    mesh = weld(positions, triangles)
    assert mesh.vertices.shape == (8, 3)
    assert mesh.edges.shape == (18, 2)
    np.testing.assert_array_equal(mesh.vertices[mesh.of_render], positions)
    np.testing.assert_array_equal(mesh.vertices[mesh.faces], positions[triangles])
    assert mesh.components.max() == 0


def test_welded_vertices_keep_the_order_of_the_file():
    order = np.random.default_rng(0).permutation(8)
    mesh = weld(CORNERS[order], np.argsort(order)[CUBE])
    np.testing.assert_array_equal(mesh.vertices, CORNERS[order])
    np.testing.assert_array_equal(mesh.of_render, np.arange(8))


@pytest.mark.parametrize("seed", range(20))
def test_seams_with_the_rounding_of_float32_are_welded(seed):
    rng = np.random.default_rng(seed)
    positions, triangles = split_cube()
    positions = positions @ np.linalg.qr(rng.normal(size=(3, 3)))[0] + rng.normal(size=3)
    noisy = positions + rng.uniform(-1e-7, 1e-7, positions.shape)
    mesh = weld(noisy, triangles)
    assert len(mesh.vertices) == 8
    np.testing.assert_allclose(mesh.vertices[mesh.of_render], positions, rtol=0, atol=1e-6)


def test_vertices_ten_tolerances_apart_stay_apart():
    positions, triangles = split_cube()
    positions[:4] -= [1e-5 * np.sqrt(3), 0, 0]
    assert len(weld(positions, triangles).vertices) == 12


def test_the_result_does_not_depend_on_scale_or_place():
    positions, triangles = split_cube()
    rng = np.random.default_rng(1)
    for scale in (1e-6, 1.0, 1e6):
        offset = scale * rng.normal(size=3)
        mesh = weld(scale * positions + offset, triangles)
        np.testing.assert_array_equal(mesh.faces, weld(positions, triangles).faces)
        np.testing.assert_allclose(
            mesh.vertices,
            scale * CORNERS[QUADS].reshape(-1, 3)[[0, 1, 2, 3, 4, 5, 6, 7]] + offset,
            rtol=0,
            atol=1e-9 * scale,
        )


def test_isolated_vertices_follow_the_nearest_of_the_surface():
    loose = np.array([[1.2, 1.1, 1.0], [-0.4, 0.1, 0.9], [0.9, -3.0, 0.2]])
    mesh = weld(np.concatenate([loose, CORNERS]), CUBE + 3)
    np.testing.assert_array_equal(mesh.vertices, CORNERS)
    np.testing.assert_array_equal(mesh.vertices[mesh.of_render[:3]], [[1, 1, 1], [0, 0, 1], [1, 0, 0]])


def test_an_isolated_vertex_far_away_does_not_coarsen_the_welding():
    mesh = weld(np.concatenate([CORNERS, [[1e9, 0.0, 0.0]]]), CUBE)
    np.testing.assert_array_equal(mesh.vertices, CORNERS)
    np.testing.assert_array_equal(mesh.faces, CUBE)
    assert mesh.diagonal == pytest.approx(np.sqrt(3))


def test_degenerate_and_double_faces_are_dropped():
    middle = np.array([[0.5, 0.0, 0.0]])  # on the edge from corner 0 to corner 4
    extra = [[0, 0, 5], [0, 8, 4], CUBE[3], CUBE[3][[1, 2, 0]], CUBE[3][::-1]]
    mesh = weld(np.concatenate([CORNERS, middle]), np.concatenate([[extra[0]], CUBE, extra[1:]]))
    np.testing.assert_array_equal(mesh.faces, CUBE)
    np.testing.assert_array_equal(mesh.vertices, CORNERS)


def test_faces_that_collapse_when_their_corners_are_welded_are_dropped():
    positions = np.concatenate([CORNERS, CORNERS[[3]]])
    mesh = weld(positions, np.concatenate([CUBE, [[3, 8, 1]]]))
    np.testing.assert_array_equal(mesh.faces, CUBE)


def test_diagonal_edges_and_components_of_two_cubes():
    mesh = weld(np.concatenate([CORNERS, CORNERS + np.array([3, 0, 0])]), np.concatenate([CUBE, CUBE + 8]))
    assert mesh.diagonal == pytest.approx(np.sqrt(16 + 1 + 1))
    assert len(mesh.edges) == 36
    assert np.all(mesh.edges[:, 0] < mesh.edges[:, 1])
    np.testing.assert_array_equal(mesh.components, np.repeat([0, 1], 8))


def test_each_undirected_edge_stands_once():
    np.testing.assert_array_equal(
        undirected_edges(np.array([[2, 0, 1], [1, 0, 3]])), [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]]
    )


def positions_with(value):
    positions = CORNERS.copy()
    positions[5, 1] = value
    return positions


@pytest.mark.parametrize(
    ("positions", "triangles", "found", "expected"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3)), "0 vertices and 0 triangles", "a triangle surface"),
        (CORNERS, np.zeros((0, 3)), "8 vertices and 0 triangles", "a triangle surface"),
        (positions_with(np.nan), CUBE, "not a finite number at vertex 5", "finite coordinates"),
        (positions_with(-np.inf), CUBE, "not a finite number at vertex 5", "finite coordinates"),
        (CORNERS, [[0, 1, 2], [0, 8, 1]], "vertex index 8 in triangle 1", "indices from 0 to 7"),
        (CORNERS, [[0, 1, -2], [0, 3, 1]], "vertex index -2 in triangle 0", "indices from 0 to 7"),
        (np.ones((8, 3)), CUBE, "all vertices at one point", "a surface with an extent"),
        (
            np.concatenate([np.ones((8, 3)), [[2.0, 2, 2]]]),
            CUBE,
            "all vertices at one point",
            "a surface with an extent",
        ),
        (CORNERS, CUBE[:3], "3 faces with an area", "at least 4 triangles"),
        (CORNERS * [1, 0, 0], CUBE, "0 faces with an area", "at least 4 triangles"),
        (CORNERS, np.repeat(CUBE[:1], 9, axis=0), "1 faces with an area", "at least 4 triangles"),
    ],
)
def test_what_is_no_surface_is_refused_with_a_message_that_says_all(positions, triangles, found, expected):
    with pytest.raises(MeshError) as caught:
        weld(positions, np.asarray(triangles, dtype=np.int64), name="dragon.glb")
    assert caught.value.where == "dragon.glb"
    assert found in caught.value.found
    assert expected in caught.value.expected
    assert caught.value.fix
    assert str(caught.value).startswith("dragon.glb: found ")


@pytest.mark.parametrize(
    ("point", "blend"),
    [
        ([0.2, 0.3, 5.0], [0.5, 0.2, 0.3]),  # above the inside
        ([0.5, -1.0, 2.0], [0.5, 0.5, 0.0]),  # nearest to an edge
        ([1.0, 1.0, 0.0], [0.0, 0.5, 0.5]),  # nearest to the long edge
        ([3.0, -1.0, 0.0], [0.0, 1.0, 0.0]),  # nearest to a vertex
        ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]),  # a vertex itself
    ],
)
def test_snap_gives_barycentric_coordinates_of_the_nearest_surface_point(point, blend):
    corners, found = snap(TRIANGLE, np.array([point]))
    np.testing.assert_array_equal(corners, [[0, 1, 2]])
    np.testing.assert_allclose(found, [blend], atol=1e-12)


def test_snap_takes_a_point_outside_to_the_face_it_is_over():
    mesh = weld(CORNERS, CUBE)
    points = np.array([[0.3, 0.6, 7.0], [-2.0, 0.25, 0.5], [0.9, 0.5, 0.4]])
    corners, blend = snap(mesh, points)
    nearest = np.einsum("hc,hcx->hx", blend, mesh.vertices[corners])
    np.testing.assert_allclose(nearest, [[0.3, 0.6, 1.0], [0.0, 0.25, 0.5], [1.0, 0.5, 0.4]], atol=1e-12)
    np.testing.assert_allclose(blend.sum(axis=1), 1.0, atol=1e-12)


def test_snap_is_no_farther_than_any_point_of_a_dense_sample(figure):
    rng = np.random.default_rng(3)
    points = rng.uniform(figure.vertices.min(axis=0), figure.vertices.max(axis=0), (20, 3))
    corners, blend = snap(figure, points)
    nearest = np.einsum("hc,hcx->hx", blend, figure.vertices[corners])
    assert blend.min() >= -1e-9
    shares = rng.dirichlet(np.ones(3), (len(figure.faces), 20))
    sample = (shares @ figure.vertices[figure.faces]).reshape(-1, 3)
    for point, distance in zip(points, np.linalg.norm(nearest - points, axis=1), strict=True):
        assert distance <= np.linalg.norm(sample - point, axis=1).min() + 1e-12
