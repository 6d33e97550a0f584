import itertools
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture.skeleton import JOINT_INDEX, JOINTS
from engine_bridge.performance.retargeting import PERFORMER
from engine_bridge.puppet.puppet import CharacterTable, LimbTable, Puppet
from engine_bridge.rigging.humanoid import humanoid_of, is_humanoid
from solver.motion.limb_motion import LimbMotion

from ..bones import in_world

HALF = math.sqrt(0.5)
TRACKED = np.ones(len(JOINTS), dtype=np.float32)
LEFT, DOWN = np.array([1, 0, 0]), np.array([0, -1, 0])
CHAINS = {
    "trunk": ("hip_center", "spine", "shoulder_center"),
    "head": ("shoulder_center", "head"),
    "left arm": ("shoulder_left", "elbow_left", "wrist_left", "hand_left"),
    "right arm": ("shoulder_right", "elbow_right", "wrist_right", "hand_right"),
    "left leg": ("hip_left", "knee_left", "ankle_left", "foot_left"),
    "right leg": ("hip_right", "knee_right", "ankle_right", "foot_right"),
    "tail": ("hip_center", "ankle_left"),
}
NAMES = {
    "trunk": "Hips Spine",
    "head": "Neck",
    "left arm": "LeftUpperArm LeftLowerArm LeftHand",
    "right arm": "RightUpperArm RightLowerArm RightHand",
    "left leg": "LeftUpperLeg LeftLowerLeg",
    "right leg": "RightUpperLeg RightLowerLeg",
}
BONES = {
    bone: ends
    for limb, names in NAMES.items()
    for bone, ends in zip(names.split(), itertools.pairwise(CHAINS[limb]), strict=False)
}
"""Joints at the ends of each bone."""

T_POSE = {
    bone: (0, -1, 0) if "Leg" in bone else (-1, 0, 0) if "Left" in bone else (1, 0, 0) if "Right" in bone else (0, 1, 0)
    for bone in BONES
}
"""Directions of the bones in VRM's T-pose, in Unity's axes."""


def body(arm=(1, 0, 0), forearm=None, thigh=(0, -1, 0), shin=(0, -1, 0), foot=(0, -0.5, 0.9), sizes=1.0):
    """A symmetric body (20, 3), character axes: directions of its left limbs."""
    places = {"hip_center": [0, 1, 0], "spine": [0, 1.2, 0], "shoulder_center": [0, 1.5, 0], "head": [0, 1.75, 0]}
    forearm = arm if forearm is None else forearm
    limbs = (
        ("shoulder elbow wrist hand", [0.2, 1.45, 0], (arm, forearm, forearm), (0.3 * sizes, 0.25, 0.1)),
        ("hip knee ankle foot", [0.1, 0.95, 0], (thigh, shin, foot), (0.45, 0.4 * sizes, 0.15)),
    )
    for joints, start, directions, lengths in limbs:
        steps = [np.array(way) * length / np.linalg.norm(way) for way, length in zip(directions, lengths, strict=True)]
        chain = np.cumsum([start, *steps], axis=0)
        for side, sign in (("left", 1), ("right", -1)):
            for joint, point in zip(joints.split(), chain, strict=True):
                places[f"{joint}_{side}"] = point * [sign, 1, 1]
    return np.array([places[joint] for joint in JOINTS], dtype=np.float64)


T_POSED, A_POSED = body(), body(arm=(1, -1, 0), sizes=0.7)
HANGING = body(arm=(0.1, -1, 0), forearm=(0.05, -1, 0.4), thigh=(0.1, -1, 0))


def puppet(pose, turned=(), names=tuple(CHAINS), scale=1.0, up="y", front="z"):
    """A puppet whose limbs are the bones of a body."""
    character = CharacterTable(mesh="body.glb", up=up, front=front, scale=scale)
    places = pose @ character.basis / scale
    limbs = [
        LimbTable(
            name=name,
            points=tuple(tuple(places[JOINT_INDEX[joint]].tolist()) for joint in CHAINS[name]),
            joints=CHAINS[name],
            follow="turn" if name in turned else "direction",
        )
        for name in names
    ]
    return Puppet(character=character, limb=tuple(limbs))


