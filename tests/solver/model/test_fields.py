import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import eigh
from scipy.sparse.csgraph import connected_components

from solver.model import fields, reduced_model
from solver.motion.deformer import Deformer
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh


def modes_of(mesh, count=8):
    L, mass = fields.laplacian(mesh)
    operator = fields.field_operator(L, contacts(mesh), mesh.diagonal)
    return fields.SurfaceOperator(operator, mass, mesh.vertices).propagation_fields(count)


def aligned(modes, reference):
    """Modes with the signs of a reference."""
    return modes * np.sign((modes * reference).sum(axis=0))


def deformed(mesh, handles, targets):
    model = reduced_model.build(mesh)
    R = Deformer(model, mesh, handles, iterations=20).solve(targets)
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


def test_a_character_of_one_part_has_the_surface_operator_itself(creature):
    L, mass = fields.laplacian(creature)
    ties = contacts(creature)
    assert fields.field_operator(L, ties, creature.diagonal) is L
    assert fields.energy_operator(L, ties, mass, creature.diagonal) is L


# --- fields


def test_fields_are_the_lowest_eigenvectors_of_a_dense_solver(creature):
    L, mass = fields.laplacian(creature)
    _, vectors = eigh(-L.toarray(), np.diag(mass), subset_by_index=(0, 8))
    modes = modes_of(creature)
    assert_allclose(modes, aligned(vectors[:, 1:], modes), atol=1e-7 * np.abs(modes).max())


def test_fields_are_orthonormal_in_the_mass_inner_product_and_to_the_constant(two_parts):
    _, mass = fields.laplacian(two_parts)
    modes = modes_of(two_parts)
    assert_allclose(modes.T @ (mass[:, None] * modes), np.eye(8), atol=1e-9)
    assert_allclose(mass @ modes, 0.0, atol=1e-9)


def test_fields_are_reproducible_and_positive_where_they_are_largest():
    v, f = igl.icosahedron()  # a sphere: threefold and fivefold eigenvalues, in which any basis would do
    for _ in range(2):
        v, f = igl.upsample(v, f)
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    sphere = SolverMesh(v, f, np.arange(len(v)))
    modes = modes_of(sphere)
    assert_array_equal(modes, modes_of(sphere))
    assert np.all(modes.max(axis=0) >= -modes.min(axis=0))


# --- isoline coordinates


def test_isoline_coordinates_of_a_linear_field_equal_values_by_hand():
    field = np.array([[0.0], [0.04], [0.05], [0.5], [0.72], [0.95], [1.0]])
    expected = [[0.0], [0.0], [0.0], [4.5], [6.7], [9.0], [9.0]]
    assert_allclose(fields.compute_isoline_coordinates(field, 10), expected, atol=1e-12)
    assert_allclose(fields.compute_isoline_coordinates(3 * field - 7, 10), expected, atol=1e-12)


def test_interpolation_is_the_hat_function_of_the_two_isolines_around(creature):
    isoline_coordinates = fields.compute_isoline_coordinates(modes_of(creature), 10)
    phi = fields.interpolation(isoline_coordinates, 10).toarray()
    hats = np.maximum(0, 1 - np.abs(isoline_coordinates[:, :, None] - np.arange(10))).reshape(
        len(isoline_coordinates), -1
    )
    assert_allclose(phi, hats, atol=1e-12)


# --- weights


def test_weights_are_those_of_equations_2_and_3(creature):
    _, mass = fields.laplacian(creature)
    modes = modes_of(creature)
    w = [np.linalg.norm(sum(creature.vertices[v] * mass[v] * mode[v] for v in range(len(mass)))) for mode in modes.T]
    assert_allclose(fields.field_weights(creature.vertices, mass, modes), w / np.sum(w), rtol=1e-9)


# --- invariance of the deformation


def test_scale_and_place_of_the_mesh_do_not_show_in_the_deformation(creature, creature_handles):
    def moved(points):
        return 0.01 * points + np.array([-3.0, 6.0, -1.5])

    expected = deformed(creature, creature_handles, motion(creature_handles))
    there = SolverMesh(moved(creature.vertices), creature.faces, creature.of_render)
    found = deformed(there, moved(creature_handles), moved(motion(creature_handles)))
    assert_allclose(found, moved(expected), rtol=0, atol=1e-5 * there.diagonal)


def test_needles_hardly_change_what_the_mesh_does(figure):
    """Split triangles at a point just off the middle of an edge: three for one, of which one is a needle."""
    vertices, faces = list(figure.vertices), []
    for number, (a, b, c) in enumerate(figure.faces):
        if number % 50:
            faces.append((a, b, c))
            continue
        middle = (figure.vertices[a] + figure.vertices[b]) / 2
        vertices.append(middle + 1e-5 * (figure.vertices[c] - middle))
        tip = len(vertices) - 1
        faces += [(a, b, tip), (b, c, tip), (c, a, tip)]
    needles = SolverMesh(np.array(vertices), np.array(faces), np.arange(len(vertices)))
    handles = figure.vertices[[0, len(figure.vertices) // 2, len(figure.vertices) - 1]]
    targets = handles + np.array([[0.05, 0, 0], [0, 0, 0], [0, 0.05, 0]]) * figure.diagonal
    there = deformed(needles, handles, targets)[: len(figure.vertices)]
    assert np.linalg.norm(there - deformed(figure, handles, targets), axis=1).max() < 0.01
