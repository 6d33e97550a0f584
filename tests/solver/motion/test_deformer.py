from itertools import pairwise

import igl
import numpy as np
import pytest
from scipy.linalg import solve as solve_dense
from scipy.spatial.transform import Rotation

from solver.model import fields, matrix_blocks, polar
from solver.model.binding import Binding
from solver.model.reduced_model import ModelParameters, build
from solver.motion.deformer import HANDLE_STIFFNESS, Deformer, to_file_units
from solver.surface.mesh import SolverMesh

MODES = ["clusters", "covariance"]
"""Modes that settle within a few frames; clusters that no bone holds take longer."""
LIMBS = np.array([[1.0, 0.5, 0], [-1, 0.5, 0], [0.3, -1, 0], [-0.3, -1, 0], [0, 1, 0]])
"""Directions in which the limb ends of a standing character lie."""


@pytest.fixture
def bound(creature, creature_model, creature_handles):
    """Bind the creature with other options, or other handles."""

    def make(handles=creature_handles, **options):
        return Deformer(creature_model, creature, handles, **options)

    return make


@pytest.fixture(scope="module", params=["armadillo.obj", "dinosaur_14k.obj"])
def real_character(request, real_mesh):
    """A mesh, its model and handles at the ends of its limbs."""
    mesh = real_mesh(request.param)
    return mesh, build(mesh), np.array([mesh.vertices[np.argmax(mesh.vertices @ direction)] for direction in LIMBS])


def pulled(deformer, seed=0, size=0.1):
    """Targets at random, `size` of the diagonal away on each axis."""
    rng = np.random.default_rng(seed)
    return deformer.handles + rng.normal(scale=size * deformer.model.diagonal, size=deformer.handles.shape)


def apply(controls, model, rest):
    """Blend float32 transforms the slow way: Σ_i w_i Σ_k φ_ik (linear · x + translation)."""
    isoline_coordinates = model.isoline_coordinates.astype(np.float64)
    hats = (
        np.maximum(0, 1 - np.abs(isoline_coordinates[:, :, None] - np.arange(model.isolines))) * model.weights[:, None]
    )
    blended = np.einsum("nm,mrc->nrc", hats.reshape(len(rest), -1), controls.astype(np.float64))
    return np.einsum("nrc,nc->nr", blended[:, :, :3], rest) + blended[:, :, 3]


def energy_matrices(model, mode):
    return (model.A_clusters, model.B_clusters) if mode == "clusters" else (model.A, model.B)


def stiffness_of(model, mode, rows):
    return HANDLE_STIFFNESS[mode] * np.trace(energy_matrices(model, mode)[0]) / np.sum(rows * rows)


