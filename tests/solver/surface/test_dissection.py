import igl
import numpy as np
import pytest
from scipy.sparse import csc_matrix, csr_matrix, eye
from scipy.sparse.linalg import splu

from solver.surface.dissection import nested_dissection


def grid(size):
    """A diagonally dominant matrix with entries at the edges of a grid, and the places of its vertices."""
    vertices, faces = igl.triangulated_grid(size, size)
    links = csr_matrix(igl.adjacency_matrix(faces), dtype=float)
    return csr_matrix(10 * links.sum(axis=1).max() * eye(size * size) - links), np.insert(vertices, 2, 0.0, axis=1)


def fill(A, order):
    B = csc_matrix(A[order][:, order])
    return splu(B, permc_spec="NATURAL", options={"SymmetricMode": True}).nnz


def shuffle(A, places, seed=0):
    order = np.random.default_rng(seed).permutation(len(places))
    return csr_matrix(A[order][:, order]), places[order]


def dissection(A, places):
    return nested_dissection(A.indptr, A.indices, places)


@pytest.mark.parametrize("places", ["own", "random", "one", "line"])
def test_every_vertex_stands_there_once_wherever_it_is(places):
    A, own = shuffle(*grid(30))
    rng = np.random.default_rng(1)
    others = {"random": rng.normal(size=own.shape), "one": np.ones(own.shape), "line": own * [1, 0, 0]}
    order = dissection(A, others.get(places, own))
    np.testing.assert_array_equal(np.sort(order), np.arange(900))


def test_a_grid_fills_in_little_more_than_by_minimum_degree_and_much_less_than_row_by_row():
    A, places = shuffle(*grid(120))
    best = splu(csc_matrix(A), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).nnz
    rows = np.lexsort(places.T)
    assert fill(A, dissection(A, places)) < min(1.7 * best, fill(A, rows) / 3)


def test_an_empty_graph_and_a_single_vertex_have_an_order():
    for count in (0, 1):
        empty = csr_matrix((count, count))
        assert dissection(empty, np.zeros((count, 3))).tolist() == list(range(count))
