import numpy as np
import pytest

from capture.fusion.joints import FADING, OLDEST, Sight, fuse, other_way_round
from capture.skeleton import JOINT_INDEX, OPPOSITE, SkeletonFrame

HAND = JOINT_INDEX["hand_left"]
SURE = np.ones(20, dtype=np.float32)


def sight(time, x=0.0, speed=0.0, confidence=1.0):
    positions, velocities = np.full((20, 3), float(x)), np.full((20, 3), float(speed))
    return Sight(time, positions, velocities, np.full(20, confidence, dtype=np.float32))


def test_equal_sights_give_their_mean_and_one_alone_is_itself():
    positions, confidence = fuse([sight(1.0, 0.0), sight(1.0, 0.2)], 1.0)
    np.testing.assert_allclose(positions, 0.1)
    assert (confidence == 1).all()
    np.testing.assert_array_equal(fuse([sight(1.0, 0.3)], 1.0)[0], 0.3)


def test_a_guess_has_a_sixteenth_of_the_weight():
    positions, confidence = fuse([sight(1.0, 0.0), sight(1.0, 1.7, confidence=0.5)], 1.0)
    np.testing.assert_allclose(positions, 0.1)
    assert (confidence == 1).all()


def test_age_takes_weight_and_motion_is_carried_on_to_the_moment():
    weight = np.exp(-0.03 / FADING)
    positions, _ = fuse([sight(1.0, 0.0), sight(0.97, 1.0)], 1.0)
    np.testing.assert_allclose(positions, weight / (1 + weight))
    positions, _ = fuse([sight(1.0, 0.5), sight(0.97, 0.44, speed=2.0), sight(1.02, 0.54, speed=2.0)], 1.0)
    np.testing.assert_allclose(positions, 0.5)


def test_what_is_lost_or_too_old_says_nothing():
    lost = sight(1.0, 0.4)
    lost.confidence[HAND] = 0
    lost.positions[HAND] = np.nan
    positions, confidence = fuse([lost, sight(1.0 - OLDEST - 0.01, 9.0)], 1.0)
    assert np.isnan(positions[HAND]).all()
    assert confidence[HAND] == 0
    np.testing.assert_array_equal(np.delete(positions, HAND, axis=0), 0.4)
    positions, confidence = fuse([lost, sight(1.0, 0.4, confidence=0.5)], 1.0)
    np.testing.assert_allclose(positions, 0.4)
    assert (confidence[HAND], confidence[0]) == (0.5, 1)


def test_velocities_are_of_joints_known_twice_within_a_short_time():
    before, after = SkeletonFrame(1.0, 1, np.zeros((20, 3)), SURE.copy()), SkeletonFrame(1.1, 1, np.ones((20, 3)), SURE)
    before.confidence[HAND] = 0
    velocities = Sight.after(Sight.after(None, before), after).velocities
    np.testing.assert_allclose(np.delete(velocities, HAND, axis=0), 10)
    assert (velocities[HAND] == 0).all()
    late = SkeletonFrame(1.0 + 2 * OLDEST, 1, np.ones((20, 3)), SURE)
    assert (Sight.after(Sight.after(None, before), late).velocities == 0).all()


@pytest.mark.parametrize("frame", [0, 100, 200])
def test_a_body_whose_sides_are_exchanged_is_told(walk, frame):
    body = walk.positions[frame]
    assert not other_way_round(body + 0.02, SURE, body, SURE)
    assert other_way_round(body[OPPOSITE] + 0.02, SURE, body, SURE)
    half = SURE.copy()
    half[np.arange(20) < OPPOSITE] = 0  # only one side is known, and it is where the other one is
    assert other_way_round(body[OPPOSITE], half, body, SURE)
    assert not other_way_round(body, SURE * 0, body, SURE)