class Plain:
    """The iteration of Eq. 9 as written: solve for R, and compute the rotations from the surface."""

    def __init__(self, model, mesh, handles, mode):
        self.model, self.mode = model, mode
        self.rows = model.rows(mesh, handles)
        self.A, self.B = energy_matrices(model, mode)
        self.stiffness = stiffness_of(model, mode, self.rows)
        self.pin = np.trace(self.A) / len(self.A)
        self.N = self.A + self.stiffness * self.rows.T @ self.rows + self.pin * model.null_space

    def start(self, deformer, targets):
        """Return the rigid fit of all handles, once for each rotation."""
        rest, now = deformer.handles - deformer.handles.mean(axis=0), targets - targets.mean(axis=0)
        return np.tile(Rotation.align_vectors(now, rest)[0].as_matrix().T, (self.B.shape[1] // 3, 1))

    def controls(self, turns, targets):
        model = self.model
        right = self.B @ turns + self.stiffness * self.rows.T @ model.to_model(targets)
        return solve_dense(self.N, right + self.pin * model.null_space @ model.rest_controls, assume_a="pos")

    def turns(self, R):
        reader = self.B.T if self.mode == "clusters" else self.model.covariance
        return polar.of_matrices((reader @ R).reshape(-1, 3, 3)).reshape(-1, 3)


def energy(model, mode, rows, R, turns, wanted):
    """‖M^(−1/2) (L X − δ)‖² + λ ‖ΦX − C‖² and the edge term of clusters, without terms that do not depend on R."""
    A, B = energy_matrices(model, mode)
    surface = np.sum(R * (A @ R)) - 2 * np.sum(R * (B @ turns))
    return surface + stiffness_of(model, mode, rows) * np.sum((rows @ R - wanted) ** 2)


# --- invariants


@pytest.mark.parametrize("mode", MODES)
def test_handles_at_rest_leave_every_vertex_where_it_is(bound, creature, creature_model, surface, mode):
    deformer = bound(mode=mode, iterations=10)
    found = surface(creature_model, creature, deformer.solve(deformer.handles))
    np.testing.assert_allclose(found, creature.vertices, rtol=0, atol=1e-6 * creature.diagonal)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("seed", "degrees"), [(0, 15), (1, 60), (2, 120), (3, 120), (4, 179)])
def test_rigid_motion_of_all_handles_is_rigid_motion_of_all_vertices(
    bound, creature, creature_model, surface, turn, mode, seed, degrees
):
    deformer = bound(mode=mode, iterations=20)
    rotation, offset = turn(seed, degrees), np.random.default_rng(seed).normal(size=3)
    found = surface(creature_model, creature, deformer.solve(deformer.handles @ rotation + offset))
    np.testing.assert_allclose(found, creature.vertices @ rotation + offset, rtol=0, atol=1e-3 * creature.diagonal)


def test_a_turn_of_120_degrees_frame_by_frame_ends_rigid(bound, creature, creature_model, surface, turn):
    """Frame by frame, so that only the first frame uses the rigid fit."""
    deformer = bound(mode="covariance")
    for degrees in range(4, 121, 4):
        R = deformer.solve(deformer.handles @ turn(5, degrees))
    for _ in range(5):
        R = deformer.solve(deformer.handles @ turn(5, 120))
    found = surface(creature_model, creature, R)
    np.testing.assert_allclose(found, creature.vertices @ turn(5, 120), rtol=0, atol=1e-3 * creature.diagonal)


@pytest.mark.parametrize("mode", MODES)
def test_a_deformation_turns_with_its_targets(bound, creature, creature_model, surface, turn, mode):
    deformer = bound(mode=mode, iterations=60)
    targets, offset = pulled(deformer), np.array([0.4, -1.0, 2.0])
    here = surface(creature_model, creature, deformer.solve(targets))
    for seed, degrees in ((6, 50), (7, 120)):
        deformer.reset()
        there = surface(creature_model, creature, deformer.solve(targets @ turn(seed, degrees) + offset))
        expected = here @ turn(seed, degrees) + offset
        np.testing.assert_allclose(there, expected, rtol=0, atol=1e-5 * creature.diagonal)


@pytest.mark.parametrize("mode", MODES)
def test_one_handle_carries_the_whole_character(creature, creature_model, surface, mode):
    deformer = Deformer(creature_model, creature, np.array([[1.0, 1.0, 0.2]]), mode=mode)
    offset = np.array([2.0, -3.0, 0.5])
    found = surface(creature_model, creature, deformer.solve(deformer.handles + offset))
    np.testing.assert_allclose(found, creature.vertices + offset, rtol=0, atol=1e-6 * creature.diagonal)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("seed", range(3))
def test_handles_are_met(bound, creature, creature_model, creature_handles, mode, seed):
    deformer = bound(mode=mode, iterations=20)
    targets = pulled(deformer, seed)
    reached = creature_model.rows(creature, creature_handles) @ deformer.solve(targets)
    assert np.linalg.norm(reached - creature_model.to_model(targets), axis=1).max() < 1e-3


def test_handles_stand_on_the_surface(bound, creature, creature_handles):
    deformer = bound()
    gaps, _, nearest = igl.point_mesh_squared_distance(creature_handles, creature.vertices, creature.faces)
    assert gaps.max() > 0
    np.testing.assert_allclose(deformer.handles, nearest, atol=1e-9)


def test_without_handles_and_bones_there_is_nothing_to_bind(creature, creature_model):
    with pytest.raises(ValueError, match="no handle and no bone"):
        Deformer(creature_model, creature, np.zeros((0, 3)))


@pytest.mark.parametrize("mode", MODES)
def test_a_mirrored_motion_of_a_symmetric_figure_is_the_mirror_image(figure, figure_model, surface, mode):
    mirror = np.array([-1.0, 1.0, 1.0])
    handles = figure.vertices[[np.argmax(figure.vertices @ direction) for direction in LIMBS]]
    handles[1], handles[3] = handles[0] * mirror, handles[2] * mirror
    handles[4, 0] = 0.0
    deformer = Deformer(figure_model, figure, handles, iterations=40, mode=mode)
    targets = deformer.handles.copy()
    targets[0] += [-0.2, 0.4, 0.2]
    left = surface(figure_model, figure, deformer.solve(targets))
    deformer.reset()
    right = surface(figure_model, figure, deformer.solve((targets * mirror)[[1, 0, 3, 2, 4]]))
    image = np.array([np.argmin(np.linalg.norm(figure.vertices - v, axis=1)) for v in figure.vertices * mirror])
    np.testing.assert_allclose(figure.vertices[image], figure.vertices * mirror, atol=1e-12)
    tolerance = 1e-5 if mode == "covariance" else 5e-3
    np.testing.assert_allclose(right, left[image] * mirror, rtol=0, atol=tolerance * figure.diagonal)


# --- the equations


def test_the_solution_is_that_of_the_dense_least_squares_problem(
    bound, creature, creature_model, creature_handles, surface, naive_interpolation
):
    """Eq. 8 in full: W by plain loops, rotations fixed at random, NumPy's lstsq."""
    model = creature_model
    rest = model.to_model(creature.vertices)
    L, mass = fields.laplacian(SolverMesh(rest, creature.faces, creature.of_render))
    L = L.toarray()
    W, W_delta = naive_interpolation(rest, model.isoline_coordinates, model.weights, 10, L @ rest)
    deformer = bound(iterations=0)
    targets = pulled(deformer)
    turns = Rotation.from_rotvec(0.4 * np.random.default_rng(1).normal(size=(80, 3))).as_matrix().reshape(-1, 3)
    deformer.solve(targets)
    deformer._turns[:] = matrix_blocks.pack_rows(turns, matrix_blocks.matrix_row_places(80))
    found = surface(model, creature, deformer.solve(targets))

    K = np.diag(mass**-0.5) @ L
    handle_rows = np.zeros((len(creature_handles), len(rest)))
    for row, point in zip(handle_rows, deformer.handles, strict=True):
        distances = []
        for face in creature.faces:  # the face that holds the point, by its barycentric coordinates
            corners = creature.vertices[face]
            blend = np.linalg.lstsq(np.vstack([corners.T, np.ones(3)]), [*point, 1.0], rcond=None)[0]
            outside = max(0.0, -blend.min()) + np.linalg.norm(blend @ corners - point)
            distances.append((outside, tuple(face), blend))
        _, face, blend = min(distances, key=lambda entry: entry[0])
        row[list(face)] = blend
    rows = handle_rows @ W
    root = np.sqrt(np.trace((K @ W).T @ (K @ W)) / np.sum(rows * rows))
    left = np.concatenate([K @ W, root * rows])
    right = np.concatenate([np.diag(mass**-0.5) @ W_delta @ turns, root * model.to_model(targets)])
    expected = W @ np.linalg.lstsq(left, right, rcond=1e-12)[0] * model.diagonal + model.center
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * creature.diagonal)


