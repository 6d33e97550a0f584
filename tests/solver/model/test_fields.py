import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import eigh
from scipy.sparse.csgraph import connected_components

from solver.model import fields, reduced_model
from solver.model.bones import NO_BONES
from solver.motion.deformer import Deformer
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh

from ..shapes import box, chains, joined, points, sphere


def modes_of(mesh, count=8):
    L, mass = fields.laplacian(mesh)
    operator = fields.field_operator(L, contacts(mesh), mesh.diagonal)
    return fields.SurfaceOperator(operator, mass, mesh.vertices).propagation_fields(count)


def aligned(modes, reference):
    """Modes with the signs of a reference."""
    return modes * np.sign((modes * reference).sum(axis=0))


def deformed(mesh, handles, targets, bones=NO_BONES, motions=None):
    model = reduced_model.build(mesh, bones=bones)
    R = Deformer(model, mesh, handles, iterations=20).solve(targets, motions)
    return (model.position_matrix(mesh.vertices) @ R) * model.diagonal + model.center


def motion(handles, size=0.3):
    return handles + np.random.default_rng(7).normal(scale=size, size=handles.shape)


# --- the operator


def test_operator_of_a_good_mesh_is_the_intrinsic_delaunay_one_of_libigl(creature):
    L, mass = fields.laplacian(creature)
    reference = igl.intrinsic_delaunay_cotmatrix(creature.vertices, creature.faces)[0]
    assert abs(L - reference).max() <= 1e-9 * abs(reference).max()
    assert mass.sum() == pytest.approx(igl.doublearea(creature.vertices, creature.faces).sum() / 2)


def test_a_fin_with_a_needle_at_its_root_leaves_the_operator_bounded(figure):
    """Three faces meet at an edge that cannot be flipped; one of them is degenerate."""
    a, b = figure.edges[100]
    middle = figure.vertices[[a, b]].mean(axis=0)
    for height in (1e-3, 1e-6, 1e-9):
        vertices = np.concatenate([figure.vertices, [middle * (1 + height)]])
        faces = np.concatenate([figure.faces, [[a, b, len(figure.vertices)]]])
        L, mass = fields.laplacian(SolverMesh(vertices, faces, np.arange(len(vertices))))
        assert np.abs(L.data).max() < 2e3
        assert mass.min() > 0


# --- ties


@pytest.fixture(scope="module")
def tied(two_parts):
    """The operators of a character of two parts: of the surface, of the fields, of the energy."""
    L, mass = fields.laplacian(two_parts)
    ties = contacts(two_parts)
    return (
        L,
        fields.field_operator(L, ties, two_parts.diagonal),
        fields.energy_operator(L, ties, mass, two_parts.diagonal),
    )


def test_operators_are_negative_semidefinite_and_ties_leave_one_constant_in_the_kernel(two_parts, tied):
    assert fields.laplacian(two_parts)[1].min() > 0
    for L, parts in zip(tied, (2, 1, 1), strict=True):
        spectrum = eigh(-L.toarray(), eigvals_only=True)
        assert np.abs(L.sum(axis=1)).max() < 1e-10 * np.abs(L.diagonal()).max()
        assert_allclose(L.toarray(), L.toarray().T, atol=1e-9)
        assert spectrum[0] > -1e-10 * spectrum[-1]
        assert np.count_nonzero(spectrum < 1e-10) == connected_components(L, directed=False)[0] == parts


def test_ties_add_the_weighted_squares_of_the_jumps(two_parts, tied):
    L, of_fields, of_energy = tied
    ties, mass = contacts(two_parts), fields.laplacian(two_parts)[1]
    f = np.random.default_rng(3).normal(size=len(two_parts.vertices))
    by_field = by_energy = 0.0
    for v, corners, blend, gap in zip(ties.vertices, ties.corners, ties.blend, ties.gap, strict=True):
        square = (f[v] - blend @ f[corners]) ** 2
        least = 0.005 * two_parts.diagonal
        by_field += 100.0 * (least / max(least, gap)) ** 2 * square
        by_energy += min(mass[v], blend @ mass[corners]) / max(least, gap) ** 2 * square
    assert f @ (L - of_fields) @ f == pytest.approx(by_field)
    assert f @ (L - of_energy) @ f == pytest.approx(by_energy)


# --- fields


def test_fields_are_the_lowest_eigenvectors_of_a_dense_solver(creature):
    L, mass = fields.laplacian(creature)
    _, vectors = eigh(-L.toarray(), np.diag(mass), subset_by_index=(0, 8))
    modes = modes_of(creature)
    assert_allclose(modes, aligned(vectors[:, 1:], modes), atol=1e-7 * np.abs(modes).max())


def test_fields_are_reproducible_and_positive_where_they_are_largest():
    v, f = sphere()  # threefold and fivefold eigenvalues, in which any basis would do
    mesh = SolverMesh(v, f, np.arange(len(v)))
    modes = modes_of(mesh)
    assert_array_equal(modes, modes_of(mesh))
    assert np.all(modes.max(axis=0) >= -modes.min(axis=0))


# --- isoline coordinates


def test_isoline_coordinates_of_a_linear_field_equal_values_by_hand():
    field = np.array([[0.0], [0.04], [0.05], [0.5], [0.72], [0.95], [1.0]])
    expected = [[0.0], [0.0], [0.0], [4.5], [6.7], [9.0], [9.0]]
    assert_allclose(fields.compute_isoline_coordinates(field, 10), expected, atol=1e-12)
    assert_allclose(fields.compute_isoline_coordinates(3 * field - 7, 10), expected, atol=1e-12)


# --- weights


def test_weights_are_those_of_equations_2_and_3(creature):
    _, mass = fields.laplacian(creature)
    modes = modes_of(creature)
    w = [np.linalg.norm(sum(creature.vertices[v] * mass[v] * mode[v] for v in range(len(mass)))) for mode in modes.T]
    assert_allclose(fields.field_weights(creature.vertices, mass, modes), w / np.sum(w), rtol=1e-9)


# --- invariance of the deformation


def test_scale_place_and_order_of_the_vertices_do_not_show_in_the_deformation(creature, creature_handles, turn):
    """Of a character with a part beside it and one that touches it, by bones and handles."""
    beside, touching = box("1.2 0.9 0.1, 1.5 1.2 0.4"), box("-1.1 0.9 -0.5, -0.9 1.2 -0.3", 0.1)
    vertices, faces = joined((creature.vertices, creature.faces), beside, touching)
    order, place = np.random.default_rng(3).permutation(len(vertices)), np.array([-3.0, 6.0, -1.5])
    trunk, leg = points("-1.2 0 0, 0 0.2 0, 0.9 0.9 0.2"), points("0.05 -0.2 0.07, 0.2 -1.1 0.3")
    targets, turns = motion(creature_handles), np.stack([turn(bone, 20) for bone in range(3)])
    found = []
    for scale, way, arranged in ((1.0, 0 * place, np.arange(len(order))), (0.01, place, order)):
        mesh = SolverMesh(scale * vertices[arranged] + way, np.argsort(arranged)[faces], np.arange(len(order)))
        bones = chains((-1, scale * trunk + way), (0, scale * leg + way))
        offsets = bones.heads - np.einsum("bi,bij->bj", bones.heads, turns)
        motions = np.concatenate([turns, offsets[:, None]], axis=1)
        moved = deformed(mesh, scale * creature_handles + way, scale * targets + way, bones, motions)
        found.append((moved[np.argsort(arranged)] - way) / scale)
    assert_allclose(found[1], found[0], rtol=0, atol=1e-5 * creature.diagonal)
