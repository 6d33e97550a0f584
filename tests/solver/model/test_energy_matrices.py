"""Products of tall sparse matrices against SciPy's."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags

from solver.model import cell_products, energy_matrices, fields
from solver.surface.mesh import SolverMesh


@pytest.fixture(scope="module")
def operator(creature, creature_model):
    unit = SolverMesh(creature_model.to_model(creature.vertices), creature.faces, creature.of_render)
    return *fields.laplacian(unit), unit.vertices


def tall(rest, ladder, weights, isolines):
    """φ with the weights in it, and W."""
    phi = fields.interpolation(ladder, isolines) @ diags(np.repeat(weights, isolines))
    homogeneous = np.column_stack([rest, np.ones(len(rest))])
    blocks = [diags(values) @ phi for values in homogeneous.T]
    order = np.arange(4 * phi.shape[1]).reshape(4, -1).T.ravel()
    return csr_matrix(phi), csr_matrix(np.hstack([block.toarray() for block in blocks])[:, order])


@pytest.mark.parametrize("by_cells", [False, True])
@pytest.mark.parametrize("chunk", [1, 37, 384, 10**6])
@pytest.mark.parametrize(("count", "isolines"), [(8, 10), (1, 2), (3, 4)])
def test_products_are_those_of_the_sparse_matrices(operator, monkeypatch, chunk, count, isolines, by_cells):
    monkeypatch.setattr(energy_matrices, "MAX_CHUNK_ROWS", chunk)
    monkeypatch.setattr(cell_products, "MAX_CHUNK_ROWS", chunk)
    L, mass, rest = operator
    rng = np.random.default_rng(count)
    ladder = np.clip((rest @ rng.normal(size=(3, count)) + 0.5) * (isolines - 1), 0, isolines - 1)
    weights = rng.uniform(0.5, 1.5, count)
    cluster = rng.integers(0, 7, len(rest)).astype(np.int32)
    chain = csr_matrix(diags([np.full(len(rest) - 1, 0.5)], [1]))
    tied = csr_matrix(L + chain + chain.T - diags(np.asarray((chain + chain.T).sum(axis=1)).ravel()))
    found = energy_matrices.products(tied, L, mass, rest, ladder, weights, isolines, cluster, by_cells=by_cells)
    phi, W = tall(rest, ladder, weights, isolines)
    KW = diags(mass**-0.5) @ tied @ W
    delta = tied @ rest
    W_delta = np.stack([(diags(mass**-0.5 * d) @ phi).toarray() for d in delta.T], axis=2).reshape(len(rest), -1)
    of_cluster = np.eye(7)[cluster]
    each = np.einsum("v,vc,vx->vcx", mass**-0.5, of_cluster, delta).reshape(len(rest), -1)
    expected = ((KW.T @ KW).toarray(), KW.T @ W_delta, (W.T @ W).toarray(), -(W.T @ L @ W).toarray(), KW.T @ each)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * np.abs(other).max())  # L cancels


def test_rows_that_lie_between_far_isolines_go_into_one_chunk(operator):
    """Neighbours that are at both ends of the ladder leave nothing out in between."""
    L, mass, rest = operator
    ladder = np.random.default_rng(0).uniform(0, 9, (len(rest), 2))
    cluster = np.zeros(len(rest), dtype=np.int32)
    A = energy_matrices.products(L, L, mass, rest, ladder, np.ones(2), 10, cluster).A
    _, W = tall(rest, ladder, np.ones(2), 10)
    KW = diags(mass**-0.5) @ L @ W
    np.testing.assert_allclose(A, (KW.T @ KW).toarray(), rtol=0, atol=1e-11 * np.abs(A).max())


def test_cells_have_the_vertices_whose_neighbours_are_between_the_same_isolines(operator):
    L, _, rest = operator
    below = np.floor(6 * (rest + 0.5)).astype(np.int64)
    inside = cell_products.inside_cells(L.indptr, L.indices, below)
    rows = np.repeat(np.arange(len(rest)), np.diff(L.indptr))
    differs = (below[rows] != below[L.indices]).any(axis=1)
    np.testing.assert_array_equal(inside, ~np.isin(np.arange(len(rest)), rows[differs]))
    assert 0.1 < inside.mean() < 0.9