@pytest.mark.parametrize("mode", MODES)
def test_the_folded_iteration_is_the_plain_one(bound, creature, creature_model, creature_handles, mode):
    deformer = bound(mode=mode, iterations=3)
    plain = Plain(creature_model, creature, creature_handles, mode)
    turns = plain.start(deformer, pulled(deformer, seed=0))
    for frame in range(2):
        targets = pulled(deformer, seed=frame)
        for _ in range(3):
            turns = plain.turns(plain.controls(turns, targets))
        found, expected = deformer.solve(targets), plain.controls(turns, targets)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
        difference = found - expected
        in_vertices = np.sum(difference * (creature_model.gram @ difference)) / len(creature.vertices)
        assert abs(in_vertices) < 1e-18


@pytest.mark.parametrize("seed", range(3))
def test_no_iteration_of_clusters_raises_the_energy(bound, creature, creature_model, creature_handles, seed):
    """Both steps lower the same sum, so clusters converge for all targets."""
    deformer = bound(mode="clusters", iterations=1)
    targets = pulled(deformer, seed)
    rows, wanted = creature_model.rows(creature, creature_handles), creature_model.to_model(targets)
    energies = [
        energy(creature_model, "clusters", rows, deformer.solve(targets), deformer.turns, wanted) for _ in range(60)
    ]
    assert np.all(np.diff(energies) < 1e-9 * np.abs(energies[0]))
    moves = np.abs(np.diff(energies))
    assert moves[-1] < 1e-2 * moves[0]


