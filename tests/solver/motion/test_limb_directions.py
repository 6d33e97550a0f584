"""What is measured of a performer's joints, as plain Python functions: bodies whose directions are computed by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

LEFT_HIP, RIGHT_HIP, LEFT_SHOULDER, RIGHT_SHOULDER, HAND = range(5)
STANDING = np.array([[0.1, 1.0, 0.0], [-0.1, 1.0, 0.0], [0.2, 1.5, 0.0], [-0.2, 1.5, 0.0], [0.7, 1.5, 0.0]])
"""A body that faces +z, with its left at +x; hips, shoulders and a hand."""

TRACKED = np.ones(5)
PAIRS = np.array([[LEFT_HIP, RIGHT_HIP], [LEFT_SHOULDER, RIGHT_SHOULDER]])


@pytest.fixture(scope="module")
def module(interpreted):
    return interpreted("solver.motion.limb_directions")


@pytest.fixture
def plan():
    """The torso and an arm from the left shoulder to the hand."""
    return SimpleNamespace(
        joints=np.array([[LEFT_SHOULDER, -1], [HAND, -1]]),
        ends=np.array([[0, 0], [0, 1]]),
        roll=np.array([1, 0]),
        hips=np.array([0.5, 0.0]),
        pitch=np.zeros(2),
        trunk=np.zeros(0, dtype=int),
        trunk_rows=np.zeros(0, dtype=int),
        pairs=PAIRS,
        opposite=np.array([RIGHT_HIP, LEFT_HIP, RIGHT_SHOULDER, LEFT_SHOULDER, HAND]),
        oriented=np.array([-1, HAND]),
        turns=True,
    )


@pytest.fixture
def state():
    return SimpleNamespace(
        clock=np.array([-np.inf, -np.inf, 0.0, 0.0, 0.0]), side=np.zeros(3), known=np.ones(2), roll_known=np.ones(2)
    )


def test_a_smooth_step_goes_from_0_to_1_between_its_limits_and_is_steepest_in_the_middle(module):
    values = [module.smooth_step(value, (2.0, 4.0)) for value in (-1.0, 2.0, 2.5, 3.0, 3.5, 4.0, 9.0)]
    assert values == [0.0, 0.0, 0.15625, 0.5, 0.84375, 1.0, 1.0]


def test_hips_and_shoulders_point_from_right_to_left_unless_they_are_too_narrow_or_unknown(module):
    left, unknown = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    narrow = STANDING * [0.29, 1.0, 1.0]  # 0.116 and 0.232 of the trunk's length
    lost = np.where((np.arange(5) == RIGHT_HIP)[:, None], np.nan, STANDING)
    for body, expected in ((STANDING, (left, left)), (narrow, (unknown, unknown)), (lost, (unknown, left))):
        assert module._hips_and_shoulders(PAIRS, body) == expected


def test_directions_are_those_of_the_joints_and_zero_where_a_joint_is_lost(module, plan, state):
    def observed(body, confidence=TRACKED):
        return module.observed(plan, state, 0.0, body, confidence, np.full((5, 4), np.nan))

    directions, weight, sides, turns = observed(STANDING)
    assert_allclose(directions, [[0, 1, 0], [1, 0, 0]])
    assert weight == 1.0
    assert_allclose(sides, [[1, 0, 0], [0, 0, 0]])  # the arm's roll follows no sides
    assert np.isnan(turns).all()
    assert_allclose(observed(STANDING, TRACKED * (np.arange(5) != HAND))[0], [[0, 1, 0], [0, 0, 0]])
    leaning = STANDING.copy()
    leaning[LEFT_SHOULDER] += [0.2, 0.0, 0.4]
    assert_allclose(observed(leaning)[0], [np.array([0.1, 0.5, 0.2]) / math.sqrt(0.3), [0.6, 0, -0.8]])


def test_left_and_right_that_a_sensor_exchanges_in_an_instant_are_exchanged_back_for_a_while(module, plan, state):
    for frame in range(30):
        module._tracked_joints(plan, state, frame / 30, STANDING, TRACKED)
    exchanged = STANDING[plan.opposite]
    seen = module._tracked_joints(plan, state, 1.0, exchanged, TRACKED)
    assert_array_equal(seen, STANDING)
    assert state.clock[module.EXCHANGED] == 1
    for frame in range(1, 46):  # up to `EXCHANGED_SECONDS`
        seen = module._tracked_joints(plan, state, 1.0 + frame / 30, exchanged, TRACKED)
        assert_array_equal(seen, STANDING)
    seen = module._tracked_joints(plan, state, 1.0 + module.EXCHANGED_SECONDS + 0.1, exchanged, TRACKED)
    assert_array_equal(seen, exchanged)
    assert not state.known.any()  # all bones ease to it


@pytest.mark.parametrize(
    ("direction", "degrees", "expected"),
    [
        ((0.6, 0.0, 0.8), 30.0, (0.6 * math.cos(math.pi / 6), 0.5, 0.8 * math.cos(math.pi / 6))),
        ((0.0, 0.8, 0.6), 80.0, (0.0, 1.0, 0.0)),  # not over the vertical
        ((0.0, -0.8, 0.6), -80.0, (0.0, -1.0, 0.0)),
        ((0.0, 1.0, 0.0), 20.0, (0.0, 1.0, 0.0)),  # it has no heading
    ],
)
def test_a_direction_is_raised_within_its_own_heading(module, direction, degrees, expected):
    assert module._raised(direction, math.radians(degrees)) == pytest.approx(expected, abs=1e-12)


def test_hips_opposite_to_the_shoulders_do_not_count(module, plan):
    body = STANDING.copy()
    body[[LEFT_HIP, RIGHT_HIP]] = body[[RIGHT_HIP, LEFT_HIP]]
    assert_allclose(module._sides(plan, body, 2)[0], [1, 0, 0])


def test_an_orientation_is_used_as_it_is_or_without_the_heading_and_not_while_sides_are_exchanged(module, plan, state):
    orientations = np.full((5, 4), np.nan)
    quarter = np.array([math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0])  # about the upright axis
    orientations[HAND] = 2 * quarter
    result = module._orientations(plan, state, orientations, 2)
    assert np.isnan(result[0]).all()
    assert_allclose(result[1], quarter)
    plan.turns, state.clock[module.HEADING] = False, math.pi / 2
    assert_allclose(module._orientations(plan, state, orientations, 2)[1], [1, 0, 0, 0], atol=1e-12)
    state.clock[module.EXCHANGED] = 1
    assert np.isnan(module._orientations(plan, state, orientations, 2)).all()
