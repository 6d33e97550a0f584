import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.motion.step_plan import HEADING, PerformersLegs, StandingLeg
from solver.motion.steps import MAX_TURNING_SPEED, Steps

from ..shapes import chains

TICK = 1 / 60
HIPS, ANKLES, SHOULDERS, HANDS = (0, 1), (2, 3), (4, 5), (6, 7)
LEG, ARM = 0.85, 0.6
PERFORMER = PerformersLegs(ankles=ANKLES, hips=HIPS, leg=LEG, arm=ARM)
SEEN = np.ones(8, dtype=np.float32)
HEIGHT = 0.6


def stand():
    """A performer (8, 3) who stands with hanging arms."""
    side = np.array([[1.0], [-1.0]])
    out = np.empty((8, 3))
    for joints, width, height in ((HIPS, 0.1, LEG), (ANKLES, 0.1, 0.0), (SHOULDERS, 0.2, 1.35), (HANDS, 0.25, 0.75)):
        out[list(joints)] = [width, height, 0] * np.hstack([side, np.ones((2, 2))])
    return out + np.array([0, 0.1, 0])


def raised(*hands):
    """The same performer with raised hands."""
    pose = stand()
    pose[list(hands), 1] = pose[SHOULDERS[0], 1] + 0.3
    return pose


def crouching():
    pose = stand()
    pose[list(HIPS + SHOULDERS + HANDS), 1] -= 0.4
    return pose


def unseen(pose):
    """A pose whose feet nobody sees."""
    pose[list(ANKLES)] = np.nan
    return pose


def animal(pairs, basis=None, knee=0.33):
    """A body with a trunk of two bones and pairs of legs of two bones and a foot, and its legs."""
    limbs, legs = [(-1, [[0, HEIGHT, z] for z in (-0.5, 0, 0.5)])], []
    for row, place in enumerate(np.linspace(-0.5, 0.5, pairs) if pairs > 1 else [0.0]):
        for side, x in enumerate((0.15, -0.15)):
            bent = place + (0.08 if row == 0 else -0.08)
            ways = [[x, 0.6, place], [x, knee, bent], [x, 0.05, place], [x, 0.0, place + 0.1]]
            limbs.append((0 if place < 0 else 1, ways))
            first = 2 + 3 * len(legs)
            legs.append(StandingLeg((first, first + 1, first + 2), HANDS[side], SHOULDERS[side]))
    return chains(
        *((parent, np.array(points) @ (np.eye(3) if basis is None else basis)) for parent, points in limbs)
    ), legs


class Walk:
    """An animal that a performer drives: places of its feet (T, l, 3) and hips (T, 3), and which feet swing (T, l)."""

    def __init__(self, poses, pairs=2, headings=None, basis=None, forward=False, follow=None, knee=0.33):
        bones, legs = animal(pairs, basis, knee)
        axes = np.eye(3) if basis is None else basis
        self.bones, self.legs, self.axes = bones, legs, axes
        self.steps = Steps(bones, legs, (0, 1), PERFORMER, HEIGHT / LEG, axes, goes_forward=forward)
        self.play(poses, headings, follow)

    def play(self, poses, headings=None, follow=None):
        """Play a recording."""
        bones, legs, axes, metre = self.bones, self.legs, self.axes, HEIGHT / LEG
        tips = [leg.bones[-1] for leg in legs]
        start, feet, hips, swinging, motions = stand()[list(HIPS)].mean(axis=0), [], [], [], []
        for number, pose in enumerate(poses):
            heading = 0.0 if headings is None else headings[number]
            turn = Rotation.from_rotvec([0, heading, 0]).as_matrix().T
            T = np.empty((len(bones), 4, 3))
            T[:, :3] = axes.T @ turn @ axes
            T[:, 3] = bones.heads[0] - bones.heads[0] @ T[0, :3]
            root = (pose[list(HIPS)].mean(axis=0) - start) * [metre, 0, metre] @ axes
            if follow is not None:
                follow(number, T, bones)
            self.steps.step(number * TICK, pose, SEEN, T, root)
            ankles = np.array([bones.heads[bone] @ T[bone, :3] + T[bone, 3] for bone in tips])
            feet.append((ankles + root) @ axes.T)
            hips.append((bones.heads[0] @ T[0, :3] + T[0, 3] + root) @ axes.T)
            swinging.append(self.steps.swinging)
            motions.append(T)
        self.feet, self.hips = np.array(feet), np.array(hips)
        self.swinging, self.motions = np.array(swinging), np.array(motions)

    @property
    def slides(self):
        """Distances by which feet that stand move in a frame."""
        stands = ~self.swinging[1:] & ~self.swinging[:-1]
        return np.linalg.norm(np.diff(self.feet, axis=0), axis=2)[stands]