@pytest.mark.parametrize("mode", MODES)
def test_controls_minimise_the_energy_for_their_rotations(bound, creature_model, creature, creature_handles, mode):
    deformer = bound(mode=mode)
    targets = pulled(deformer)
    R = deformer.solve(targets)
    rows, wanted = creature_model.rows(creature, creature_handles), creature_model.to_model(targets)
    least = energy(creature_model, mode, rows, R, deformer.turns, wanted)
    rng = np.random.default_rng(0)
    for size in (1e-4, 1e-2, 1.0):
        for _ in range(10):
            other = R + size * rng.normal(size=R.shape)
            assert energy(creature_model, mode, rows, other, deformer.turns, wanted) > least


def test_directions_that_move_no_vertex_stay_at_rest(bound, creature_model):
    deformer = bound()
    R = deformer.solve(pulled(deformer))
    assert np.abs(creature_model.null_space @ (R - creature_model.rest_controls)).max() < 1e-6


# --- from frame to frame


def test_repeating_a_target_converges_and_stays(bound, creature, creature_model, surface):
    deformer = bound(mode="covariance")
    targets = pulled(deformer)
    frames = [surface(creature_model, creature, deformer.solve(targets)) for _ in range(40)]
    moves = np.array([np.abs(b - a).max() for a, b in pairwise(frames)]) / creature.diagonal
    assert moves[-1] < 1e-9
    assert np.all(moves[1:15] < moves[:14])
    np.testing.assert_allclose(frames[5], frames[-1], rtol=0, atol=1e-3 * creature.diagonal)


def test_the_way_to_a_moderate_pose_does_not_matter(bound, creature, creature_model, surface):
    deformer = bound(iterations=60)
    targets = pulled(deformer, size=0.03)
    direct = surface(creature_model, creature, deformer.solve(targets))
    deformer.solve(pulled(deformer, seed=9, size=0.05))
    round_about = surface(creature_model, creature, deformer.solve(targets))
    np.testing.assert_allclose(round_about, direct, rtol=0, atol=1e-6 * creature.diagonal)


def test_reset_forgets_the_frames_before(bound):
    deformer = bound()
    targets = pulled(deformer)
    first = deformer.solve(targets)
    deformer.solve(pulled(deformer, seed=1))
    assert np.abs(deformer.solve(targets) - first).max() > 1e-6
    deformer.reset()
    np.testing.assert_array_equal(deformer.solve(targets), first)


def test_more_iterations_a_frame_come_closer_to_the_converged_pose(bound, creature, creature_model, surface):
    """One limb swings by 0.2 of the diagonal, once in 30 frames; the default of 4 stays within 0.1 %."""
    converged = bound(iterations=40)
    swing = 0.2 * creature.diagonal * np.sin(2 * np.pi * np.arange(20) / 30)[:, None] * [0.0, 0.6, 0.8]
    targets = np.tile(converged.handles, (20, 1, 1))
    targets[:, 1] += swing
    reference = [surface(creature_model, creature, converged.solve(frame)) for frame in targets]
    errors = []
    for iterations in (1, 2, 4, 8):
        deformer = bound(iterations=iterations)
        found = [surface(creature_model, creature, deformer.solve(frame)) for frame in targets]
        errors.append(np.linalg.norm(np.array(found) - reference, axis=2).max() / creature.diagonal)
    assert np.all(np.diff(errors) < 0)
    assert errors[0] < 1e-2
    assert errors[2] < 1e-3


# --- controls in the mesh file's coordinates


def test_step_gives_the_transforms_of_the_solution(bound, creature, creature_model, surface):
    deformer = bound()
    targets = pulled(deformer)
    controls = deformer.step(targets)
    assert (controls.shape, controls.dtype) == ((80, 3, 4), np.float32)
    deformer.reset()
    expected = surface(creature_model, creature, deformer.solve(targets))
    found = apply(controls, creature_model, creature.vertices)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * creature.diagonal)


