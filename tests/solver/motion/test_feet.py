import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from solver.motion.feet import MAX_HOLD_METRES, SLACK_METRES, Feet, Leg
from solver.motion.limb_motion import LimbMotion
from solver.motion.limbs import Limb, Performer

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


def both_legs(points, parent=None):
    return [Limb(n, points[c], tuple((j,) for j in c), parent=parent) for n, c in (("left", LEFT), ("right", RIGHT))]


def stand_on(pose=CHARACTER, basis=None):
    """Motions and feet of the character, in a mesh file with the axes `basis`."""
    points = pose if basis is None else pose @ basis
    motion = LimbMotion(both_legs(points), SIDES, PERFORMER, basis)
    return motion, Feet(motion.bones, [Leg(0, 1, 2, 4), Leg(3, 4, 5, 5)], METRE, basis)


def play(poses, basis=None, free=False, confidence=SEEN, both=None, start=0):
    """Return where hips, knees, ankles and tips go (T, 8, 3), the root (T, 3), and which feet are held (T, 2)."""
    motion, feet = both or stand_on(basis=basis)
    axes = np.eye(3) if basis is None else basis
    places, roots, held = [], [], []
    for k, pose in enumerate(poses, start):
        motions = motion.step(k * TICK, pose, confidence)
        root = ((pose[HIPS].mean(axis=0) - PERFORMER[HIPS].mean(axis=0)) * [METRE, 0, METRE]) @ axes
        if not free:
            feet.step(k * TICK, pose, confidence, motions, root)
        place = np.empty((8, 3))
        for chain, first in ((LEFT, 0), (RIGHT, 3)):
            place[chain[0]] = apply(motions[first], motion.bones.heads[first])
            for bone, joint in enumerate(chain[1:], first):
                place[joint] = apply(motions[bone], motion.bones.tails[bone])
        places.append((place + root) @ axes.T)
        roots.append(root @ axes.T)
        held.append(feet.held.copy())
    return np.array(places), np.array(roots), np.array(held)


def apply(T, point):
    return point @ T[:3] + T[3]


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


def walk(steps=4, frames=14, stride=0.5):
    """Steps of half a metre: one foot stands while the other swings."""
    feet, poses, standing = {0: np.array([0.1, 0.39, 0.0]), 1: np.array([-0.1, 0.39, 0.0])}, [], []
    for step in range(steps):
        side = step % 2
        start, end = feet[side].copy(), feet[side] + [0, 0, stride if step else stride / 2]
        for k in range(frames):
            share = k / frames
            smooth = share**2 * (3 - 2 * share)
            feet[side] = start + smooth * (end - start) + [0, 0.12 * np.sin(np.pi * share), 0]
            middle = (feet[0] + feet[1]) / 2
            poses.append(bent([0, 1.2, middle[2]], feet[0], feet[1]))
            standing.append(side == 1)  # the left one stands while the right one swings
        feet[side] = end
    return np.array(poses), np.array(standing)


@pytest.fixture(scope="module")
def walked():
    return walk()


def test_a_performer_who_stands_leaves_the_legs_as_they_point_and_lays_the_feet_flat():
    places, root, held = play([PERFORMER] * 60)
    points, _, _ = play([PERFORMER] * 60, free=True)
    assert held[5:].all()
    assert_allclose(places[:, :6], points[:, :6] + root[:, None], atol=1e-9)
    assert_allclose(places[:, [4, 5], 1], CHARACTER[4, 1], atol=1e-9)
    flat = places[-1, [6, 7]] - places[-1, [4, 5]]
    assert_allclose(flat, CHARACTER[[6, 7]] - CHARACTER[[4, 5]], atol=1e-6)


def test_feet_of_a_performer_whose_joints_shake_stay_where_they_are():
    rng = np.random.default_rng(2)
    shaking = PERFORMER + rng.normal(0, 0.004, (150, 8, 3))
    places, _, held = play(shaking)
    assert held[10:].all()
    ankles = places[30:, [4, 5]]
    assert np.abs(ankles - ankles.mean(axis=0)).max() < 0.003
    assert np.abs(ankles[..., 1] - CHARACTER[4, 1]).max() < 0.003
    free = play(shaking, free=True)[0][30:, [4, 5]]
    assert np.ptp(free, axis=0).max() > 0.02  # they would


