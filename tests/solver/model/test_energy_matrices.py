"""Products of tall sparse matrices against SciPy's."""

import numpy as np
import pytest
from scipy.sparse import csr_matrix, diags

from solver.model import energy_matrices, fields
from solver.surface.mesh import SolverMesh


@pytest.fixture(scope="module")
def operator(creature, creature_model):
    unit = SolverMesh(creature_model.to_model(creature.vertices), creature.faces, creature.of_render)
    return *fields.laplacian(unit), unit.vertices


def tall(rest, isoline_coordinates, weights, isolines):
    """φ with the weights in it, and W."""
    phi = fields.interpolation(isoline_coordinates, isolines) @ diags(np.repeat(weights, isolines))
    homogeneous = np.column_stack([rest, np.ones(len(rest))])
    blocks = [diags(values) @ phi for values in homogeneous.T]
    order = np.arange(4 * phi.shape[1]).reshape(4, -1).T.ravel()
    return csr_matrix(phi), csr_matrix(np.hstack([block.toarray() for block in blocks])[:, order])


@pytest.mark.parametrize("chunk", [1, 37, 384, 10**6])
@pytest.mark.parametrize(("count", "isolines"), [(8, 10), (1, 2), (3, 4)])
def test_products_are_those_of_the_sparse_matrices(operator, monkeypatch, chunk, count, isolines):
    monkeypatch.setattr(energy_matrices, "MAX_CHUNK_ROWS", chunk)
    L, mass, rest = operator
    rng = np.random.default_rng(count)
    isoline_coordinates = np.clip((rest @ rng.normal(size=(3, count)) + 0.5) * (isolines - 1), 0, isolines - 1)
    weights = rng.uniform(0.5, 1.5, count)
    cluster = rng.integers(0, 7, len(rest)).astype(np.int32)
    chain = csr_matrix(diags([np.full(len(rest) - 1, 0.5)], [1]))
    tied = csr_matrix(L + chain + chain.T - diags(np.asarray((chain + chain.T).sum(axis=1)).ravel()))
    found = energy_matrices.products(tied, L, mass, rest, isoline_coordinates, weights, isolines, cluster)
    phi, W = tall(rest, isoline_coordinates, weights, isolines)
    KW = diags(mass**-0.5) @ tied @ W
    delta = tied @ rest
    W_delta = np.stack([(diags(mass**-0.5 * d) @ phi).toarray() for d in delta.T], axis=2).reshape(len(rest), -1)
    of_cluster = np.eye(7)[cluster]
    each = np.einsum("v,vc,vx->vcx", mass**-0.5, of_cluster, delta).reshape(len(rest), -1)
    expected = ((KW.T @ KW).toarray(), KW.T @ W_delta, (W.T @ W).toarray(), -(W.T @ L @ W).toarray(), KW.T @ each)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-11 * np.abs(other).max())  # L cancels
