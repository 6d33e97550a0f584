import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.motion.feet import MAX_HOLD_METRES, SLACK_METRES, Feet, Leg
from solver.motion.limb_motion import LimbMotion
from solver.motion.limbs import Limb, Performer

from ..shapes import assert_joined, moved

TICK = 1 / 30
HIPS, LEFT, RIGHT = [0, 1], [0, 2, 4, 6], [1, 3, 5, 7]  # hip, knee, ankle and foot on either side
SIDES = Performer((0, 1), (0, 1), np.array([1, 0, 3, 2, 5, 4, 7, 6]))
SEEN = np.ones(8, dtype=np.float32)


def legs(hips, thigh, shin, sole):
    """A body from the hips down (8, 3), the soles at height 0."""
    left = np.array([[hips, sole + shin + thigh, 0], [hips, sole + shin, 0.02], [hips, sole, 0], [hips, 0, 0.15]])
    out = np.empty((8, 3))
    out[LEFT], out[RIGHT] = left, left * [-1, 1, 1]
    return out


PERFORMER = legs(0.1, 0.45, 0.42, 0.09) + np.array([0, 0.3, 0])  # with another height of the floor
CHARACTER = legs(0.3, 0.3, 0.5, 0.2)  # with other proportions
METRE = 0.8 / 0.87
AXES = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Of the character's file: it stands up along z."""


def both_legs(points, parent=None):
    return [Limb(n, points[c], tuple((j,) for j in c), parent=parent) for n, c in (("left", LEFT), ("right", RIGHT))]


class Puppet:
    """Motions and feet of the character, which stands otherwise in its file."""

    def __init__(self):
        self.motion = LimbMotion(both_legs(CHARACTER @ AXES), SIDES, PERFORMER, AXES)
        self.feet = Feet(self.motion.bones, [Leg(0, 1, 2, 4), Leg(3, 4, 5, 5)], METRE, AXES)

    def joints(self, motions):
        """Return where hips, knees, ankles and tips are (8, 3)."""
        places, bones = np.empty((8, 3)), self.motion.bones
        heads, tails = moved(bones.heads, motions), moved(bones.tails, motions)
        for chain, first in ((LEFT, 0), (RIGHT, 3)):
            places[chain] = [heads[first], *tails[first : first + 3]]
        return places

    def play(self, poses, confidence=SEEN, start=0):
        """Return where joints go (T, 8, 3), and would without feet, the root (T, 3), and which feet are held (T, 2)."""
        frames = []
        for k, pose in enumerate(poses, start):
            motions = self.motion.step(k * TICK, pose, confidence)
            root = ((pose[HIPS].mean(axis=0) - PERFORMER[HIPS].mean(axis=0)) * [METRE, 0, METRE]) @ AXES
            free = self.joints(motions) + root
            self.feet.step(k * TICK, pose, confidence, motions, root)
            frames.append(((self.joints(motions) + root) @ AXES.T, free @ AXES.T, root @ AXES.T, self.feet.held.copy()))
        return tuple(np.array(each) for each in zip(*frames, strict=True))


def bent(hips, left, right):
    """A performer whose hips and ankles are there, knees forwards."""
    pose = np.empty((8, 3))
    for chain, ankle, side in ((LEFT, left, 0.1), (RIGHT, right, -0.1)):
        hip = np.add(hips, [side, 0, 0])
        way = np.array(ankle) - hip
        reach = np.linalg.norm(way)
        along = (0.45**2 - 0.42**2 + reach**2) / (2 * reach)
        forward = np.array([0, 0, 1.0]) - way[2] * way / reach**2
        knee = hip + along * way / reach + np.sqrt(0.45**2 - along**2) * forward / np.linalg.norm(forward)
        pose[chain] = [hip, knee, ankle, np.add(ankle, [0, -0.09, 0.15])]
    return pose


@pytest.fixture(scope="module")
def walked():
    """Four steps of half a metre, one foot stands while the other swings; and in which frames the left one stands."""
    feet, poses = np.array([[0.1, 0.39, 0.0], [-0.1, 0.39, 0.0]]), []
    for step in range(4):
        side, start = step % 2, feet[step % 2].copy()
        way = np.array([0, 0, 0.5 if step else 0.25])
        for share in np.arange(14) / 14:
            feet[side] = start + share**2 * (3 - 2 * share) * way + [0, 0.12 * np.sin(np.pi * share), 0]
            poses.append(bent([0, 1.2, feet[:, 2].mean()], *feet))
        feet[side] = start + way
    return np.array(poses), np.arange(56) // 14 % 2 == 1


