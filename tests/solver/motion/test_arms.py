import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from solver.motion.arms import Arm, Arms
from solver.motion.limb_motion import LimbMotion
from solver.motion.limbs import Limb, Performer

TICK = 1 / 30
HIPS, SHOULDERS, LEFT, RIGHT = [0, 1], [2, 3], [2, 4, 6, 8], [3, 5, 7, 9]  # shoulder, elbow, wrist and hand
SIDES = Performer((0, 1), (2, 3), np.array([1, 0, 3, 2, 5, 4, 7, 6, 9, 8]))
SEEN = np.ones(10, dtype=np.float32)


def body(shoulders, upper, lower, hand, left, right):
    """A body (10, 3) whose arms have the given directions (3, 3)."""
    out = np.zeros((10, 3))
    out[0], out[1] = [0.1, 0, 0], [-0.1, 0, 0]
    out[2], out[3] = [shoulders, 0.5, 0], [-shoulders, 0.5, 0]
    for chain, along in ((LEFT, left), (RIGHT, right)):
        along = np.array(along, dtype=np.float64)
        along /= np.linalg.norm(along, axis=1)[:, None]
        out[chain[1:]] = out[chain[0]] + np.cumsum(np.array([upper, lower, hand])[:, None] * along, axis=0)
    return out


def performer(left, right):
    return body(0.18, 0.28, 0.26, 0.08, left, right)


def clapping(inwards):
    """Upper arms point forwards and down, forearms inwards by a given amount."""
    return performer(
        [[0, -0.5, 1], [-inwards, 0, 1], [-inwards, 0, 1]], [[0, -0.5, 1], [inwards, 0, 1], [inwards, 0, 1]]
    )


LEVEL = [[1, 0, 0]] * 3, [[-1, 0, 0]] * 3
WIDE = body(0.25, 0.2, 0.2, 0.1, *LEVEL)  # short arms, far apart
METRE = 0.4 / 0.54


def character(basis=None, trunk=True, **settings):
    points = WIDE if basis is None else WIDE @ basis
    chest = [Limb("trunk", points[[0, 2]] * np.array([0, 1, 1]) if basis is None else points[[0, 2]], ((0, 1), (2, 3)))]
    limbs = [Limb(n, points[c], tuple((j,) for j in c), parent="trunk" if trunk else None) for n, c in NAMED]
    motion = LimbMotion([*(chest if trunk else []), *limbs], SIDES, performer(*LEVEL), basis)
    first = int(trunk)
    left, right = Arm(first, first + 1, first + 2, 8), Arm(first + 3, first + 4, first + 5, 9)
    return motion, Arms(motion.bones, left, right, 0.54, basis, **settings)


NAMED = ("left", LEFT), ("right", RIGHT)


def play(poses, confidence=SEEN, both=None, free=False, **settings):
    """Return the motions (T, b, 4, 3), and where the tips of both hands go (T, 2, 3)."""
    motion, arms = both or character(**settings)
    found = []
    for k, pose in enumerate(poses):
        motions = motion.step(k * TICK, pose, confidence)
        if not free:
            arms.step(k * TICK, pose, confidence, motions)
        found.append(motions)
    last = [arms._plan.arms[0, 2], arms._plan.arms[1, 2]]
    tips = [[apply(T[bone], motion.bones.tails[bone]) for bone in last] for T in found]
    return np.array(found), np.array(tips)


def apply(T, point):
    return point @ T[:3] + T[3]


def lengths(motion, motions):
    return [
        np.linalg.norm(apply(T, h) - apply(T, t))
        for T, h, t in zip(motions, motion.bones.heads, motion.bones.tails, strict=True)
    ]


def test_hands_meet_where_the_performers_meet():
    together = clapping(0.6)
    gap = together[8] - together[9]
    assert np.linalg.norm(gap) < 0.15 * 0.54
    _, apart = play([together], free=True)
    _, tips = play([together])
    assert np.linalg.norm(apart[0, 0] - apart[0, 1]) > 0.15
    assert_allclose(tips[0, 0] - tips[0, 1], METRE * gap, atol=0.02)


def test_hands_that_do_not_come_together_or_need_not_are_left_alone():
    for pose, meet in ((clapping(0.0), True), (performer(*LEVEL), True), (clapping(0.6), False)):
        assert_array_equal(play([pose], meet=meet)[0], play([pose], free=True)[0])


def test_arms_that_are_drawn_keep_their_lengths_and_stay_joined():
    motions, _ = play([clapping(0.6)])
    motion, _ = character()
    expected = np.linalg.norm(motion.bones.tails - motion.bones.heads, axis=1)
    assert_allclose(lengths(motion, motions[0]), expected, atol=1e-12)
    for bone, parent in enumerate(motion.bones.parents):
        if parent >= 0:
            head = motion.bones.heads[bone]
            assert_allclose(apply(motions[0, bone], head), apply(motions[0, parent], head), atol=1e-12)


def test_arms_never_jump_while_hands_meet_and_are_lost():
    way = np.concatenate([np.linspace(0, 0.7, 40), np.full(10, 0.7), np.linspace(0.7, 0, 40)])
    poses = np.array([clapping(x) for x in way])
    free, drawn = play(poses, free=True)[1], play(poses)[1]
    assert np.abs(np.diff(drawn, axis=0)).max() < 5 * np.abs(np.diff(free, axis=0)).max()
    assert np.linalg.norm(drawn[45, 0] - drawn[45, 1]) < 0.1


@pytest.mark.parametrize("angle", [0.0, 0.3, -0.2])
def test_arms_that_hang_are_held_away_from_the_body_and_level_ones_are_not(angle):
    hanging = performer([[0, -1, 0]] * 3, [[0, -1, 0]] * 3)
    motion, _ = character()
    motions = play([hanging], space=angle, meet=False)[0][0]
    for first, sign in ((1, 1), (4, -1)):
        along = [motions[b, :3].T @ (motion.bones.tails[b] - motion.bones.heads[b]) for b in range(first, first + 3)]
        expected = [sign * np.sin(angle), -np.cos(angle), 0]
        assert_allclose([d / np.linalg.norm(d) for d in along], [expected] * 3, atol=1e-9)
    level = performer(*LEVEL)
    assert_allclose(play([level], space=angle, meet=False)[0], play([level], free=True)[0], atol=1e-12)


def test_the_space_of_the_arms_turns_with_the_body():
    hanging = performer([[0.1, -1, 0.2]] * 3, [[-0.3, -1, 0.1]] * 3)
    turn = Rotation.from_rotvec([0.2, 1.1, 0]).as_matrix()
    here = play([hanging], space=0.4, meet=False)[0][0]
    there = play([hanging @ turn.T], space=0.4, meet=False)[0][0]
    assert_allclose(there[:, :3], here[:, :3] @ turn.T, atol=1e-9)
