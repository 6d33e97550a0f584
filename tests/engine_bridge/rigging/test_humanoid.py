import itertools
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture.skeleton import JOINT_INDEX, JOINTS
from engine_bridge.performance.retargeting import PERFORMER
from engine_bridge.puppet.puppet import CharacterTable, LimbTable, Puppet
from engine_bridge.rigging.humanoid import humanoid_of, is_humanoid
from solver.motion.limb_motion import LimbMotion

HALF = math.sqrt(0.5)
TRACKED = np.ones(len(JOINTS), dtype=np.float32)
STILL = np.zeros(3)
LEFT, DOWN = np.array([1, 0, 0]), np.array([0, -1, 0])
CHAINS = {
    "trunk": ("hip_center", "spine", "shoulder_center"),
    "head": ("shoulder_center", "head"),
    **{
        f"{side} {limb}": tuple(f"{joint}_{side}" for joint in joints)
        for side in ("left", "right")
        for limb, joints in {
            "arm": ("shoulder", "elbow", "wrist", "hand"),
            "leg": ("hip", "knee", "ankle", "foot"),
        }.items()
    },
}
SIDED_BONES = {
    "UpperArm": ("shoulder", "elbow"),
    "LowerArm": ("elbow", "wrist"),
    "Hand": ("wrist", "hand"),
    "UpperLeg": ("hip", "knee"),
    "LowerLeg": ("knee", "ankle"),
}
BONES = {
    **{
        f"{side.title()}{bone}": (f"{start}_{side}", f"{end}_{side}")
        for side in ("left", "right")
        for bone, (start, end) in SIDED_BONES.items()
    },
    "Hips": ("hip_center", "spine"),
    "Spine": ("spine", "shoulder_center"),
    "Neck": ("shoulder_center", "head"),
}
"""Joints at the ends of each bone."""

T_POSE = {
    **dict.fromkeys(("Hips", "Spine", "Neck"), (0, 1, 0)),
    **{f"Left{bone}": (-1, 0, 0) for bone in ("UpperArm", "LowerArm", "Hand")},
    **{f"Right{bone}": (1, 0, 0) for bone in ("UpperArm", "LowerArm", "Hand")},
    **{f"{side}{bone}": (0, -1, 0) for side in ("Left", "Right") for bone in ("UpperLeg", "LowerLeg")},
}
"""Directions of the bones in VRM's T-pose, in Unity's axes."""

EVERY_BONE = {"Hips", "Spine", "Chest", "Neck", "Head"} | {
    f"{side}{bone}"
    for side in ("Left", "Right")
    for bone in ("Shoulder", "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot", "Toes")
}


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


def posed(made, *performances, rest=T_POSED):
    """The humanoid, and its pose in the last frame."""
    motion = LimbMotion(made.limbs, PERFORMER, rest, made.character.basis)
    for number, pose in enumerate(performances):
        motions = motion.step(number / 30, pose, TRACKED)
    humanoid = humanoid_of(made, floor(made))
    return humanoid, *humanoid.pose(motions, STILL), motions


def at_rest(made):
    humanoid = humanoid_of(made, floor(made))
    return humanoid, *humanoid.pose(np.tile(np.eye(4, 3), (64, 1, 1)), STILL)


def floor(made):
    """One vertex on the ground."""
    return np.zeros((1, 3))


def turns(humanoid, rotations):
    return {name: Rotation.from_quat(q) for name, q in zip(humanoid.names, rotations, strict=True)}


def in_world(humanoid, positions, rotations):
    """Forward kinematics, by scipy: the frames of the bones in Unity's world."""
    frames = {}
    for joint, place, turn in zip(humanoid.joints, positions, turns(humanoid, rotations).values(), strict=True):
        above = humanoid.joints[joint.parent].name if joint.parent >= 0 else None
        start, base = frames.get(above, (np.zeros(3), Rotation.identity()))
        frames[joint.name] = start + base.apply(place), base * turn
    return frames