def walking(speed, seconds=4.0):
    """A performer who starts to glide forwards within a second, whose feet nobody sees."""
    way = 0.0
    for number in range(round(seconds / TICK)):
        way += speed * min(1.0, number * TICK) * TICK
        yield unseen(stand() + np.array([0, 0, way]))


def on_the_spot(period=1.0, seconds=5.0):
    """A performer who walks in place."""
    for number in range(round(seconds / TICK)):
        pose, phase = stand(), (number * TICK / period) % 1
        for side, start in enumerate((0.0, 0.5)):
            share = (phase - start) % 1 / 0.4
            pose[ANKLES[side], 1] += 0.2 * np.sin(np.pi * share) if share < 1 else 0
        yield pose


def test_a_body_that_stands_as_at_rest_does_not_move():
    assert np.allclose(Walk([stand()] * 30).motions, np.eye(4, 3), atol=1e-9)


@pytest.mark.parametrize("pairs", [1, 2, 3, 4])
def test_feet_that_stand_stay_on_the_floor_and_others_swing_over_it_and_land_flat(pairs):
    walk = Walk(walking(1.0), pairs)

    assert walk.slides.max() < 1e-6
    assert walk.swinging.sum(axis=1).max() == pairs  # half of them always stand
    assert np.all(walk.swinging.any(axis=0))
    heights = walk.feet[:, :, 1] - 0.05  # over the ankles' height at rest
    assert heights.min() > -1e-6
    assert np.abs(heights[~walk.swinging]).max() < 1e-6
    assert walk.hips[:, 1].max() < HEIGHT + 1e-6  # the body sinks, so that legs reach their feet
    assert np.abs(walk.feet[-1, :, 2].mean() - walk.hips[-1, 2] - 0.5) < 0.3 * HEIGHT
    assert 0.05 < heights.max() / HEIGHT < 0.25
    moves = np.diff(walk.feet, axis=0)
    begins, speeds = ~walk.swinging[:-1] & walk.swinging[1:], np.linalg.norm(moves, axis=2)
    landed = walk.swinging[:-2] & ~walk.swinging[1:-1]
    assert moves[begins][:, 1].min() > 0  # they only rise before they move ahead
    assert np.abs(moves[begins][:, [0, 2]]).max() < 1e-9
    assert speeds[1:][landed].max() < 0.05 * speeds.max()


def test_a_performer_who_bends_shifts_the_body_and_not_the_feet():
    back = np.isin(np.arange(8), HIPS)[:, None] * [0, 0, -0.3]

    walk = Walk([stand() + share * back for share in np.clip(np.arange(120) / 60 - 1, 0, 1)])

    assert not walk.swinging.any()
    assert np.ptp(walk.feet, axis=0).max() < 1e-6
    assert 0.05 < walk.hips[0, 2] - walk.hips[-1, 2] <= 0.2 * HEIGHT


def test_walking_in_place_moves_a_body_that_goes_forward_along_its_heading():
    walk = Walk(on_the_spot(), forward=True, headings=np.full(300, 0.5))

    way = walk.hips[-1] - walk.hips[0]
    assert np.linalg.norm(way) > 2 * HEIGHT
    assert np.arctan2(way[0], way[2]) == pytest.approx(0.5, abs=1e-6)
    assert walk.slides.max() < 1e-6


def test_a_jump_lifts_the_whole_body():
    up = np.concatenate([np.zeros(60), 0.4 * np.sin(np.pi * np.arange(30) / 30), np.zeros(60)])

    walk = Walk(stand() + up[:, None, None] * [0, 1, 0])

    assert np.ptp(walk.hips[:, 1]) > 0.2 * HEIGHT / LEG
    assert np.allclose(np.ptp(walk.feet[:, :, 1], axis=0), np.ptp(walk.hips[:, 1]), rtol=0.1)


def test_the_axes_of_the_mesh_do_not_matter():
    basis = np.array([[0, 1.0, 0], [0, 0, 1.0], [1.0, 0, 0]])

    here, there = Walk(walking(1.0, 2.0)), Walk(walking(1.0, 2.0), basis=basis)

    assert np.allclose(there.feet, here.feet, atol=1e-9)
    assert np.allclose(there.hips, here.hips, atol=1e-9)


