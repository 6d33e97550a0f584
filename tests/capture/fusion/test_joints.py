import numpy as np
import pytest

from capture.fusion.joints import DECAY_SECONDS, MAX_AGE_SECONDS, Observation, fuse, is_swapped
from capture.skeleton import JOINT_INDEX, OPPOSITE, SkeletonFrame

HAND = JOINT_INDEX["hand_left"]
SURE = np.ones(20, dtype=np.float32)


def observation(time, x=0.0, speed=0.0, confidence=1.0):
    positions, velocities = np.full((20, 3), float(x)), np.full((20, 3), float(speed))
    return Observation(time, positions, velocities, np.full(20, confidence, dtype=np.float32))


def test_equal_observations_are_averaged_and_a_single_one_is_unchanged():
    positions, confidence = fuse([observation(1.0, 0.0), observation(1.0, 0.08)], 1.0)
    np.testing.assert_allclose(positions, 0.04)
    assert (confidence == 1).all()
    np.testing.assert_array_equal(fuse([observation(1.0, 0.3)], 1.0)[0], 0.3)


def test_an_inferred_joint_has_a_sixteenth_of_the_weight():
    positions, confidence = fuse([observation(1.0, 0.0), observation(1.0, 1.7, confidence=0.5)], 1.0)
    np.testing.assert_allclose(positions, 0.1)
    assert (confidence == 1).all()


def test_age_reduces_weight_and_motion_is_extrapolated():
    weight = np.exp(-0.03 / DECAY_SECONDS)
    positions, _ = fuse([observation(1.0, 0.0), observation(0.97, 0.08)], 1.0)
    np.testing.assert_allclose(positions, 0.08 * weight / (1 + weight))
    positions, _ = fuse(
        [observation(1.0, 0.5), observation(0.97, 0.44, speed=2.0), observation(1.02, 0.54, speed=2.0)], 1.0
    )
    np.testing.assert_allclose(positions, 0.5)


def test_lost_joints_and_old_observations_do_not_count():
    lost = observation(1.0, 0.4)
    lost.confidence[HAND] = 0
    lost.positions[HAND] = np.nan
    positions, confidence = fuse([lost, observation(1.0 - MAX_AGE_SECONDS - 0.01, 9.0)], 1.0)
    assert np.isnan(positions[HAND]).all()
    assert confidence[HAND] == 0
    np.testing.assert_array_equal(np.delete(positions, HAND, axis=0), 0.4)
    positions, confidence = fuse([lost, observation(1.0, 0.4, confidence=0.5)], 1.0)
    np.testing.assert_allclose(positions, 0.4)
    assert (confidence[HAND], confidence[0]) == (0.5, 1)


def test_velocities_are_of_joints_known_twice_within_a_short_time():
    before, after = (
        SkeletonFrame(1.0, 1, np.zeros((20, 3)), SURE.copy()),
        SkeletonFrame(1.1, 1, np.full((20, 3), 0.5), SURE),
    )
    before.confidence[HAND] = 0
    velocities = Observation.after(Observation.after(None, before), after).velocities
    np.testing.assert_allclose(np.delete(velocities, HAND, axis=0), 5)
    assert (velocities[HAND] == 0).all()
    late = SkeletonFrame(1.0 + 2 * MAX_AGE_SECONDS, 1, np.ones((20, 3)), SURE)
    assert (Observation.after(Observation.after(None, before), late).velocities == 0).all()


def test_motion_above_the_maximum_speed_is_not_extrapolated():
    positions = np.zeros((20, 3))
    positions[HAND, 0], positions[0, 0] = 0.34, 0.32  # in a thirtieth of a second: 10.2 and 9.6 m/s
    before = Observation.after(None, SkeletonFrame(1.0, 1, np.zeros((20, 3)), SURE))
    velocities = Observation.after(before, SkeletonFrame(1 + 1 / 30, 1, positions, SURE)).velocities
    np.testing.assert_allclose(velocities[:, 0], np.where(np.arange(20) == 0, 9.6, 0))


def with_hand(x, confidence=1.0):
    """Return a performer at the origin whose left hand is at x."""
    seen = observation(1.0)
    seen.positions[HAND, 0], seen.confidence[HAND] = x, confidence
    return seen


def fused_hand(*observations, before=None):
    positions, confidence = fuse(observations, 1.0, None if before is None else with_hand(before).positions)
    np.testing.assert_array_equal(np.delete(positions, HAND, axis=0), 0)
    assert (np.delete(confidence, HAND) == 1).all()
    np.testing.assert_allclose(positions[HAND, 1:], 0, atol=1e-15)
    return positions[HAND, 0], confidence[HAND]


@pytest.mark.parametrize("wrong", [0, 1, 2])
def test_of_three_positions_the_one_far_from_the_others_does_not_count(wrong):
    hands = [with_hand(x) for x in np.insert([0.0, 0.02], wrong, 0.42)]
    assert fused_hand(*hands) == pytest.approx((0.01, 1))
    assert fused_hand(*hands, before=0.42) == pytest.approx((0.01, 1))  # the two others agree


@pytest.mark.parametrize(("before", "found"), [(0.05, 0.0), (0.35, 0.4)])
def test_of_two_positions_the_one_near_the_previous_position_counts(before, found):
    assert fused_hand(with_hand(0.0), with_hand(0.4), before=before) == pytest.approx((found, 1))
    assert fused_hand(with_hand(0.4), with_hand(0.0), before=before) == pytest.approx((found, 1))


def test_a_tracked_joint_prevails_over_an_inferred_one_at_the_previous_position():
    sure, guess = with_hand(0.0), with_hand(0.34, confidence=0.5)
    assert fused_hand(sure, guess, before=0.34) == pytest.approx((0.02, 1))
    assert fused_hand(with_hand(0.0, 0.5), guess, before=0.34) == pytest.approx(
        (0.17, 0.5)
    )  # all inferred positions count


def test_up_to_fifteen_centimetres_they_are_of_one_mind():
    assert fused_hand(with_hand(0.0), with_hand(0.149), before=0.0) == pytest.approx((0.0745, 1))
    assert fused_hand(with_hand(0.0), with_hand(0.151), before=0.0) == pytest.approx((0, 1))


def test_a_sensor_that_has_lost_a_joint_does_not_count():
    lost = with_hand(np.nan, confidence=0.0)
    assert fused_hand(lost, with_hand(0.4), before=0.0) == pytest.approx((0.4, 1))
    assert fused_hand(lost, with_hand(0.4), with_hand(0.5)) == pytest.approx((0.45, 1))


@pytest.mark.parametrize("frame", [0, 100, 200])
def test_swapped_sides_are_detected(walk, frame):
    body = walk.positions[frame]
    assert not is_swapped(body + 0.02, SURE, body, SURE)
    assert is_swapped(body[OPPOSITE] + 0.02, SURE, body, SURE)
    half = SURE.copy()
    half[np.arange(20) < OPPOSITE] = 0  # only one side is known, and it is where the other one is
    assert is_swapped(body[OPPOSITE], half, body, SURE)
    assert not is_swapped(body, SURE * 0, body, SURE)