def angle(a, b):
    return math.degrees(math.atan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


@pytest.mark.parametrize("rest", [T_POSED, A_POSED, HANGING], ids=["T", "A", "hanging"])
@pytest.mark.parametrize("axes", [{}, {"up": "z", "front": "-y", "scale": 0.01}], ids=["y up", "z up, centimetres"])
def test_a_performer_in_a_t_pose_turns_no_bone_whatever_the_rest_pose_of_the_character(rest, axes):
    humanoid, _, rotations, _ = posed(puppet(rest, **axes), T_POSED)
    assert set(humanoid.names) == EVERY_BONE
    np.testing.assert_allclose(rotations, np.tile([0, 0, 0, 1], (21, 1)), atol=1e-7)


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
    np.testing.assert_allclose(rotations, list(expected.values()), atol=1e-6)


def test_a_body_that_turns_to_its_left_turns_the_hips_alone():
    quarter = Rotation.from_euler("y", 90, degrees=True)  # forward +z to left +x
    humanoid, _, rotations, _ = posed(puppet(A_POSED), quarter.apply(T_POSED))
    assert humanoid.names[0] == "Hips"
    np.testing.assert_allclose(rotations[0], (0, -HALF, 0, HALF), atol=1e-7)
    np.testing.assert_allclose(rotations[1:], np.tile([0, 0, 0, 1], (20, 1)), atol=1e-7)


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
        frames = in_world(humanoid, positions, rotations)
        to_unity = np.diag([-1, 1, 1]) @ made.character.basis * scale
        hips = np.array([0, 1, 0])  # above the floor; the origin is below them
        row, joints = 0, {}
        for limb in made.limbs:
            for number, (tail, head) in enumerate(itertools.pairwise(CHAINS[limb.name])):
                for joint, point in ((tail, limb.points[number]), (head, limb.points[number + 1])):
                    joints.setdefault(joint, to_unity @ (np.append(point, 1) @ motions[row]))
                row += 1
        origin = to_unity @ made.limbs[0].points[0] - hips
        for bone, (tail, head) in BONES.items():
            np.testing.assert_allclose(frames[bone][0], joints[tail] - origin, atol=1e-9)
            along = joints[head] - joints[tail]
            assert angle(frames[bone][1].apply(T_POSE[bone]), along) < 1e-5


def test_places_are_the_characters_own_in_metres_and_do_not_depend_on_the_pose():
    rng = np.random.default_rng(4)
    made = puppet(A_POSED, scale=0.01)
    humanoid, resting, _ = at_rest(made)
    places = dict(zip(humanoid.names, resting, strict=True))
    np.testing.assert_allclose(places["Hips"], (0, 1, 0), atol=1e-9)
    np.testing.assert_allclose(places["LeftLowerArm"], (-0.21, 0, 0), atol=1e-9)
    np.testing.assert_allclose(places["RightHand"], (0.25, 0, 0), atol=1e-9)
    np.testing.assert_allclose(places["LeftFoot"], (0, -0.28, 0), atol=1e-9)
    np.testing.assert_allclose(places["LeftUpperLeg"], (-0.1, -0.05, 0), atol=1e-9)
    np.testing.assert_allclose(places["LeftShoulder"] + places["LeftUpperArm"], (-0.2, 0.1, 0), atol=1e-9)
    _, positions, _, _ = posed(made, *random_poses(rng))
    np.testing.assert_allclose(positions, resting, atol=1e-9)


def test_the_hips_carry_the_root():
    made = puppet(T_POSED, scale=0.5, up="z", front="-y")
    humanoid = humanoid_of(made, floor(made))
    still = np.tile(np.eye(4, 3), (64, 1, 1))
    before, _ = humanoid.pose(still, STILL)
    after, _ = humanoid.pose(still, np.array([1.0, 2.0, 3.0]))  # left, backwards, up
    np.testing.assert_allclose(after[0] - before[0], (-0.5, 1.5, -1.0))
    np.testing.assert_allclose(after[1:], before[1:])


def test_a_bent_arm_at_rest_has_no_twist_in_its_elbow():
    humanoid, _, rotations = at_rest(puppet(HANGING))
    elbow = turns(humanoid, rotations)["LeftLowerArm"]
    assert math.degrees(elbow.magnitude()) == pytest.approx(angle((0.1, -1, 0), (0.05, -1, 0.4)))
    assert elbow.as_quat()[0] == pytest.approx(0, abs=1e-12)  # x is along the arm


def test_soles_are_flat_at_rest_and_feet_keep_their_heading():
    humanoid, positions, rotations = at_rest(puppet(body(thigh=(0.3, -1, 0), foot=(1, -2, 1))))
    _, foot = in_world(humanoid, positions, rotations)["LeftFoot"]
    np.testing.assert_allclose(foot.as_rotvec(degrees=True), (0, -45, 0), atol=1e-9)
    straight_down = body(foot=(0, -1, 0.01))
    humanoid, _, rotations = at_rest(puppet(straight_down))
    assert turns(humanoid, rotations)["LeftFoot"].magnitude() == pytest.approx(0)


def test_a_bent_back_that_follows_directions_is_bent_at_rest_and_one_that_turns_is_not():
    bent = T_POSED.copy()
    bent[JOINT_INDEX["head"]] = bent[JOINT_INDEX["shoulder_center"]] + [0, 0.1, 0.1]
    humanoid, _, rotations = at_rest(puppet(bent))
    np.testing.assert_allclose(turns(humanoid, rotations)["Neck"].as_rotvec(degrees=True), (45, 0, 0), atol=1e-9)
    humanoid, _, rotations = at_rest(puppet(bent, turned=("head",)))
    assert turns(humanoid, rotations)["Neck"].magnitude() == pytest.approx(0)


def limb(name, *points):
    return LimbTable(name=name, points=points, joints=JOINTS[: len(points)])


def test_names_beyond_a_limbs_bones_are_along_its_last_one_and_turn_with_it():
    made = Puppet(
        character=CharacterTable(mesh="body.glb"),
        limb=(
            limb("trunk", (0, 1, 0), (0, 1.6, 0)),
            limb("neck", (0, 1.6, 0), (0, 1.8, 0)),
            limb("head", (0, 1.8, 0), (0, 2, 0)),
            limb("left arm", (0.2, 1.6, 0), (0.5, 1.6, 0), (0.9, 1.6, 0)),
            limb("tail", (0, 1, -0.1), (0, 1, -1)),
        ),
    )
    humanoid, positions, rotations = at_rest(made)
    places = {name: place.tolist() for name, place in zip(humanoid.names, positions, strict=True)}
    assert places == {
        "Hips": pytest.approx([0, 1, 0]),
        "Spine": pytest.approx([0, 0.2, 0]),
        "Chest": pytest.approx([0, 0.2, 0]),
        "Neck": pytest.approx([0, 0.2, 0]),
        "Head": pytest.approx([0, 0.2, 0]),
        "LeftShoulder": pytest.approx([-0.05, 0.2, 0]),
        "LeftUpperArm": pytest.approx([-0.15, 0, 0]),
        "LeftLowerArm": pytest.approx([-0.3, 0, 0]),
        "LeftHand": pytest.approx([-0.4, 0, 0]),
    }
    np.testing.assert_allclose(rotations, np.tile([0, 0, 0, 1], (9, 1)), atol=1e-12)
    bones = dict(zip(humanoid.names, humanoid.bones.tolist(), strict=True))
    assert bones["LeftHand"] == bones["LeftLowerArm"] == bones["LeftUpperArm"] + 1
    assert bones["Chest"] == bones["Hips"] == 0


def test_limbs_that_point_the_other_way_at_rest_are_turned_about_the_forward_axis():
    upside_down = puppet(body(thigh=(0, 1, 0), shin=(0, 1, 0)))
    humanoid, _, rotations = at_rest(upside_down)
    np.testing.assert_allclose(abs(turns(humanoid, rotations)["LeftUpperLeg"].as_quat()), (0, 0, 1, 0), atol=1e-9)


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