def test_a_performer_who_stands_leaves_the_legs_as_they_point_and_lays_the_feet_flat():
    places, free, root, held = Puppet().play([PERFORMER] * 60)
    assert held[5:].all()
    assert_allclose(places[:, :6], free[:, :6] + root[:, None], atol=1e-9)
    assert_allclose(places[:, [4, 5], 1], CHARACTER[4, 1], atol=1e-9)
    flat = places[-1, [6, 7]] - places[-1, [4, 5]]
    assert_allclose(flat, CHARACTER[[6, 7]] - CHARACTER[[4, 5]], atol=1e-6)


def test_feet_of_a_performer_whose_joints_shake_stay_where_they_are():
    rng = np.random.default_rng(2)
    shaking = PERFORMER + rng.normal(0, 0.004, (150, 8, 3))
    places, free, _, held = Puppet().play(shaking)
    assert held[10:].all()
    ankles = places[30:, [4, 5]]
    assert np.abs(ankles - ankles.mean(axis=0)).max() < 0.003
    assert np.abs(ankles[..., 1] - CHARACTER[4, 1]).max() < 0.003
    assert np.ptp(free[30:, [4, 5]], axis=0).max() > 0.02  # they would


def test_feet_do_not_slide_while_walking_and_the_lower_one_is_on_the_floor(walked):
    poses, left = walked
    places, free, _, held = Puppet().play(poses)
    slides = np.linalg.norm(np.diff(places[:, 4], axis=0)[:, [0, 2]], axis=1)
    stands = held[1:, 0] & held[:-1, 0] & left[1:]
    assert stands.sum() > 15
    assert slides[stands].max() < 1e-12 < 2e-3 < np.linalg.norm(np.diff(free[:, 4], axis=0), axis=1)[stands].max()
    steps = np.abs(np.diff(places[:, [4, 5]], axis=0)).max()
    assert steps < 1.6 * np.abs(np.diff(free[:, [4, 5]], axis=0)).max()  # nothing jumps
    for chain in (LEFT, RIGHT):  # legs keep their lengths and stay joined
        lengths = np.linalg.norm(np.diff(places[:, chain], axis=1), axis=2)
        expected = np.linalg.norm(np.diff(CHARACTER[chain], axis=0), axis=1)
        assert_allclose(lengths, np.broadcast_to(expected, lengths.shape), atol=1e-9)
    ankles, tips = (places[:, feet, 1] - CHARACTER[feet[0], 1] for feet in ([4, 5], [6, 7]))
    assert ankles.min() > -1e-9
    assert np.minimum(ankles, tips).min(axis=1).max() < SLACK_METRES + 1e-3
    assert ankles.max() > 0.05  # and the other one is lifted


def test_a_jump_leaves_the_floor_and_comes_back_to_it():
    up = 0.35 * np.sin(np.linspace(0, np.pi, 16))
    heights = np.concatenate([np.zeros(20), up, np.zeros(30)])
    places, _, root, held = Puppet().play(PERFORMER + heights[:, None, None] * [0, 1, 0])
    assert root[:, 1].max() == pytest.approx(METRE * (0.35 - 0.05), abs=0.05)
    assert not held[26:32].any()
    assert_allclose(places[-1], places[19], atol=2e-3)
    assert (places[:, [4, 5], 1] - CHARACTER[4, 1]).min() > -1e-9


def test_a_foot_that_is_dragged_far_is_let_go_and_comes_after_smoothly():
    hips = np.concatenate([np.zeros(10), 0.012 * np.arange(60)])
    poses = PERFORMER + hips[:, None, None] * [1, 0, 0]  # glides sideways, below the speed that lifts a foot
    places, free, _, held = Puppet().play(poses)
    assert held[10].all()
    assert not held[:, 0].all()
    away = np.linalg.norm(places[:, 4] - free[:, 4], axis=1)
    assert away.max() < 1.1 * MAX_HOLD_METRES * METRE
    assert np.linalg.norm(np.diff(places[:, 4], axis=0), axis=1).max() < 0.08


