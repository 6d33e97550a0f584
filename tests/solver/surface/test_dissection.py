import numpy as np
import pytest
from scipy.sparse import coo_matrix, csc_matrix, csr_matrix, eye
from scipy.sparse.linalg import splu

from solver.surface.dissection import nested_dissection


def operator(edges, count):
    """A diagonally dominant matrix with entries at edges."""
    a, b = np.asarray(edges).T
    links = coo_matrix((np.ones(len(a)), (a, b)), shape=(count, count))
    links = csr_matrix(links + links.T)
    return csr_matrix(10 * max(1, links.sum(axis=1).max()) * eye(count) - links)


def grid(size):
    number = np.arange(size * size).reshape(size, size)
    pairs = [(number[1:], number[:-1]), (number[:, 1:], number[:, :-1]), (number[1:, 1:], number[:-1, :-1])]
    edges = np.concatenate([np.column_stack([a.ravel(), b.ravel()]) for a, b in pairs])
    places = np.stack(np.meshgrid(*[np.arange(float(size))] * 2, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    return operator(edges, size * size), places


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