def test_feet_do_not_slide_while_walking_and_the_lower_one_is_on_the_floor(walked):
    poses, left = walked
    places, _, held = play(poses)
    free = play(poses, free=True)[0]
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


def test_a_squat_bends_the_knees_and_lowers_the_hips():
    downs = np.concatenate([np.zeros(10), 0.25 * (1 - np.cos(np.linspace(0, np.pi, 30))) / 2, np.full(20, 0.25)])
    poses = [bent([0, 1.24 - down, 0], [0.1, 0.39, 0], [-0.1, 0.39, 0]) for down in downs]
    places, root, held = play(poses)
    assert_allclose(places[-1, [4, 5], 1], CHARACTER[4, 1], atol=1e-3)
    assert held[10:].all()
    assert root[-1, 1] < -0.15
    assert_allclose(places[-1, [2, 3], 2], places[-1, 2, 2])
    assert places[-1, 2, 2] > CHARACTER[2, 2] + 0.15


def test_a_jump_leaves_the_floor_and_comes_back_to_it():
    up = 0.35 * np.sin(np.linspace(0, np.pi, 16))
    heights = np.concatenate([np.zeros(20), up, np.zeros(30)])
    places, root, held = play(PERFORMER + heights[:, None, None] * [0, 1, 0])
    assert root[:, 1].max() == pytest.approx(METRE * (0.35 - 0.05), abs=0.05)
    assert not held[26:32].any()
    assert_allclose(places[-1], places[19], atol=2e-3)
    assert (places[:, [4, 5], 1] - CHARACTER[4, 1]).min() > -1e-9


def test_a_foot_that_is_dragged_far_is_let_go_and_comes_after_smoothly():
    hips = np.concatenate([np.zeros(10), 0.012 * np.arange(60)])
    poses = PERFORMER + hips[:, None, None] * [1, 0, 0]  # glides sideways, below the speed that lifts a foot
    places, _, held = play(poses)
    assert held[10].all()
    assert not held[:, 0].all()
    away = np.linalg.norm(places[:, 4] - play(poses, free=True)[0][:, 4], axis=1)
    assert away.max() < 1.1 * MAX_HOLD_METRES * METRE
    assert np.linalg.norm(np.diff(places[:, 4], axis=0), axis=1).max() < 0.08


@pytest.mark.parametrize("side", [-1, 1])
def test_the_pelvis_tilts_so_that_both_legs_of_a_performer_who_leans_point_as_they_do_and_stand(side):
    back = np.array([[0.0, 0.25, 0.0], [0.0, 0.5, 0.0]])
    lean = np.array([[side * 0.05, 0.25, 0.0], [side * 0.1, 0.5, 0.0]])  # by 11°
    limbs = [
        Limb("trunk", np.vstack([CHARACTER[HIPS].mean(axis=0), CHARACTER[0] * [0, 1, 1] + back]), ((0, 1), (8,), (9,))),
        *both_legs(CHARACTER, "trunk"),
    ]
    sides = Performer((0, 1), (0, 1), np.array([1, 0, 3, 2, 5, 4, 7, 6, 8, 9]))
    standing = np.vstack([PERFORMER, PERFORMER[HIPS].mean(axis=0) + back])
    leaning = np.vstack([PERFORMER, PERFORMER[HIPS].mean(axis=0) + lean])
    motion = LimbMotion(limbs, sides, standing)
    feet = Feet(motion.bones, [Leg(2, 3, 4, 4), Leg(5, 6, 7, 5)], METRE, pelvis=0)
    for k in range(90):
        motions, root = motion.step(k * TICK, leaning, np.ones(10, dtype=np.float32)), np.zeros(3)
        as_performed = motions.copy()
        feet.step(k * TICK, leaning, np.ones(10, dtype=np.float32), motions, root)
    ankles = np.array([apply(motions[shin], motion.bones.tails[shin]) for shin in (3, 6)]) + root
    assert_allclose(ankles[:, 1], CHARACTER[4, 1], atol=1e-6)
    assert_allclose(motions[[1, 2, 3, 5, 6], :3], as_performed[[1, 2, 3, 5, 6], :3], atol=1e-6)
    hips = as_performed[0, 0, :3]
    assert np.degrees(np.arcsin(abs(hips[1]))) > 10
    assert_allclose(motions[0, 0, 1], 0, atol=1e-6)
    for bone, parent in enumerate(motion.bones.parents):
        if parent >= 0:
            head = motion.bones.heads[bone]
            assert_allclose(apply(motions[bone], head), apply(motions[parent], head), atol=1e-12)