def on_a_pelvis(pose, frames=1, lean=0.0):
    """Bones of a character with a pelvis, their motions when its performer leans, the root, and those without feet."""
    back, leant = (np.array([[x / 2, 0.25, 0.0], [x, 0.5, 0.0]]) for x in (0.0, lean))
    trunk = Limb("trunk", np.vstack([pose[HIPS].mean(axis=0), pose[0] * [0, 1, 1] + back]), ((0, 1), (8,), (9,)))
    sides = Performer((0, 1), (0, 1), np.array([1, 0, 3, 2, 5, 4, 7, 6, 8, 9]))
    standing, leaning = (np.vstack([PERFORMER, PERFORMER[HIPS].mean(axis=0) + each]) for each in (back, leant))
    motion = LimbMotion([trunk, *both_legs(pose, "trunk")], sides, standing)
    feet, seen = Feet(motion.bones, [Leg(2, 3, 4, 4), Leg(5, 6, 7, 5)], METRE, pelvis=0), np.ones(10, dtype=np.float32)
    for k in range(frames):
        motions, root = motion.step(k * TICK, leaning, seen), np.zeros(3)
        as_performed = motions.copy()
        feet.step(k * TICK, leaning, seen, motions, root)
    return motion.bones, motions, root, as_performed


@pytest.mark.parametrize("side", [-1, 1])
def test_the_pelvis_tilts_so_that_both_legs_of_a_performer_who_leans_point_as_they_do_and_stand(side):
    bones, motions, root, as_performed = on_a_pelvis(CHARACTER, 90, side * 0.1)  # by 11°
    ankles = moved(bones.tails, motions)[[3, 6]] + root
    assert_allclose(ankles[:, 1], CHARACTER[4, 1], atol=1e-6)
    assert_allclose(motions[[1, 2, 3, 5, 6], :3], as_performed[[1, 2, 3, 5, 6], :3], atol=1e-6)
    assert np.degrees(np.arcsin(abs(as_performed[0, 0, 1]))) > 10
    assert_allclose(motions[0, 0, 1], 0, atol=1e-6)
    assert_joined(bones, motions)


def test_hips_at_one_place_do_not_tilt():
    _, motions, _, as_performed = on_a_pelvis(CHARACTER * [0, 1, 1])
    assert_array_equal(motions[0], as_performed[0])


def test_feet_out_of_sight_are_left_alone(walked):
    confidence = SEEN.copy()
    confidence[4:] = 0.5
    places, _, _, held = Puppet().play(walked[0], confidence)
    assert not held.any()
    lowest = places[:, [4, 5, 6, 7], 1] - CHARACTER[[4, 5, 6, 7], 1]
    assert_allclose(lowest.min(axis=1), 0, atol=1e-9)


def test_bones_below_a_foot_move_with_it(walked):
    spur = Limb("spur", np.array([[0.3, 0.2, -0.02], [0.3, 0.2, -0.2]]), ((4,), (4,)), parent="left")
    motion = LimbMotion([*both_legs(CHARACTER), spur], SIDES, PERFORMER)
    feet = Feet(motion.bones, [Leg(0, 1, 2, 4), Leg(3, 4, 5, 5)], METRE)
    on = motion.bones.parents[6]
    for k, pose in enumerate(walked[0]):
        motions, root = motion.step(k * TICK, pose, SEEN), np.zeros(3)
        against = motions[on, :3].T @ motions[6, :3]
        feet.step(k * TICK, pose, SEEN, motions, root)
        assert_joined(motion.bones, motions)
        assert_allclose(motions[on, :3].T @ motions[6, :3], against, atol=1e-12)


def test_feet_are_held_from_the_first_frame_on_where_those_of_another_were(walked):
    one, other = Puppet(), Puppet()
    held = one.play(walked[0][:25])[3][-1]
    assert held.tolist() == [True, False]
    other.feet.hold(one.feet.places)
    assert other.feet.held.tolist() == held.tolist()
    ours, theirs = (each.play(walked[0][25:30], start=25) for each in (one, other))
    assert (ours[3] & theirs[3])[:, 0].all()
    assert_allclose(theirs[0][:, 4, [0, 2]], ours[0][:, 4, [0, 2]], atol=1e-6)
