import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from solver.model import matrix_blocks
from solver.motion import twist

COUNT = 21


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def taken_back(turns, start, line):
    packed = matrix_blocks.pack_rows(turns.reshape(-1, 3), matrix_blocks.matrix_row_places(COUNT))
    twist.remove_roll(packed, COUNT, start, line)
    return matrix_blocks.unpack_rows(packed, matrix_blocks.matrix_row_places(COUNT)).reshape(-1, 3, 3)


@pytest.mark.parametrize("angle", [0.0, 0.3, 2.0, np.pi - 1e-3, np.pi])
def test_a_rigid_motion_is_found(rng, angle):
    points = rng.normal(size=(6, 3))
    turn = Rotation.from_rotvec(angle * np.array([2, -1, 2]) / 3).as_matrix().T
    assert_allclose(twist.rigid_fit(points, points @ turn + [1, 2, 3]), turn, atol=1e-7)


def test_points_on_a_line_turn_as_little_as_they_can():
    points = np.outer(np.linspace(-1, 1, 4), [1.0, 0, 0])
    found = twist.rigid_fit(points, np.outer(np.linspace(-1, 1, 4), [0.0, 1, 0]))
    assert_allclose(found, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-6)


@pytest.mark.parametrize("angle", [0.4, -1.0, 2.9, np.pi])
def test_a_roll_about_the_line_is_taken_back(rng, angle):
    line = rng.normal(size=3)
    line /= np.linalg.norm(line)
    start = Rotation.random(random_state=1).as_matrix()
    rolled = start @ Rotation.from_rotvec(angle * line).as_matrix().T
    assert_allclose(taken_back(np.tile(rolled, (COUNT, 1, 1)), start, line)[3], start, atol=1e-12)


def test_a_turn_across_the_line_stays():
    turned = Rotation.from_rotvec([0, 0.7, 0]).as_matrix()
    found = taken_back(np.tile(turned, (COUNT, 1, 1)), np.eye(3), np.array([1.0, 0, 0]))
    assert_allclose(found, np.tile(turned, (COUNT, 1, 1)), atol=1e-12)


def test_with_one_handle_the_whole_mean_turn_is_taken_back_and_what_isolines_differ_by_stays(rng):
    small = Rotation.from_rotvec(0.2 * rng.normal(size=(COUNT, 3))).as_matrix()
    turns = small @ Rotation.from_rotvec([0.5, 1.0, -0.3]).as_matrix()
    found = taken_back(turns, np.eye(3), np.zeros(3))
    U, _, Vt = np.linalg.svd(found.sum(axis=0))
    assert_allclose(U @ Vt, np.eye(3), atol=1e-12)
    apart = found[:, None] @ found.transpose(0, 2, 1)[None]
    assert_allclose(apart, turns[:, None] @ turns.transpose(0, 2, 1)[None], atol=1e-12)


@pytest.mark.parametrize("count", [1, 2, 7])
def test_points_at_one_place_do_not_turn(rng, count):
    """Their means differ by rounding errors, which have no direction."""
    for _ in range(50):
        rest, now = rng.normal(size=3), rng.normal(size=3)
        found = twist.rigid_fit(np.tile(rest, (count, 1)), np.tile(now, (count, 1)))
        assert_allclose(found, np.eye(3), atol=1e-6)