def test_rest_controls_are_identities_in_file_units(creature_model):
    found = to_file_units(creature_model.rest_controls, creature_model)
    np.testing.assert_allclose(found, np.tile(np.eye(3, 4), (80, 1, 1)), atol=1e-6)


def test_conversion_of_a_stack_is_that_of_each(bound, creature_model):
    deformer = bound()
    R = np.stack([deformer.solve(pulled(deformer, seed)) for seed in range(3)])
    np.testing.assert_array_equal(to_file_units(R, creature_model), [to_file_units(one, creature_model) for one in R])


# --- handles that do not determine the pose


@pytest.mark.parametrize("mode", MODES)
def test_handles_on_one_point_or_one_line_leave_a_finite_sensible_start(creature, creature_model, surface, mode):
    line = np.array([[-1.5, 0.0, 0.0], [0.0, 0.2, 0.0], [1.1, 0.2, 0.0]])
    for handles in (np.tile(line[:1], (3, 1)), line):
        deformer = Deformer(creature_model, creature, handles, iterations=20, mode=mode)
        found = surface(creature_model, creature, deformer.solve(deformer.handles + np.array([0.5, 0.0, 0.0])))
        expected = creature.vertices + np.array([0.5, 0.0, 0.0])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * creature.diagonal)


def test_every_vertex_can_be_a_handle(creature, creature_model, surface):
    """More equations than unknowns: the factor stays positive definite."""
    deformer = Deformer(creature_model, creature, creature.vertices, iterations=10)
    found = surface(creature_model, creature, deformer.solve(creature.vertices + np.array([1.0, 0, 0])))
    np.testing.assert_allclose(found, creature.vertices + np.array([1.0, 0, 0]), rtol=0, atol=1e-6 * creature.diagonal)


