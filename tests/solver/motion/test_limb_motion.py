import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture.skeleton import JOINT_INDEX as AT
from capture.skeleton import OPPOSITE
from solver.motion.limb_motion import LimbMotion
from solver.motion.limbs import Limb, Performer, bones_of, parents_first

from ..shapes import assert_joined, moved

SIDES = Performer((AT["hip_left"], AT["hip_right"]), (AT["shoulder_left"], AT["shoulder_right"]), OPPOSITE)
TRACKED = np.ones(len(AT), dtype=np.float32)
TICK = 1 / 30
REST = np.vstack([np.eye(3), np.zeros(3)])


def body(trunk, shoulders, hips, upper, lower, hand, arms):
    """A symmetric body (20, 3): sizes, and the direction (3,) of the left arm."""
    along = np.cumsum([0, upper, lower, hand])[:, None] * arms / np.linalg.norm(arms)
    legs = [[hips, -0.05, 0], [hips + 0.02, -0.5, 0.02], [hips + 0.03, -0.95, 0], [hips + 0.05, -1, 0.15]]
    arm = np.add(along, [shoulders, trunk - 0.02, 0])
    middle = [[0, 0, 0], [0, trunk / 2, 0], [0, trunk, 0], [0, 1.3 * trunk, 0.02]]
    return np.vstack([middle, *(np.multiply(each, [side, 1, 1]) for each in (arm, legs) for side in (1, -1))])


HANGING = body(0.5, 0.19, 0.09, 0.28, 0.26, 0.09, [0.1, -1, 0.03])
T_POSE = body(0.4, 0.3, 0.2, 0.2, 0.35, 0.1, [1, 0, 0])


def limb(pose, name, *joints, **more):
    more = {"parent": None if name == "trunk" else "trunk"} | more
    return Limb(name, pose[[AT[joint] for joint in joints]], tuple((AT[joint],) for joint in joints), **more)


def character(pose, follow="direction"):
    limbs = [
        limb(pose, "trunk", "hip_center", "spine", "shoulder_center", follow=follow),
        limb(pose, "head", "shoulder_center", "head", follow=follow),
    ]
    for side in ("left", "right"):
        arm, leg = (
            [f"{joint}_{side}" for joint in chain]
            for chain in (("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot"))
        )
        limbs += [limb(pose, f"{side} arm", *arm, follow=follow), limb(pose, f"{side} leg", *leg, follow=follow)]
    return limbs


def in_t_pose():
    """A character in a T pose and a performer who calibrates with hanging arms.

    Its bones: two of the trunk, that of the head, three each of arm and leg on the left, and the same on the right.
    """
    return LimbMotion(character(T_POSE), SIDES, HANGING)


def directions(motion, motions):
    """Where the bones point (b, 3), and how long they are (b,)."""
    along = moved(motion.bones.tails, motions) - moved(motion.bones.heads, motions)
    length = np.linalg.norm(along, axis=1)
    return along / length[:, None], length


def wanted(motion, pose):
    """Where the performer's bones point (b, 3), in the order of the motion's; both bodies have the same feet."""
    ends = np.array([pair for each in motion.limbs for pair in itertools.pairwise([j[0] for j in each.joints])])
    along = pose[ends[:, 1]] - pose[ends[:, 0]]
    return along / np.linalg.norm(along, axis=1)[:, None]


def play(motion, poses, confidence=None, start=0.0):
    confidence = itertools.repeat(TRACKED) if confidence is None else confidence
    return np.array(
        [motion.step(start + k * TICK, p, c) for k, (p, c) in enumerate(zip(poses, confidence, strict=False))]
    )


def turns(motions):
    """Rotations (T, b, 3, 3) for column vectors."""
    return np.swapaxes(motions[..., :3, :], -1, -2)


def largest_step(motions):
    """Largest angle between two frames, radians, over all bones."""
    R = turns(motions)
    steps = Rotation.from_matrix(np.einsum("tbij,tbkj->tbik", R[1:], R[:-1]).reshape(-1, 3, 3))
    return steps.magnitude().max()


