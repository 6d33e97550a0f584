import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.model import polar, rotations
from solver.model.reduced_model import build, position_matrix
from solver.motion.deformer import Deformer
from solver.surface.mesh import SolverMesh


@pytest.fixture(scope="module")
def unit(creature, creature_model):
    """The creature in model units."""
    return SolverMesh(creature_model.to_model(creature.vertices), creature.faces, creature.of_render)


@pytest.fixture(scope="module")
def blend(unit, creature_model):
    isoline_coordinates = creature_model.isoline_coordinates.astype(np.float64)
    return position_matrix(unit.vertices, isoline_coordinates, creature_model.weights, creature_model.isolines)


@pytest.fixture(scope="module")
def strips(unit, creature_model):
    return rotations.crossed_triangles(creature_model.isoline_coordinates.astype(np.float64), unit.faces, 10)


@pytest.fixture(scope="module")
def any_controls(blend):
    return np.random.default_rng(0).normal(size=(blend.shape[1], 3))


# --- strips


def test_an_isoline_crosses_the_triangles_that_have_corners_on_both_sides(unit, strips, creature_model):
    isoline_coordinates = creature_model.isoline_coordinates.astype(np.float64)
    assert len(strips) == 80
    for number in (0, 9, 14, 37, 73):
        t = isoline_coordinates[:, number // 10]
        level = number % 10
        naive = []
        for index, face in enumerate(unit.faces):
            below = any(t[v] <= level for v in face)
            above = any(t[v] >= level for v in face)
            flat = len({float(t[v]) for v in face}) == 1
            if below and above and not flat:
                naive.append(index)
        assert strips[number].tolist() == naive
        assert naive


def test_an_isoline_in_the_gap_between_two_parts_gets_the_nearest_triangles():
    isoline_coordinates = np.array([[0.0], [0.1], [0.2], [0.3], [2.7], [2.8], [2.9], [3.0]])
    faces = np.array([[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7]])
    strips = rotations.crossed_triangles(isoline_coordinates, faces, 4)
    # Middles at 0.1, 0.2, 2.8, 2.9: every triangle is among the ten nearest of so few.
    assert [strip.tolist() for strip in strips] == [[0], [0, 1, 2, 3], [0, 1, 2, 3], [3]]
    many = np.repeat(faces, 8, axis=0)
    strips = rotations.crossed_triangles(isoline_coordinates, many, 4)
    assert set(range(8, 16)) < set(strips[1].tolist()) < set(range(16))
    assert set(range(16, 24)) < set(strips[2].tolist()) < set(range(16, 32))
    assert [len(strip) for strip in strips[1:3]] == [rotations.TRIANGLES_PER_ISOLINE] * 2


# --- linear maps


def test_covariance_map_is_the_plain_sum_over_strips_triangles_and_edges(
    unit, strips, blend, any_controls, creature_model
):
    isoline_coordinates = creature_model.isoline_coordinates.astype(np.float64)
    X = blend @ any_controls
    S = (rotations.covariance_map(unit, strips, isoline_coordinates, creature_model.weights) @ any_controls).reshape(
        -1, 3, 3
    )
    for number in range(0, 80, 7):
        naive = np.zeros((3, 3))
        for triangle in strips[number]:
            face = unit.faces[triangle]
            rest, now = unit.vertices[face], X[face]
            area = np.linalg.norm(np.cross(rest[1] - rest[0], rest[2] - rest[0])) / 2
            for i, j in ((0, 1), (1, 2), (2, 0)):
                naive += area * np.outer(rest[j] - rest[i], now[j] - now[i])
        np.testing.assert_allclose(S[number], naive, atol=1e-12 * np.abs(naive).max())


def test_edge_map_gives_the_first_two_edges_of_each_sampled_triangle(unit, strips, blend, any_controls):
    sampled = rotations.sample_strips(unit, strips)
    edges = rotations.edge_map(blend[unit.faces[sampled].ravel()]) @ any_controls
    X = blend @ any_controls
    naive = [X[unit.faces[t][k]] - X[unit.faces[t][0]] for strip in sampled for t in strip for k in (1, 2)]
    np.testing.assert_allclose(edges, naive, atol=1e-10)


# --- sampling


def test_samples_come_from_their_strip_and_differ_while_it_has_enough(unit, strips):
    sampled = rotations.sample_strips(unit, strips)
    for row, strip in zip(sampled, strips, strict=True):
        assert set(row) <= set(strip)
        assert len(set(row)) == min(len(strip), rotations.TRIANGLES_PER_ISOLINE)


def test_samples_go_round_the_whole_isoline():
    """On a ring of 40 triangles the ten samples are 36° apart, so none of the gaps is more than twice that."""
    angles = np.linspace(0, 2 * np.pi, 41)[:-1]
    ring = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(40)])
    vertices = np.repeat(ring, 3, axis=0) + np.tile([[0.0, 0, 0], [0.01, 0, 0], [0, 0, 0.01]], (40, 1))
    mesh = SolverMesh(vertices, np.arange(120).reshape(-1, 3), np.arange(120))
    shuffled = np.random.default_rng(0).permutation(40)
    places = np.sort(rotations.sample_strips(mesh, [shuffled])[0])
    gaps = np.diff([*places, places[0] + 40])
    assert gaps.max() <= 8
    assert gaps.min() >= 2