def test_a_raised_hand_lifts_the_front_leg_of_its_side_and_a_lowered_one_puts_it_down():
    left_front = animal(2)[1][2].bones

    def forward(number, T, bones):
        """The left front leg follows the arm: it turns forward by 60 degrees about its hip."""
        turn = Rotation.from_rotvec([-np.pi / 3, 0, 0]).as_matrix().T
        for bone in left_front:
            T[bone, :3] = turn
            T[bone, 3] = bones.heads[left_front[0]] - bones.heads[left_front[0]] @ turn

    walk = Walk([stand()] * 30 + [raised(HANDS[0])] * 60 + [stand()] * 90, follow=forward)

    bones, _ = animal(2)
    hip, ankle = bones.heads[left_front[0]], bones.heads[left_front[2]]
    way = (walk.feet[89, 2] - hip) / np.linalg.norm(ankle - hip)
    assert 45 < np.degrees(np.arctan2(way[2], -way[1])) <= 60
    assert np.allclose(np.delete(walk.feet, 2, axis=1), np.delete(walk.feet[0], 2, axis=0), atol=1e-6)
    assert walk.feet[-1] == pytest.approx(walk.feet[0], abs=1e-6)


def test_both_raised_hands_let_the_body_rear_which_then_walks_on_all_its_legs():
    walk = Walk([*[stand()] * 30, *[raised(*HANDS)] * 120, *[stand()] * 90, *walking(0.8)])

    pitch = np.arcsin(walk.motions[149, 0, 2, 1])
    assert np.degrees(pitch) == pytest.approx(36, abs=2)
    assert np.abs(walk.feet[149, :2] - walk.feet[0, :2]).max() < 1e-6
    assert walk.swinging[240:].any(axis=0).all()
    stands = ~walk.swinging[241:] & ~walk.swinging[240:-1]
    assert np.linalg.norm(np.diff(walk.feet[240:], axis=0), axis=2)[stands].max() < 1e-6


def test_a_crouching_performer_lets_four_legs_sit():
    walk = Walk([stand()] * 30 + [crouching()] * 90)

    bones, _ = animal(2)
    front = bones.tails[1] @ walk.motions[-1, 1, :3] + walk.motions[-1, 1, 3] + walk.hips[-1] - bones.heads[0]
    assert HEIGHT - walk.hips[-1, 1] > 0.2 * HEIGHT
    assert HEIGHT - front[1] < 0.5 * (HEIGHT - walk.hips[-1, 1])
    assert np.abs(walk.feet[-1] - walk.feet[0]).max() < 1e-6


def test_no_foot_sinks_into_the_floor_though_a_crouching_performer_leaps_ahead_and_legs_fold_little():
    leap = [crouching() + np.array([0, 0, share]) for share in np.linspace(0, 1, 15)]

    walk = Walk([raised(*HANDS)] * 60 + leap + leap[-1:] * 60, knee=0.55)

    assert walk.feet[..., 1].min() > 0.05 - 0.02 * HEIGHT


def test_feet_go_on_standing_where_those_of_another_recording_stood():
    before = Walk(walking(0.7, 3.0)).steps.places
    way = np.array([0, 0, 0.7 * 2.5 * HEIGHT / LEG])
    held = before - way

    def hold(number, T, bones):
        if number == 0:
            walk.steps.hold(held)

    walk = Walk([])
    walk.play([stand()] * 5, follow=hold)

    stood = np.isfinite(held).all(axis=1)
    assert stood.sum() >= 2
    near = np.linalg.norm(held - Walk([stand()]).feet[0], axis=1) < 0.2 * HEIGHT
    assert np.allclose(walk.feet[:, stood & near], held[stood & near], atol=1e-9)
    assert np.isfinite(walk.feet).all()


def test_a_body_turns_on_the_spot_by_stepping_no_faster_than_its_legs_can_follow_and_not_too_far():
    headings, walk = [], Walk([])
    walk.play(
        [unseen(stand())] * 300,  # feet that are seen to rest do not turn
        np.where(np.arange(300) < 60, 0.0, np.pi / 2),
        lambda *_: headings.append(walk.steps._state.body[HEADING]),
    )

    speeds = np.diff(headings) / TICK
    fastest = MAX_TURNING_SPEED * HEIGHT / walk.steps._plan.radius
    assert 0.9 * fastest < speeds.max() <= fastest
    assert speeds.min() >= 0
    assert headings[-1] == pytest.approx(np.pi / 2, abs=0.01)
    home = Walk([stand()]).feet[0] - walk.hips[0]
    assert np.abs(walk.feet[-1] - walk.hips[-1] - home @ [[0, 0, -1], [0, 1, 0], [1, 0, 0]]).max() < 0.4 * HEIGHT
    assert np.percentile(walk.slides, 95) < 1e-6  # a quick turn drags a foot


def test_a_performer_who_shuffles_away_slowly_takes_the_body_along():
    walk = Walk([stand() + np.array([0.0, 0.0, 0.1 * number * TICK]) for number in range(600)])

    way = walk.hips[-1, 2] - walk.hips[0, 2]
    assert way == pytest.approx(HEIGHT / LEG, abs=0.3 * HEIGHT)
    assert walk.swinging.any(axis=0).all()