def test_hips_at_one_place_do_not_tilt():
    pose = CHARACTER * [0, 1, 1]
    limbs = [Limb("trunk", np.array([pose[0], pose[0] + [0, 0.5, 0]]), ((0, 1), (8,))), *both_legs(pose, "trunk")]
    performer = np.vstack([PERFORMER, PERFORMER[HIPS].mean(axis=0) + np.array([0, 0.5, 0])])
    motion = LimbMotion(limbs, Performer((0, 1), (0, 1), np.array([1, 0, 3, 2, 5, 4, 7, 6, 8])), performer)
    feet = Feet(motion.bones, [Leg(1, 2, 3, 4), Leg(4, 5, 6, 5)], METRE, pelvis=0)
    motions = motion.step(0.0, performer, np.ones(9, dtype=np.float32))
    before = motions[0].copy()
    feet.step(0.0, performer, np.ones(9, dtype=np.float32), motions, np.zeros(3))
    assert_array_equal(motions[0], before)


def test_feet_out_of_sight_are_left_alone():
    confidence = SEEN.copy()
    confidence[4:] = 0.5
    places, _, held = play(walk()[0], confidence=confidence)
    assert not held.any()
    lowest = places[:, [4, 5, 6, 7], 1] - CHARACTER[[4, 5, 6, 7], 1]
    assert_allclose(lowest.min(axis=1), 0, atol=1e-9)


def test_a_mesh_that_stands_otherwise_in_its_file_walks_the_same(walked):
    basis = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    assert_allclose(play(walked[0], basis)[0], play(walked[0])[0], atol=1e-9)


def test_bones_below_a_foot_move_with_it(walked):
    spur = Limb("spur", np.array([[0.3, 0.2, -0.02], [0.3, 0.2, -0.2]]), ((4,), (4,)), parent="left")
    motion = LimbMotion([*both_legs(CHARACTER), spur], SIDES, PERFORMER)
    feet = Feet(motion.bones, [Leg(0, 1, 2, 4), Leg(3, 4, 5, 5)], METRE)
    on, head = motion.bones.parents[6], motion.bones.heads[6]
    for k, pose in enumerate(walked[0]):
        motions, root = motion.step(k * TICK, pose, SEEN), np.zeros(3)
        against = Rotation.from_matrix(motions[on, :3].T @ motions[6, :3])
        feet.step(k * TICK, pose, SEEN, motions, root)
        assert_allclose(apply(motions[6], head), apply(motions[on], head), atol=1e-12)
        assert_allclose(motions[on, :3].T @ motions[6, :3], against.as_matrix(), atol=1e-12)


def test_feet_are_held_from_the_first_frame_on_where_those_of_another_were(walked):
    one, other = stand_on(), stand_on()
    held = play(walked[0][:25], both=one)[2][-1]
    assert held.tolist() == [True, False]
    other[1].hold(one[1].places)
    assert other[1].held.tolist() == held.tolist()
    rest = walked[0][25:]
    (ours, _, ours_held), (theirs, _, theirs_held) = (play(rest, both=each, start=25) for each in (one, other))
    both = (ours_held & theirs_held)[:, 0]
    assert both[:5].all()
    assert_allclose(theirs[:5, 4, [0, 2]], ours[:5, 4, [0, 2]], atol=1e-6)