def with_arms(pose, left, right):
    """A pose whose arms are chains of directions: for each arm (3, 3), upper arm, forearm, hand."""
    pose = pose.copy()
    for side, chain in (("left", left), ("right", right)):
        joints = [AT[f"{joint}_{side}"] for joint in ("shoulder", "elbow", "wrist", "hand")]
        lengths = np.linalg.norm(np.diff(pose[joints], axis=0), axis=1)
        chain = np.array(chain, dtype=np.float64)
        chain /= np.linalg.norm(chain, axis=1)[:, None]
        pose[joints[1:]] = pose[joints[0]] + np.cumsum(lengths[:, None] * chain, axis=0)
    return pose


LEFT, RIGHT = (
    np.array([[0.2, -1, 0.2], [-1, 0.1, 0.35], [-1, 0.2, 0]]),
    np.array([[-0.2, -1, 0.2], [1, 0.2, 0.45], [1, 0.3, 0]]),
)
CROSSED = with_arms(HANGING, LEFT, RIGHT)


@pytest.mark.parametrize("follow", ["direction", "turn"])
def test_a_performer_in_the_characters_pose_leaves_it_as_it_is(follow):
    motion = LimbMotion(character(HANGING, follow), SIDES, HANGING)
    assert_allclose(play(motion, [2.5 * HANGING + [0.3, 1, -2]] * 3), np.broadcast_to(REST, (3, 15, 4, 3)), atol=1e-14)


def test_directions_are_the_performers_in_every_frame_and_bones_keep_their_lengths_and_stay_joined():
    rng = np.random.default_rng(3)
    swing = np.cumsum(rng.normal(0, 0.03, (60, 2, 3, 3)), axis=0)
    poses = [with_arms(HANGING, LEFT + s[0], RIGHT + s[1]) for s in swing]
    motion = in_t_pose()
    bones = motion.bones
    for pose, motions in zip(poses, play(motion, poses), strict=True):
        found, length = directions(motion, motions)
        assert_allclose(found, wanted(motion, pose), atol=1e-12)
        assert_allclose(length, np.linalg.norm(bones.tails - bones.heads, axis=1), atol=1e-12)
        assert_joined(bones, motions, 1e-14)