def test_separate_parts_move_together(two_parts, surface):
    model = build(two_parts)
    hand = two_parts.vertices[np.argmax(two_parts.vertices[:-8, 0])]
    deformer = Deformer(model, two_parts, np.array([hand, [-1.5, 1.3, 0.0], [0.6, -1.6, 0.1]]), iterations=20)
    targets = deformer.handles + np.array([[0.0, 0.4, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    found = surface(model, two_parts, deformer.solve(targets))
    gap = np.linalg.norm(two_parts.vertices[-8:] - hand, axis=1)
    followed = np.linalg.norm(found[-8:] - targets[0], axis=1)
    np.testing.assert_allclose(followed, gap, atol=0.02 * two_parts.diagonal)


# --- real characters


@pytest.mark.slow
@pytest.mark.parametrize("mode", MODES)
def test_a_real_character_at_rest_turned_and_pulled(real_character, surface, turn, mode):
    mesh, model, handles = real_character
    deformer = Deformer(model, mesh, handles, iterations=20, mode=mode)
    found = surface(model, mesh, deformer.solve(deformer.handles))
    np.testing.assert_allclose(found, mesh.vertices, rtol=0, atol=1e-6 * mesh.diagonal)
    deformer.reset()
    offset = 2 * mesh.diagonal
    found = surface(model, mesh, deformer.solve(deformer.handles @ turn(8, 120) + offset))
    np.testing.assert_allclose(found, mesh.vertices @ turn(8, 120) + offset, rtol=0, atol=1e-3 * mesh.diagonal)
    targets = deformer.handles.copy()
    targets[:2, 1] += 0.066 * mesh.diagonal
    reached = model.rows(mesh, handles) @ deformer.solve(targets)
    assert np.linalg.norm(reached - model.to_model(targets), axis=1).max() < 1e-3


@pytest.mark.parametrize("count", [1, 2])
def test_handles_on_a_line_do_not_let_the_character_roll_away(bound, creature, creature_handles, count):
    """After many loops of the handles, the pose does not depend on the motion before."""
    handles = creature_handles[:count]
    looping, quiet = bound(handles), bound(handles, iterations=60)
    rest = looping.handles
    for angle in np.linspace(0, 8 * np.pi, 160):
        around = np.outer(np.cos(angle + np.arange(count)), [1, 0, 0]) + np.outer(
            np.sin(angle + np.arange(count)), [0, 1, 0]
        )
        looping.solve(rest + 0.1 * looping.model.diagonal * around)
    for _ in range(40):
        R = looping.solve(rest)
    assert np.linalg.norm(looping.model.rest_controls - R, axis=1).max() < 0.02
    assert np.linalg.norm(quiet.solve(rest) - quiet.model.rest_controls, axis=1).max() < 1e-6


def test_frames_after_the_first_allocate_no_array(bound, creature, creature_model, allocated):
    deformer, binding = bound(), Binding.of_solver_mesh(creature_model, creature)
    targets = pulled(deformer)
    R = deformer.solve(targets)
    controls = to_file_units(R, creature_model)
    positions = binding.vertices(controls)

    def frame():
        assert deformer.solve(targets, out=R) is R
        assert to_file_units(R, creature_model, controls) is controls
        assert binding.vertices(controls, positions) is positions

    assert allocated(frame) < min(R.nbytes, controls.nbytes, positions.nbytes)


@pytest.mark.parametrize(("count", "isolines"), [(3, 7), (1, 2), (5, 10)])
@pytest.mark.parametrize("mode", MODES)
def test_any_number_of_isolines_is_turned(creature, creature_handles, mode, count, isolines):
    """Also numbers that are not multiples of sixteen."""
    model = build(creature, ModelParameters(count, isolines))
    deformer = Deformer(model, creature, creature_handles, iterations=2, mode=mode)
    plain, targets = Plain(model, creature, creature_handles, mode), pulled(deformer)
    turns = plain.start(deformer, targets)
    for _ in range(2):
        turns = plain.turns(plain.controls(turns, targets))
    expected = plain.controls(turns, targets)
    np.testing.assert_allclose(deformer.solve(targets), expected, rtol=0, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(deformer.turns, turns, rtol=0, atol=1e-6)


def test_arrays_of_other_shapes_are_refused(bound, creature_model):
    deformer = bound()
    for targets in (deformer.handles[:-1], np.tile(deformer.handles, (20, 1)), deformer.handles[:, :2]):
        with pytest.raises(ValueError, match="targets"):
            deformer.solve(targets)
    with pytest.raises(ValueError, match="targets"):
        deformer.solve(deformer.handles, out=np.empty((400, 3)))
    with pytest.raises(ValueError, match="transforms"):
        to_file_units(creature_model.rest_controls, creature_model, np.empty((79, 3, 4), dtype=np.float32))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_target_that_is_no_number_is_refused_and_the_next_frame_is_as_if_it_had_not_come(bound, value):
    deformer, undisturbed = bound(), bound()
    first, bad, second = pulled(deformer, 1), pulled(deformer, 2), pulled(deformer, 3)
    bad[2, 1] = value
    deformer.solve(first)
    with pytest.raises(ValueError, match="finite"):
        deformer.solve(bad)
    undisturbed.solve(first)
    np.testing.assert_array_equal(deformer.solve(second), undisturbed.solve(second))


def test_targets_of_any_layout_give_the_same_frame(bound):
    targets = pulled(bound()).astype(np.float32)
    expected = bound().solve(targets.astype(np.float64))
    for given in (targets, np.asfortranarray(targets), np.repeat(targets, 2, axis=0)[::2], targets.tolist()):
        np.testing.assert_array_equal(bound().solve(np.asarray(given)), expected)


def test_a_copied_deformer_starts_at_rest_and_is_independent(bound):
    deformer = bound()
    deformer.solve(pulled(deformer, 1))
    other = deformer.another(iterations=4)
    np.testing.assert_array_equal(other.solve(pulled(deformer, 2)), bound().solve(pulled(deformer, 2)))
    twin = bound()
    twin.solve(pulled(deformer, 1))
    np.testing.assert_array_equal(deformer.solve(pulled(deformer, 3)), twin.solve(pulled(deformer, 3)))


@pytest.mark.parametrize("mode", MODES)
def test_a_deformer_that_resumes_a_state_continues_with_the_same_frames(bound, mode):
    deformer, other = bound(mode=mode), bound(mode=mode)
    deformer.solve(pulled(deformer, 1))
    state = deformer.state
    following = [deformer.solve(pulled(deformer, seed)) for seed in (2, 3)]
    other.solve(pulled(deformer, 4))
    other.resume(state)
    np.testing.assert_array_equal([other.solve(pulled(deformer, seed)) for seed in (2, 3)], following)
    other.resume(bound(mode=mode).state)
    np.testing.assert_array_equal(other.solve(pulled(deformer, 1)), bound(mode=mode).solve(pulled(deformer, 1)))