def posed(made, *performances):
    """The humanoid, and its pose in the last frame."""
    motion = LimbMotion(made.limbs, PERFORMER, T_POSED, made.character.basis)
    for number, pose in enumerate(performances):
        motions = motion.step(number / 30, pose, TRACKED)
    return *at_rest(made, motions), motions


def at_rest(made, motions=None, root=(0, 0, 0)):
    """The humanoid, whose floor is at 0, and its pose without motions."""
    humanoid = humanoid_of(made, np.zeros((1, 3)))
    still = np.tile(np.eye(4, 3), (64, 1, 1))
    return humanoid, *humanoid.pose(still if motions is None else motions, np.array(root, dtype=float))


def turn_of(made, name):
    """The rotation vector of a bone at rest, in degrees."""
    humanoid, _, rotations = at_rest(made)
    return Rotation.from_quat(rotations[humanoid.names.index(name)]).as_rotvec(degrees=True)


@pytest.mark.parametrize(
    ("rest", "left", "right"),
    [
        (T_POSED, (0, HALF, 0, HALF), (0, -HALF, 0, HALF)),
        (body(arm=(0, -1, 0)), (-0.5, 0.5, 0.5, 0.5), (-0.5, -0.5, -0.5, 0.5)),
    ],
    ids=["raised from the side", "raised from below"],
)
def test_arms_held_forwards_and_a_seat_are_known_quaternions(rest, left, right):
    """Hanging arms rotate about z and then about x, as the character's arms do, so that the thumbs point up."""
    humanoid, _, rotations, _ = posed(puppet(rest), body(arm=(0, 0, 1), thigh=(0, 0, 1)))
    expected = dict.fromkeys(humanoid.names, (0, 0, 0, 1)) | {
        "LeftUpperArm": left,
        "RightUpperArm": right,
        "LeftUpperLeg": (-HALF, 0, 0, HALF),
        "RightUpperLeg": (-HALF, 0, 0, HALF),
        "LeftLowerLeg": (HALF, 0, 0, HALF),
        "RightLowerLeg": (HALF, 0, 0, HALF),
    }
    assert_allclose(rotations, list(expected.values()), atol=1e-6)


@pytest.mark.parametrize("rest", [T_POSED, A_POSED, HANGING], ids=["T", "A", "hanging"])
@pytest.mark.parametrize("axes", [{}, {"up": "z", "front": "-y", "scale": 0.01}], ids=["y up", "z up, centimetres"])
def test_a_performer_in_a_t_pose_turns_no_bone_whatever_the_rest_pose_of_the_character(rest, axes):
    humanoid, _, rotations, _ = posed(puppet(rest, **axes), T_POSED)
    assert len(humanoid.names) == 21
    assert BONES.keys() <= set(humanoid.names)
    assert_allclose(rotations, np.tile([0, 0, 0, 1], (21, 1)), atol=1e-7)


def test_a_t_posed_body_that_leans_at_rest_turns_its_hips_alone():
    """Soles are flat nevertheless."""
    lean = Rotation.from_rotvec([0.5, 0, 0.3])
    humanoid, _, rotations = at_rest(puppet(lean.apply(T_POSED)))
    expected = {name: (0, 0, 0, 1) for name in humanoid.names if not name.endswith(("Foot", "Toes"))}
    expected["Hips"] = Rotation.from_rotvec([0.5, 0, -0.3]).as_quat()  # x points to the other side
    found = dict(zip(humanoid.names, rotations, strict=True))
    assert_allclose([found[name] for name in expected], list(expected.values()), atol=1e-9)


def random_poses(rng, count=20):
    """Bodies in poses that follow each other without jumps."""
    phases, speeds = rng.uniform(0, 6, (2, 5, 3)) * [[[1]], [[0.3]]]
    for step in range(count):
        arm, forearm, thigh, shin, tilt = np.sin(phases + 0.1 * step * speeds)
        bent = body(arm + LEFT, forearm, thigh / 2 + DOWN, shin / 2 + DOWN)
        yield Rotation.from_rotvec(0.4 * tilt).apply(bent)