def test_an_arm_that_is_lowered_from_a_t_pose_bends_forwards_without_roll():
    """Hand-computed: down is a quarter turn about −z, and the palm that faced down faces the thigh."""
    motion = in_t_pose()
    lowered = with_arms(HANGING, [[0, -1, 0], [0, 0, 1], [0, 0, 1]], [[0, -1, 0], [0, 0, 1], [0, 0, 1]])
    R = turns(motion.step(0.0, lowered, TRACKED))
    assert_allclose(R[3] @ np.eye(3), [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-12)
    # the forearm bends about the axis that pointed down, and now points to the right
    assert_allclose(R[4] @ [1, 0, 0], [0, 0, 1], atol=1e-12)
    assert_allclose(R[4] @ [0, -1, 0], [-1, 0, 0], atol=1e-12)


def test_a_rigid_motion_of_the_performer_is_one_of_the_character_whatever_the_axes_of_its_file():
    basis = np.array([[0, 1.0, 0], [0, 0, 1.0], [1.0, 0, 0]])
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    ours, hips = in_t_pose(), T_POSE[0]
    turned = [Limb(x.name, x.points @ basis, x.joints, x.follow, x.gain, x.parent) for x in ours.limbs]
    theirs = LimbMotion(turned, SIDES, HANGING, basis)
    here, there = ours.step(0.0, CROSSED, TRACKED), theirs.step(0.0, CROSSED @ turn.T + [3, 1, -2], TRACKED)
    assert_allclose(turns(there), basis.T @ turn @ turns(here) @ basis, atol=1e-12)
    expected = ((moved(ours.bones.tails, here) - hips) @ turn.T + hips) @ basis
    assert_allclose(moved(theirs.bones.tails, there), expected, atol=1e-12)


@pytest.mark.parametrize("follow", ["direction", "turn"])
def test_a_mirrored_performer_moves_a_symmetric_character_as_its_mirror_image(follow):
    rng = np.random.default_rng(5)
    poses = HANGING + np.cumsum(rng.normal(0, 0.004, (40, len(AT), 3)), axis=0)
    flip = np.array([-1.0, 1, 1])
    ours = play(LimbMotion(character(T_POSE, follow), SIDES, HANGING), poses)
    theirs = play(LimbMotion(character(T_POSE, follow), SIDES, (HANGING * flip)[OPPOSITE]), (poses * flip)[:, OPPOSITE])
    mirror = np.array([-1.0, 1, 1, 1])[:, None] * flip
    assert_allclose(theirs[:, np.r_[:3, 9:15, 3:9]], ours * mirror, atol=1e-9)


@pytest.mark.parametrize("raised", [[1, 0.02, 0.02], [0.02, 0.02, 1], [0.5, 0.1, -0.4]])
def test_an_arm_that_is_raised_from_hanging_to_straight_up_and_round_does_not_flip(raised):
    """Up is opposite to the rest direction: the least rotation between them is undefined there."""
    keys = np.array([[0.05, -1, 0], raised, [0.01, 1, 0], [-0.3, 1, -0.2], [0.3, 1, 0.2], raised, [0.05, -1, 0]])
    keys = keys / np.linalg.norm(keys, axis=1)[:, None]
    way = np.concatenate([a + np.linspace(0, 1, 60)[:, None] * (b - a) for a, b in itertools.pairwise(keys)])
    poses = [with_arms(HANGING, [d, d, d], [d * [-1, 1, 1]] * 3) for d in way]
    motion = LimbMotion(character(HANGING), SIDES, HANGING)
    motions = play(motion, poses)
    unit = way / np.linalg.norm(way, axis=1)[:, None]
    fastest = np.arccos(np.clip((unit[1:] * unit[:-1]).sum(axis=1), -1, 1)).max()
    assert largest_step(motions) < fastest + 0.12
    for pose, now in zip(poses, motions, strict=True):
        assert_allclose(directions(motion, now)[0], wanted(motion, pose), atol=1e-12)


@pytest.mark.parametrize("gain", [0.5, -0.7, 2.0])
def test_a_gain_scales_the_angle_against_the_trunk_of_limbs_that_turn_and_of_limbs_that_point(gain):
    """A tail that points backwards swings about the upright axis as an arm does that is held forwards; a head nods."""
    joints = tuple((AT[joint],) for joint in ("shoulder_left", "elbow_left", "wrist_left"))
    tail = Limb("tail", np.array([[0, 0, 0], [0, 0, -1.0], [0, 0, -2.0]]), joints, "turn", gain, "trunk")
    head = limb(HANGING, "head", "shoulder_center", "head", gain=gain)
    trunk = limb(HANGING, "trunk", "hip_center", "spine", "shoulder_center")
    forwards, turn, nod = [[0, 0, 1]] * 3, Rotation.from_rotvec([0.2, 1.0, -0.1]), Rotation.from_rotvec([0.6, 0, 0])
    rest, neck = with_arms(HANGING, forwards, forwards), HANGING[AT["shoulder_center"]]
    motion = LimbMotion([trunk, tail, head], SIDES, rest)
    for k, angle in enumerate(np.linspace(0, 1.2, 20)):
        pose = with_arms(HANGING, [[np.sin(angle), 0, np.cos(angle)]] * 3, forwards)
        pose[AT["head"]] = neck + nod.apply(HANGING[AT["head"]] - neck)
        motions = motion.step(k * TICK, turn.apply(pose), TRACKED)
    swung, nodded = (turn * Rotation.from_rotvec(gain * np.array(by)) for by in ([0, angle, 0], [0.6, 0, 0]))
    assert_allclose(turns(motions), [each.as_matrix() for each in (turn, turn, swung, swung, nodded)], atol=1e-12)


def test_without_a_trunk_limbs_do_not_turn_with_the_performer():
    arm = limb(T_POSE, "arm", "shoulder_left", "elbow_left", "wrist_left", parent=None)
    turn = Rotation.from_rotvec([0, 2.0, 0]).as_matrix()
    motions = LimbMotion([arm], SIDES, HANGING).step(0.0, CROSSED @ turn.T, TRACKED)
    assert_allclose(motions, LimbMotion([arm], SIDES, HANGING).step(0.0, CROSSED, TRACKED), atol=1e-12)


def test_parents_come_first_and_limbs_hang_on_the_nearest_bone_of_theirs_whatever_the_order():
    limbs = parents_first([limb(T_POSE, "hat", "shoulder_center", "head", parent="head"), *character(T_POSE)[::-1]])
    bones = [(each.name, k) for each in limbs for k in range(len(each.points) - 1)]
    parents = bones_of(limbs).parents
    assert (parents < np.arange(len(bones))).all()
    on = {name: parent >= 0 and bones[parent] for (name, k), parent in zip(bones, parents, strict=True) if k == 0}
    arms, legs = (
        dict.fromkeys(("left arm", "right arm"), ("trunk", 1)),
        dict.fromkeys(("left leg", "right leg"), ("trunk", 0)),
    )
    assert on == {"trunk": False, "head": ("trunk", 1), "hat": ("head", 0)} | arms | legs
    with pytest.raises(ValueError, match="root"):
        parents_first([limb(T_POSE, "a", "head", "spine", parent="b"), limb(T_POSE, "b", "head", "spine", parent="a")])


def test_feet_are_level_where_the_performers_are_and_the_back_is_straight_whatever_their_joints_are_at():
    """The joint of this performer's foot is nearly below the ankle; it heads 30° to the left and rises by 30°."""
    low, step = HANGING.copy(), HANGING.copy()
    low[AT["spine"]] = [0, 0.05, -0.04]  # as measured by Kinect v1
    c, s = np.cos(np.radians(15)), np.sin(np.radians(15))
    for side in ("left", "right"):
        low[AT[f"foot_{side}"]] = low[AT[f"ankle_{side}"]] + [0, -0.09, 0.09]
        step[AT[f"foot_{side}"]] = step[AT[f"ankle_{side}"]] + 0.1 * np.array([0.5 * c, -s, np.sqrt(0.75) * c])
    motion = LimbMotion(character(T_POSE), SIDES, low)
    foot = 8
    still = play(motion, [low] * 60)[-1]
    assert_allclose(turns(still)[:2], [np.eye(3)] * 2, atol=1e-12)
    level = directions(motion, still)[0][foot]
    rest = motion.bones.tails[foot] - motion.bones.heads[foot]
    at_rest = np.arctan2(rest[1], np.hypot(rest[0], rest[2]))
    assert_allclose(level, [0, np.sin(at_rest), np.cos(at_rest)], atol=1e-9)
    up = at_rest + np.radians(30)
    raised = directions(motion, play(motion, [step] * 60, start=2.0)[-1])[0][foot]
    assert_allclose(raised, [0.5 * np.cos(up), np.sin(up), np.sqrt(0.75) * np.cos(up)], atol=1e-9)


def test_after_a_cut_an_orientation_across_its_bone_does_not_count():
    """The bones point as the performer's do, whose arms are raised although their orientations are as before."""
    motion, raised = in_t_pose(), body(0.5, 0.19, 0.09, 0.28, 0.26, 0.09, [0.1, 1, 0.03])
    known = np.tile([1.0, 0, 0, 0], (len(AT), 1))
    motion.step(0, HANGING, TRACKED, orientations=known)
    cut = motion.restarted()
    assert_allclose(
        directions(cut, cut.step(1, raised, TRACKED, orientations=known))[0], wanted(cut, raised), atol=1e-9
    )
