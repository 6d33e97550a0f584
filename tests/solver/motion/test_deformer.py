import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import solve as solve_dense
from scipy.spatial.transform import Rotation

from solver.model import polar
from solver.model.binding import Binding
from solver.model.reduced_model import ModelParameters, build
from solver.motion.deformer import HANDLE_STIFFNESS, Deformer, to_file_units

MODES = ["clusters", "covariance"]
"""Modes that settle within a few frames; clusters that no bone holds take longer."""


@pytest.fixture
def bound(creature, creature_model, creature_handles):
    """Bind the creature with other options, or other handles."""

    def make(handles=creature_handles, **options):
        return Deformer(creature_model, creature, handles, **options)

    return make


def pulled(deformer, seed=0, size=0.1):
    """Targets at random, `size` of the diagonal away on each axis."""
    rng = np.random.default_rng(seed)
    return deformer.handles + rng.normal(scale=size * deformer.model.diagonal, size=deformer.handles.shape)


class Plain:
    """The iteration of Eq. 9 as written: solve for R, and compute the rotations from the surface."""

    def __init__(self, model, mesh, handles, mode):
        self.model, self.mode = model, mode
        self.rows = model.rows(mesh, handles)
        self.A, self.B = (model.A_clusters, model.B_clusters) if mode == "clusters" else (model.A, model.B)
        self.stiffness = HANDLE_STIFFNESS[mode] * np.trace(self.A) / np.sum(self.rows**2)
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


# --- invariants


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("seed", "degrees"), [(2, 120), (4, 179)])
def test_rigid_motion_of_all_handles_is_rigid_motion_of_all_vertices(
    bound, creature, creature_model, surface, turn, mode, seed, degrees
):
    deformer = bound(mode=mode, iterations=20)
    rotation, offset = turn(seed, degrees), np.random.default_rng(seed).normal(size=3)
    found = surface(creature_model, creature, deformer.solve(deformer.handles @ rotation + offset))
    assert_allclose(found, creature.vertices @ rotation + offset, rtol=0, atol=1e-3 * creature.diagonal)


# --- the equations


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("count", "isolines"), [(8, 10), (3, 7), (1, 2)])
def test_the_folded_iteration_is_the_plain_one(creature, creature_model, creature_handles, mode, count, isolines):
    """For any number of isolines, also those that are no multiples of sixteen."""
    model = creature_model if (count, isolines) == (8, 10) else build(creature, ModelParameters(count, isolines))
    deformer = Deformer(model, creature, creature_handles, iterations=3, mode=mode)
    plain = Plain(model, creature, creature_handles, mode)
    turns = plain.start(deformer, pulled(deformer, seed=0))
    for frame in range(2):
        targets = pulled(deformer, seed=frame)
        for _ in range(3):
            turns = plain.turns(plain.controls(turns, targets))
        found, expected = deformer.solve(targets), plain.controls(turns, targets)
        assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())
        assert_allclose(deformer.turns, turns, rtol=0, atol=1e-6)
        difference = found - expected
        assert abs(np.sum(difference * (model.gram @ difference))) / len(creature.vertices) < 1e-18


# --- controls in the mesh file's coordinates


@pytest.mark.parametrize("mode", MODES)
def test_step_gives_the_transforms_of_the_solution_which_meets_the_handles(bound, creature, creature_model, mode):
    deformer = bound(mode=mode, iterations=20)
    targets = pulled(deformer)
    controls = deformer.step(targets)
    assert (controls.shape, controls.dtype) == ((80, 3, 4), np.float32)
    deformer.reset()
    R = deformer.solve(targets)
    assert_array_equal(controls, to_file_units(R, creature_model))
    reached = creature_model.rows(creature, deformer.handles) @ R
    assert np.linalg.norm(reached - creature_model.to_model(targets), axis=1).max() < 1e-3


# --- handles that do not determine the pose


@pytest.mark.parametrize("mode", MODES)
def test_handles_on_one_point_or_one_line_leave_a_finite_sensible_start(creature, creature_model, surface, mode):
    line = np.array([[-1.5, 0.0, 0.0], [0.0, 0.2, 0.0], [1.1, 0.2, 0.0]])
    for handles in (line[:1], np.tile(line[:1], (3, 1)), line, creature.vertices):
        deformer = Deformer(creature_model, creature, handles, iterations=20, mode=mode)
        found = surface(creature_model, creature, deformer.solve(deformer.handles + np.array([0.5, 0.0, 0.0])))
        expected = creature.vertices + np.array([0.5, 0.0, 0.0])
        assert_allclose(found, expected, rtol=0, atol=1e-6 * creature.diagonal)


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


def test_targets_of_other_shapes_or_without_numbers_are_refused_and_the_next_frame_is_as_if_they_had_not_come(bound):
    deformer, undisturbed = bound(), bound()
    first, bad, second = (pulled(deformer, seed) for seed in range(3))
    assert_array_equal(deformer.solve(first), undisturbed.solve(first))
    for targets in (first[:-1], np.tile(first, (20, 1)), first[:, :2], *(bad + value for value in (np.nan, np.inf))):
        with pytest.raises(ValueError, match="expected"):
            deformer.solve(targets)
    with pytest.raises(ValueError, match="expected"):
        deformer.solve(first, out=np.empty((400, 3)))
    with pytest.raises(ValueError, match="expected"):
        to_file_units(deformer.model.rest_controls, deformer.model, np.empty((79, 3, 4), dtype=np.float32))
    with pytest.raises(ValueError, match="expected"):
        bound(first[:0])
    assert_array_equal(deformer.solve(second), undisturbed.solve(second))


def test_targets_of_any_layout_give_the_same_frame(bound):
    targets = pulled(bound()).astype(np.float32)
    expected = bound().solve(targets.astype(np.float64))
    for given in (targets, np.asfortranarray(targets), np.repeat(targets, 2, axis=0)[::2], targets.tolist()):
        assert_array_equal(bound().solve(np.asarray(given)), expected)


@pytest.mark.parametrize("mode", MODES)
def test_a_deformer_resumes_a_state_and_a_copy_of_it_starts_at_rest(bound, mode):
    deformer, other = bound(mode=mode), bound(mode=mode)
    first = deformer.solve(pulled(deformer, 1))
    state, copied = deformer.state, deformer.another(iterations=deformer.iterations)
    following = [deformer.solve(pulled(deformer, seed)) for seed in (2, 3)]
    other.solve(pulled(deformer, 4))
    other.resume(state)
    assert_array_equal([other.solve(pulled(deformer, seed)) for seed in (2, 3)], following)
    other.resume(bound(mode=mode).state)
    for at_rest in (other, copied):
        assert_array_equal(at_rest.solve(pulled(deformer, 1)), first)
