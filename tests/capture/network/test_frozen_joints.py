import numpy as np

from capture.network.frozen_joints import FROZEN_SECONDS, FrozenJoints
from capture.skeleton import JOINT_INDEX, LOST

SEEN = np.ones(20, np.float32)
HAND, HEAD = JOINT_INDEX["hand_left"], JOINT_INDEX["head"]


def test_a_joint_that_no_longer_moves_while_others_do_is_lost_and_comes_back(rng):
    positions = rng.normal(size=(60, 20, 3))
    positions[10:40, HAND] = positions[9, HAND]
    confidence = np.tile(SEEN, (60, 1))
    confidence[20:30, HEAD] = LOST
    expected = confidence.copy()
    expected[[number for number in range(40) if number >= 9 + 30 * FROZEN_SECONDS], HAND] = LOST
    frozen = FrozenJoints()
    found = [frozen.lost(pose, number / 30) for number, pose in enumerate(zip(positions, confidence, strict=True))]
    np.testing.assert_array_equal(found, expected)


def test_a_performer_who_does_not_move_at_all_is_not_lost(rng):
    still = rng.normal(size=(20, 3)), SEEN
    frozen = FrozenJoints()
    assert all((frozen.lost(still, number / 30) == SEEN).all() for number in range(60))