def test_bones_lie_and_point_as_the_characters_do_in_any_pose():
    rng = np.random.default_rng(3)
    for rest, scale in ((T_POSED, 1.0), (A_POSED, 0.01), (HANGING, 2.0)):
        made = puppet(rest, scale=scale, up="z", front="-x")
        humanoid, positions, rotations, motions = posed(made, *random_poses(rng))
        assert_allclose(positions, at_rest(made)[1], atol=1e-9)
        frames = in_world(humanoid, positions, rotations)
        to_unity = np.diag([-1, 1, 1]) @ made.character.basis * scale
        hips = np.array([0, 1, 0])  # above the floor; the origin is below them
        moves, joints = iter(motions), {}
        for limb in made.limbs:
            ends = zip(CHAINS[limb.name], limb.points, strict=True)
            for bone, move in zip(itertools.pairwise(ends), moves, strict=False):
                joints = {joint: to_unity @ (np.append(point, 1) @ move) for joint, point in bone} | joints
        origin = to_unity @ made.limbs[0].points[0] - hips
        for bone, (tail, head) in BONES.items():
            assert_allclose(frames[bone][0], joints[tail] - origin, atol=1e-9)
            along = (joints[head] - joints[tail]) / np.linalg.norm(joints[head] - joints[tail])
            assert_allclose(frames[bone][1].apply(T_POSE[bone]), along, atol=1e-7)


def test_the_hips_alone_carry_the_root_in_metres():
    made = puppet(A_POSED, scale=0.01, up="z", front="-y")
    _, resting, _ = at_rest(made)
    _, moved, _ = at_rest(made, root=(100, 200, 300))  # left, backwards, up
    assert_allclose(moved[0] - resting[0], (-1, 3, -2))
    assert_allclose(moved[1:], resting[1:], atol=1e-12)


def test_at_rest_soles_are_flat_elbows_are_not_twisted_and_backs_that_turn_are_straight():
    humanoid, positions, rotations = at_rest(puppet(body(thigh=(0.3, -1, 0), foot=(1, -2, 1))))
    _, foot = in_world(humanoid, positions, rotations)["LeftFoot"]
    assert_allclose(foot.as_rotvec(degrees=True), (0, -45, 0), atol=1e-9)
    assert_allclose(turn_of(puppet(body(foot=(0, -1, 0.01))), "LeftFoot"), 0, atol=1e-9)
    elbow = turn_of(puppet(HANGING), "LeftLowerArm")
    bend = math.degrees(math.acos(np.dot((0.1, -1, 0), (0.05, -1, 0.4)) / math.sqrt(1.01 * 1.1625)))
    assert np.linalg.norm(elbow) == pytest.approx(bend)
    assert elbow[0] == pytest.approx(0, abs=1e-9)  # x is along the arm
    bent = T_POSED.copy()
    bent[JOINT_INDEX["head"]] = bent[JOINT_INDEX["shoulder_center"]] + [0, 0.1, 0.1]
    assert_allclose(turn_of(puppet(bent), "Neck"), (45, 0, 0), atol=1e-9)
    assert_allclose(turn_of(puppet(bent, turned=("head",)), "Neck"), 0, atol=1e-9)
    upside_down = turn_of(puppet(body(thigh=(0, 1, 0), shin=(0, 1, 0))), "LeftUpperLeg")
    assert_allclose(np.abs(upside_down), (0, 0, 180), atol=1e-9)  # about the forward axis


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        (("trunk", "left arm"), True),
        (("trunk", "right leg"), True),
        (("trunk", "head"), False),
        (("left arm", "right arm"), False),
    ],
)
def test_a_humanoid_has_a_trunk_and_an_arm_or_a_leg(names, expected):
    assert is_humanoid(puppet(T_POSED, names=names)) is expected
