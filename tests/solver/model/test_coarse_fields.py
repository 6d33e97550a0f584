"""Fields from a sample of the vertices, compared with exact ones."""

import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from solver.model import coarse_fields, fields, reduced_model
from solver.model.coarse_fields import CoarseFields
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh, weld

from ..shapes import needles

SAMPLES = 2500


@pytest.fixture(scope="module", autouse=True)
def small_sample():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coarse_fields, "MIN_SAMPLES", SAMPLES)
        yield


def both_operators(mesh):
    """Exact fields and sampled ones of a mesh in model units."""
    unit = SolverMesh(mesh.vertices / mesh.diagonal, mesh.faces, mesh.of_render)
    surface, mass = fields.laplacian(unit)
    tied = fields.field_operator(surface, contacts(unit), 1.0)
    return fields.SurfaceOperator(tied, mass, unit.vertices), CoarseFields(tied, tied, mass, unit), tied, mass


@pytest.fixture(scope="module")
def operators(fine):
    return both_operators(fine)


def isolines_apart(exact, sampled, mass, count=6):
    """Largest difference of isoline coordinates, each field with the sign of the exact one.

    The 7th and 8th eigenvalue of the figure are nearly equal, so that these fields mix."""
    one, other = exact.propagation_fields(count), sampled.propagation_fields(count)
    other *= np.sign(np.einsum("nk,nk,n->k", one, other, mass))
    return np.abs(fields.compute_isoline_coordinates(one, 10) - fields.compute_isoline_coordinates(other, 10)).max()


def test_isolines_are_those_of_exact_fields_and_fields_orthonormal_solutions_of_the_equation(operators):
    """The energy of the model depends on the second derivatives of fields, in which a rough error would show."""
    exact, sampled, tied, mass = operators
    assert isolines_apart(exact, sampled, mass) < 0.1
    found = np.column_stack([np.full(len(mass), mass.sum() ** -0.5), sampled.propagation_fields(8)])
    assert_allclose(found.T @ (mass[:, None] * found), np.eye(9), rtol=0, atol=1e-9)
    energy = -found.T @ (tied @ found)
    values = np.diag(energy)
    assert_allclose(energy, np.diag(values), rtol=0, atol=1e-7 * energy.max())
    residual = tied @ found + mass[:, None] * found * values
    assert (np.einsum("nk,n->k", residual**2, 1 / mass)[1:] < 2 * values[1:] ** 2).all()


def test_smoothing_is_that_of_all_vertices(fine, operators):
    exact, sampled, _, _ = operators
    values = np.column_stack([fine.vertices[:, 0] > 0.5, np.maximum(fine.vertices[:, 1], 0)]).astype(float)
    for length in (0.006, 0.024, 0.096):
        expected = exact.smoothed(values, length)
        assert np.abs(sampled.smoothed(values, length) - expected).max() < 0.03 * np.ptp(values, axis=0).max()


def test_parts_that_touch_are_between_the_same_isolines(two_parts):
    whole = weld(*igl.upsample(two_parts.vertices, two_parts.faces, 2))
    assert whole.parts == 2
    exact, sampled, _, mass = both_operators(whole)
    assert isolines_apart(exact, sampled, mass) < 0.25


def test_a_scan_with_needles_has_nearly_its_exact_fields(fine):
    some = np.random.default_rng(0).random(len(fine.faces)) < 0.03
    exact, sampled, _, mass = both_operators(weld(*needles(fine.vertices, fine.faces, some, 1e-6)))
    assert isolines_apart(exact, sampled, mass, 5) < 0.1


def test_a_scan_of_loose_pieces_has_exact_fields(fine):
    """Thousands of triangles a little above the surface: sampled fields are far from exact, and are not used."""
    some = np.random.default_rng(0).random(len(fine.faces)) < 0.03
    loose = fine.faces[some]
    vertices = np.concatenate([fine.vertices, 1.001 * fine.vertices[loose.ravel()]])
    faces = np.concatenate([fine.faces[~some], len(fine.vertices) + np.arange(loose.size).reshape(-1, 3)])
    exact, sampled, _, _ = both_operators(weld(vertices, faces))
    assert_array_equal(sampled.propagation_fields(8), exact.propagation_fields(8))
    step = (vertices[:1, :1] > 0) * np.ones((len(exact.areas), 1))
    assert_array_equal(sampled.smoothed(step, 0.01), exact.smoothed(step, 0.01))


def test_a_model_reproduces_the_rest_pose_and_rigid_motion(fine, monkeypatch):
    monkeypatch.setattr(reduced_model, "MAX_EXACT_VERTICES", 0)
    model = reduced_model.build(fine)
    rest = model.to_model(fine.vertices)
    turn = Rotation.from_rotvec([0.4, 1.2, -0.7]).as_matrix()
    R = model.rest_controls @ turn + np.tile([[0.0] * 3] * 3 + [[0.1, -0.2, 0.3]], (len(model.rest_controls) // 4, 1))
    W = model.position_matrix(fine.vertices)
    assert_allclose(W @ R, rest @ turn + [0.1, -0.2, 0.3], rtol=0, atol=1e-12)
    for A, B in ((model.A, model.B), (model.A_clusters, model.B_clusters)):
        force = A @ R - B @ np.tile(turn, (B.shape[1] // 3, 1))
        assert np.abs(force).max() < 1e-9 * np.abs(A).max()
