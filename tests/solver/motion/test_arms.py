import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from solver.motion.arms import Arm, Arms
from solver.motion.limb_motion import LimbMotion

from ..shapes import assert_joined, moved
from .test_limb_motion import AT, SIDES, TICK, TRACKED, body, character, with_arms

BODY = body(0.5, 0.18, 0.1, 0.28, 0.26, 0.08, [1, 0, 0])
WIDE = body(0.5, 0.25, 0.1, 0.2, 0.2, 0.1, [1, 0, 0])  # short arms, far apart
METRE = 0.4 / 0.54
BONES = LimbMotion(character(WIDE), SIDES, BODY).bones
HANDS = AT["hand_left"], AT["hand_right"]
ARMS = [3, 4, 5], [9, 10, 11]
"""Bones after those of trunk and head, and of the left leg."""


def performer(left):
    """A performer whose arms have directions (3, 3), the right one those of the mirror image."""
    return with_arms(BODY, left, np.multiply(left, [-1, 1, 1]))


def clapping(inwards):
    """Upper arms point forwards and down, forearms inwards by a given amount."""
    return performer([[0, -0.5, 1], [-inwards, 0, 1], [-inwards, 0, 1]])


def play(poses, free=False, **settings):
    """Return the motions (T, b, 4, 3), and where the tips of both hands go (T, 2, 3)."""
    motion = LimbMotion(character(WIDE), SIDES, BODY)
    arms = Arms(BONES, *(Arm(*bones, hand) for bones, hand in zip(ARMS, HANDS, strict=True)), 0.54, **settings)
    found = []
    for k, pose in enumerate(poses):
        motions = motion.step(k * TICK, pose, TRACKED)
        if not free:
            arms.step(k * TICK, pose, TRACKED, motions)
        found.append(motions)
    tips = [moved(BONES.tails, T)[[bones[-1] for bones in ARMS]] for T in found]
    return np.array(found), np.array(tips)


def test_hands_meet_where_the_performers_meet_and_arms_keep_their_lengths_and_stay_joined():
    together = clapping(0.6)
    gap = together[HANDS[0]] - together[HANDS[1]]
    assert np.linalg.norm(gap) < 0.15 * 0.54
    apart = play([together], free=True)[1][0]
    assert np.linalg.norm(apart[0] - apart[1]) > 0.15
    motions, tips = (each[0] for each in play([together]))
    assert_allclose(tips[0] - tips[1], METRE * gap, atol=0.02)
    assert_allclose(motions[:, :3] @ motions[:, :3].transpose(0, 2, 1), np.tile(np.eye(3), (15, 1, 1)), atol=1e-12)
    assert_joined(BONES, motions)


def test_hands_that_do_not_come_together_or_need_not_are_left_alone():
    for pose, meet in ((clapping(0.0), True), (BODY, True), (clapping(0.6), False)):
        assert_array_equal(play([pose], meet=meet)[0], play([pose], free=True)[0])


def test_arms_never_jump_while_hands_meet_and_are_lost():
    way = np.concatenate([np.linspace(0, 0.7, 40), np.full(10, 0.7), np.linspace(0.7, 0, 40)])
    poses = np.array([clapping(x) for x in way])
    free, drawn = play(poses, free=True)[1], play(poses)[1]
    assert np.abs(np.diff(drawn, axis=0)).max() < 5 * np.abs(np.diff(free, axis=0)).max()
    assert np.linalg.norm(drawn[45, 0] - drawn[45, 1]) < 0.1


@pytest.mark.parametrize("angle", [0.0, 0.3, -0.2])
def test_arms_that_hang_are_held_away_from_the_body_and_level_ones_are_not(angle):
    hanging = performer([[0, -1, 0]] * 3)
    motions = play([hanging], space=angle, meet=False)[0][0]
    along = np.einsum("bij,bi->bj", motions[:, :3], BONES.tails - BONES.heads)[[*ARMS[0], *ARMS[1]]]
    expected = [[sign * np.sin(angle), -np.cos(angle), 0] for sign in (1, 1, 1, -1, -1, -1)]
    assert_allclose(along / np.linalg.norm(along, axis=1)[:, None], expected, atol=1e-9)
    assert_allclose(play([BODY], space=angle, meet=False)[0], play([BODY], free=True)[0], atol=1e-12)


def test_the_space_of_the_arms_turns_with_the_body():
    hanging = with_arms(BODY, [[0.1, -1, 0.2]] * 3, [[-0.3, -1, 0.1]] * 3)
    turn = Rotation.from_rotvec([0.2, 1.1, 0]).as_matrix()
    here = play([hanging], space=0.4, meet=False)[0][0]
    there = play([hanging @ turn.T], space=0.4, meet=False)[0][0]
    assert_allclose(there[:, :3], here[:, :3] @ turn.T, atol=1e-9)
