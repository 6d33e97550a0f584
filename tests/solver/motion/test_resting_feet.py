"""Which feet rest and where the floor is, as plain Python functions: feet that stand, step, jump and shake."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

FRAME = 1 / 30
STANDING = np.array([[0.1, 0.02, 0.0], [-0.1, 0.02, 0.0]])


def moved(left, right=(0.0, 0.0, 0.0)):
    """Return the feet of who stands, moved."""
    return STANDING + np.array([left, right])


@pytest.fixture(scope="module")
def module(interpreted):
    return interpreted("solver.motion.resting_feet")


@pytest.fixture
def watch(module):
    """Return a function from the positions of both feet in the next frame to those that rest and those that are low."""
    plan = SimpleNamespace(joints=np.array([0, 1]), metre=2.0)
    state = SimpleNamespace(
        last=np.full((2, 3), np.nan),
        velocity=np.full((2, 3), np.nan),
        noise=np.zeros(2),
        still=np.zeros(2),
        held=np.zeros(2),
        votes=np.zeros((2, module.VOTE_FRAMES)),
        clock=np.array([np.nan, np.nan, 0.0, 0.0, 0.0]),
    )
    frames = []

    def see(positions, confidence=(1.0, 1.0)):
        began = bool(frames)
        frames.append(positions)
        elapsed = FRAME if began else np.inf
        rests, low = module.resting_feet(plan, state, np.array(positions), np.array(confidence), elapsed, began)
        return rests.tolist(), low.tolist()

    see.state = state
    return see


@pytest.fixture
def stood(watch):
    """Return the same function, after the performer has stood for a second."""
    for _ in range(30):
        watch(STANDING)
    return watch


def test_feet_that_stand_rest_from_the_first_frame_on_and_define_the_floor(watch, module):
    for _ in range(20):
        assert watch(STANDING) == ([True, True], [True, True])
    assert watch.state.clock[module.FLOOR] == pytest.approx(0.02)
    assert watch.state.clock[module.LIFT] == 0.0


def test_a_foot_that_is_lifted_rests_no_more_and_the_other_does(stood):
    for frame in range(10):
        rests, low = stood(moved(left=[0.0, 0.03 * (frame + 1), 0.0]))
    assert (rests, low) == ([False, True], [False, True])


def test_a_foot_that_slides_faster_than_its_limit_does_not_rest_though_it_is_low(watch, module):
    speed = np.array([[2 * module.RELEASE_SPEED, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for frame in range(30):
        rests, low = watch(STANDING + frame * FRAME * speed)
    assert (rests, low) == ([False, True], [True, True])


def test_one_frame_out_of_three_is_outvoted(stood):
    assert stood(moved(left=[0.0, 0.3, 0.0]))[0] == [True, True]


def test_a_jump_lifts_the_character_by_its_height_over_the_floor_in_its_own_metres(stood, module):
    for frame in range(10):
        stood(moved(*2 * [[0.0, 0.04 * (frame + 1), 0.0]]))
    floor = stood.state.clock[module.FLOOR]
    rise = 0.42 - floor - module.MIN_JUMP_METRES
    assert stood.state.clock[module.LIFT] == pytest.approx(2.0 * rise**2 / (rise + module.SOFT_JUMP_METRES))
    # the floor drifts slowly while nobody stands on it
    assert 0.02 < floor < 0.02 + 0.4 * (1 - math.exp(-10 * FRAME / module.DRIFT_SECONDS))


def test_the_floor_follows_a_foot_that_rests_below_it_with_its_time_constant(stood, module):
    while stood(STANDING - [0.0, 0.1, 0.0]) and stood.state.still[0] == 0:
        before = stood.state.clock[module.FLOOR]
    after = -0.08 + (before + 0.08) * math.exp(-FRAME / module.FLOOR_SECONDS)
    assert stood.state.clock[module.FLOOR] == pytest.approx(after)


def test_a_foot_that_moves_below_the_floor_lowers_it_slowly(stood, module):
    stood(moved(left=[0.0, -0.1, 0.0]))
    after = -0.08 + 0.1 * math.exp(-FRAME / module.DRIFT_SECONDS)
    assert stood.state.clock[module.FLOOR] == pytest.approx(after)


def test_a_foot_that_the_sensor_guesses_stays_where_it_was_seen(stood):
    assert stood(moved(left=[5.0, 5.0, 5.0]), (0.5, 1.0)) == ([True, True], [True, True])
    np.testing.assert_array_equal(stood.state.last, STANDING)


def test_without_any_foot_nothing_rests_and_there_is_no_floor(watch, module):
    assert watch(np.full((2, 3), np.nan)) == ([False, False], [False, False])
    assert math.isnan(watch.state.clock[module.FLOOR])


def test_the_velocity_is_a_mean_with_its_time_constant(watch, module):
    watch(STANDING)
    watch(STANDING)
    watch(moved(left=[0.03, 0.0, 0.0]))
    expected = 0.03 / FRAME * (1 - math.exp(-FRAME / module.VELOCITY_SECONDS))
    np.testing.assert_allclose(watch.state.velocity, [[expected, 0, 0], [0, 0, 0]], atol=1e-12)
