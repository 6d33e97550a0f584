"""The Laplacian of the tufted cover compared with its authors' library."""

import igl
import numpy as np
import pytest
import robust_laplacian as peer

from solver.surface import tufted


def soup(seed, count=60):
    """Triangles between random points, each edge in several of them."""
    rng = np.random.default_rng(seed)
    faces = np.array([rng.permutation(12)[:3] for _ in range(count)])
    _, once = np.unique(np.sort(faces, axis=1), axis=0, return_index=True)
    return rng.normal(size=(12, 3)), faces[once]


def book(leaves):
    """Triangles round one edge, in no order."""
    angles = np.random.default_rng(leaves).permutation(leaves) * 2 * np.pi / leaves + 0.1
    tips = np.column_stack([np.cos(angles), np.sin(angles), 0.3 * angles])
    faces = np.array([[0, 1, 2 + leaf] if leaf % 2 else [1, 0, 2 + leaf] for leaf in range(leaves)])
    return np.concatenate([[[0.0, 0, 0], [0, 0, 2]], tips]), faces


def sheet():
    """A bent sheet with a border, of triangles with sides from 1 to 30."""
    grid = np.stack(np.meshgrid(np.arange(12.0), 30 * np.arange(7.0), indexing="ij"), axis=-1).reshape(-1, 2)
    grid += np.random.default_rng(3).uniform(-0.3, 0.3, grid.shape)
    corner = np.arange(11 * 7).reshape(11, 7)[:, :6].ravel()
    faces = np.concatenate(
        [np.column_stack([corner, corner + 7, corner + 8]), np.column_stack([corner, corner + 8, corner + 1])]
    )
    return np.column_stack([grid, 0.02 * grid[:, 1] ** 2 / 30 + grid[:, 0] ** 2 / 20]), faces


def needle():
    """A tetrahedron with a face that is flat to 1e-9."""
    v = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 1e-9, 0], [0.5, 0.3, 1]])
    return v, np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])


SURFACES = {
    **{f"soup {seed}": soup(seed) for seed in range(12)},
    **{f"book of {leaves}": book(leaves) for leaves in (1, 2, 3, 4, 7, 30)},
    "sheet": sheet(),
    "needle": needle(),
}


def same_as_peer(v, f):
    L, mass = tufted.laplacian(v, f)
    expected, masses = peer.mesh_laplacian(v, f)
    np.testing.assert_allclose(L.toarray(), expected.toarray(), rtol=0, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(mass, masses.diagonal(), rtol=0, atol=1e-9 * mass.max())


@pytest.mark.parametrize("name", SURFACES)
def test_the_operator_equals_that_of_the_authors_library(name):
    v, f = SURFACES[name]
    used = np.unique(f)
    same_as_peer(v[used], np.searchsorted(used, f))


def test_the_operator_equals_the_librarys_on_a_figure_and_on_a_part_of_it(figure, creature):
    same_as_peer(figure.vertices, figure.faces)
    half = creature.faces[: len(creature.faces) // 2]
    used = np.unique(half)
    same_as_peer(creature.vertices[used], np.searchsorted(used, half))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["armadillo.obj", "makehuman_base.obj", "stanford_bunny_holes.obj", "suzanne.obj"])
def test_the_operator_equals_the_librarys_on_real_meshes(real_mesh, name):
    mesh = real_mesh(name)
    L, mass = tufted.laplacian(mesh.vertices / mesh.diagonal, mesh.faces)
    expected, masses = peer.mesh_laplacian(mesh.vertices / mesh.diagonal, mesh.faces)
    assert np.abs((L - expected).data).max() < 1e-10 * np.abs(expected.data).max()
    np.testing.assert_allclose(mass, masses.diagonal(), rtol=0, atol=1e-10 * mass.max())


@pytest.mark.parametrize("name", SURFACES)
def test_no_weight_is_negative_and_rows_sum_to_zero(name):
    v, f = SURFACES[name]
    L, mass = tufted.laplacian(v, f)
    dense = L.toarray()
    largest = np.abs(dense).max()
    np.testing.assert_array_equal(dense, dense.T)
    assert (dense - np.diag(dense.diagonal())).max() < 1e-6 + 1e-12 * largest
    np.testing.assert_allclose(dense.sum(axis=1), 0, atol=1e-12 * largest)
    assert mass.min() >= 0


def test_a_hub_of_many_triangles_takes_no_more_than_its_triangles():
    count = 100_000
    angles = np.linspace(0, 2 * np.pi, count + 1)[:-1]
    v = np.concatenate([[[0.0, 0, 0.1]], np.column_stack([np.cos(angles), np.sin(angles), 0.01 * np.sin(5 * angles)])])
    f = np.column_stack([np.zeros(count, dtype=np.int64), 1 + np.arange(count), 1 + (np.arange(count) + 1) % count])
    L, mass = tufted.laplacian(v, f)
    assert np.isfinite(L.data).all()
    assert mass.sum() == pytest.approx(igl.doublearea(v, f).sum() / 2, rel=0.01)  # all edges are a little longer