def test_samples_of_a_row_are_its_ends_then_its_middle():
    vertices = np.repeat(np.arange(11.0)[:, None] * [1, 0, 0], 3, axis=0)
    vertices += np.tile([[0.0, 0, 0], [0, 0.3, 0], [0, 0, 0.3]], (11, 1))
    mesh = SolverMesh(vertices, np.arange(33).reshape(-1, 3), np.arange(33))
    assert rotations.sample_strips(mesh, [np.arange(11)])[0][:3].tolist() == [0, 10, 5]


# --- rotations


def test_polar_rotation_is_the_best_alignment_of_vectors():
    rng = np.random.default_rng(1)
    for _ in range(20):
        rest, now = rng.normal(size=(2, 30, 3))
        found = polar.of_matrices((rest.T @ now).reshape(-1, 3, 3))[0]
        expected = Rotation.align_vectors(now, rest)[0].as_matrix().T
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_polar_rotation_is_proper_for_reflections_flat_and_empty_covariances():
    rng = np.random.default_rng(2)
    blocks = [np.diag([3.0, 2, -1]), -np.eye(3), np.diag([1.0, 1, 0]), np.diag([1.0, 0, 0]), np.zeros((3, 3))]
    blocks += list(rng.normal(size=(50, 3, 3)))
    found = polar.of_matrices((np.concatenate(blocks)).reshape(-1, 3, 3))
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), np.tile(np.eye(3), (len(found), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=1e-12)
    np.testing.assert_allclose(found[0], np.eye(3), atol=1e-12)  # keeps the strong axes, gives up the weakest
    others = Rotation.random(2000, random_state=3).as_matrix()
    for block, best in zip(blocks, found, strict=True):
        assert np.einsum("ij,ij->", block, best) >= np.einsum("ij,nij->n", block, others).max() - 1e-12


def test_the_frame_of_a_triangle_equals_values_by_hand():
    edges = np.tile([[0.0, 2, 0], [0.0, 5, 3]], (rotations.TRIANGLES_PER_ISOLINE, 1))
    frames = rotations.triangle_frames(edges)
    assert frames.shape == (1, rotations.TRIANGLES_PER_ISOLINE, 3, 3)
    np.testing.assert_allclose(frames[0, 0], [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("degrees", [0, 10, 90, 120, 179])
def test_both_readings_of_a_turned_surface_give_the_turn(creature_model, turn, degrees):
    turned = turn(4, degrees)
    R = creature_model.rest_controls @ turned
    rest_frames = rotations.triangle_frames(creature_model.edges @ creature_model.rest_controls)
    expected = np.tile(turned, (80, 1, 1))
    np.testing.assert_allclose(
        polar.of_matrices((creature_model.covariance @ R).reshape(-1, 3, 3)), expected, atol=1e-9
    )
    np.testing.assert_allclose(rotations.from_edges(creature_model.edges @ R, rest_frames), expected, atol=1e-9)


def test_average_of_frames_forgets_opposite_turns():
    edges = np.random.default_rng(5).normal(size=(2 * rotations.TRIANGLES_PER_ISOLINE, 3))
    rest_frames = rotations.triangle_frames(edges)
    half = rotations.TRIANGLES_PER_ISOLINE
    there, back = (Rotation.from_rotvec([0, 0, angle]).as_matrix() for angle in (0.4, -0.4))
    mixed = np.concatenate([edges[:half] @ there, edges[half:] @ back])
    np.testing.assert_allclose(rotations.from_edges(mixed, rest_frames)[0], np.eye(3), atol=1e-9)


# --- the two modes against each other


def largest_difference(surface, mesh, model, handles, targets):
    by_mode = [
        surface(model, mesh, Deformer(model, mesh, handles, iterations=60, mode=mode).solve(targets))
        for mode in ("covariance", "triangles")
    ]
    return np.linalg.norm(by_mode[0] - by_mode[1], axis=1).max() / mesh.diagonal


@pytest.mark.parametrize("limb", range(4))
def test_modes_agree_for_moderate_motion(surface, creature, creature_model, creature_handles, limb):
    targets = creature_handles.copy()
    targets[limb] += 0.1 * creature.diagonal * np.array([0.0, 0.6, 0.8])
    assert largest_difference(surface, creature, creature_model, creature_handles, targets) < 0.005


@pytest.mark.slow
def test_modes_agree_for_an_arm_of_the_armadillo(surface, real_mesh):
    mesh = real_mesh("armadillo.obj")
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    handles = np.array(
        [
            mesh.vertices[np.argmax(mesh.vertices @ d)]
            for d in np.array([[1.0, 0.5, 0], [-1, 0.5, 0], [0.3, -1, 0], [-0.3, -1, 0], [0, 1, 0]])
        ]
    )
    targets = handles + [[0.0, 0.1 * np.linalg.norm(high - low), 0.0]] * np.array([[1], [0], [0], [0], [0]])
    assert largest_difference(surface, mesh, build(mesh), handles, targets) < 0.005
