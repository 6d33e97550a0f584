"""Swings and rolls of a bone, as plain Python functions: turns that are computed by hand."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

NO_TURN = (1.0, 0.0, 0.0, 0.0)
X, Y, Z = map(tuple, np.eye(3))
SWING, SIDES, HINGE = "SWING", "SIDES", "HINGE"


@pytest.fixture(scope="module")
def module(interpreted):
    return interpreted("solver.motion.limb_turns")


@pytest.fixture(scope="module")
def quat(module):
    return module.quat


@pytest.fixture(scope="module")
def kinds(interpreted):
    plan = interpreted("solver.motion.limb_plan")
    return {name: getattr(plan, name) for name in (SWING, SIDES, HINGE)}


@pytest.fixture
def plan(kinds):
    """A bone along x at rest, whose roll is read from its side y."""
    return SimpleNamespace(roll=[kinds[SWING]], sides=np.array([Y]), foot=[False])


@pytest.fixture
def state():
    return SimpleNamespace(
        local=np.array([NO_TURN]),
        gap=np.zeros((1, 3)),
        roll_gap=np.zeros(1),
        roll_known=np.zeros(1),
        known=np.ones(1),
        mount=np.full((1, 4), np.nan),
    )


def angle_between(a, b):
    return math.acos(np.clip(np.dot(a, b), -1, 1))


def test_a_bone_swings_to_the_wanted_direction_at_once_or_as_fast_as_it_may(module, quat, state):
    turned = module._swing(state, 0, NO_TURN, X, Y, 0.0, 1.0, True)
    assert quat.rotated(turned, X) == pytest.approx(Y)
    assert quat.rotated(turned, Z) == pytest.approx(Z)  # it is the least rotation
    turned = module._swing(state, 0, NO_TURN, X, Y, 0.0, 0.01, True)
    assert angle_between(quat.rotated(turned, X), X) == pytest.approx(module.MAX_TURN_RATE * 0.01)


def test_a_bone_that_is_found_again_starts_from_where_it_was_held(module, quat, state):
    state.known[0] = 0
    turned = module._swing(state, 0, NO_TURN, X, Y, 0.0, 1.0, True)
    assert quat.rotated(turned, X) == pytest.approx(X)
    assert state.gap[0] == pytest.approx((0.0, 0.0, -math.pi / 2))
    state.known[0] = 1
    turned = module._swing(state, 0, turned, X, Y, 0.5, 1.0, True)  # half of the gap remains
    assert quat.rotated(turned, X) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5), 0.0))


def test_a_foot_turns_no_farther_than_its_limit_and_follows_with_its_time_constant(module):
    held = module._eased_foot(X, X, Y, 1e9)
    assert angle_between(held, X) == pytest.approx(module.MAX_FOOT_RADIANS)
    assert held[2] == pytest.approx(0.0)
    near = (math.cos(0.5), math.sin(0.5), 0.0)
    followed = module._eased_foot(X, X, near, module.FOOT_SECONDS)
    assert angle_between(followed, X) == pytest.approx(0.5 * (1 - math.exp(-1)))
    assert module._eased_foot(X, X, near, 0.0) == pytest.approx(X)  # at first it is at rest


def rolled(module, plan, state, elapsed, across=(0.0, 0.0, 0.0), began=True, local=NO_TURN, directions=(X, X)):
    return module._rolled(
        plan, state, 0, local, NO_TURN, np.array([X]), np.array(directions), np.array([across]), 0.0, elapsed, began
    )


def test_a_roll_goes_to_the_sides_of_the_body_at_most_as_fast_as_it_may(module, quat, plan, state, kinds):
    plan.roll = [kinds[SIDES]]
    state.roll_known[0] = 1
    assert quat.rotated(rolled(module, plan, state, 1.0, across=Z), Y) == pytest.approx(Z)
    turned = rolled(module, plan, state, 0.01, across=Z)
    assert angle_between(quat.rotated(turned, Y), Y) == pytest.approx(module.MAX_TURN_RATE * 0.01)
    assert quat.rotated(turned, X) == pytest.approx(X)
    assert rolled(module, plan, state, 1.0, across=X) == pytest.approx(NO_TURN)  # sides along the bone say nothing
    assert state.roll_known[0] == 0


def test_a_roll_returns_to_that_of_the_least_rotation_at_its_rate(module, quat, plan, state):
    before = quat.about(X, 0.4)
    turned = rolled(module, plan, state, 0.02, local=before)
    assert quat.to_vector(turned) == pytest.approx((0.4 * math.exp(-module.SWING_RATE * 0.02), 0.0, 0.0))
    assert quat.to_vector(rolled(module, plan, state, 1.0, local=before, began=False)) == pytest.approx((0, 0, 0))


def test_a_bent_limb_rolls_about_its_hinge_and_a_straight_one_hardly(module, plan, state, kinds):
    plan.roll = [kinds[HINGE]]
    bent = rolled(module, plan, state, 0.1, directions=(X, tuple(np.negative(Y))))  # the hinge is −z, a quarter away
    angle = math.atan2(bent[1], bent[0]) * 2
    assert -math.pi / 2 < angle < -0.5
    assert rolled(module, plan, state, 0.1) == pytest.approx(NO_TURN)


def test_a_roll_follows_the_performers_bone_as_long_as_that_points_as_the_bone_does(module, quat, plan, state):
    state.mount[0] = NO_TURN

    def follow(turned):
        return module._rolled_as_performer(plan, state, 0, NO_TURN, NO_TURN, X, np.array([turned]), 0.03)

    kept = math.exp(-module.ORIENTATION_RATE * 0.03)
    assert quat.to_vector(follow(quat.about(X, 0.5))) == pytest.approx((0.5 * (1 - kept), 0.0, 0.0))
    away = quat.product(quat.about(Z, math.radians(61)), quat.about(X, 0.5))  # beyond the first limit, 60°
    assert follow(away) == pytest.approx(NO_TURN)


def test_a_bone_follows_a_direction_relative_to_its_base_and_keeps_its_turn_while_that_is_unknown(
    module, quat, plan, state
):
    base = quat.about(Z, -math.pi / 2)  # it turns y to x: what is up for the performer is along the bone
    before, none = quat.about(Z, 0.7), np.zeros((1, 3))
    state.local[0] = before
    for direction, expected, known in ((none, before, 0), (np.array([Y]), NO_TURN, 1)):
        turned = module.turn_bone(
            plan, state, 0, base, np.array([X]), direction, none, np.full((1, 4), np.nan), 1.0, False
        )
        assert turned == pytest.approx(expected)
        assert state.known[0] == known
