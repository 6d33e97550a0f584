import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from engine_bridge.puppet.puppet import CharacterTable, HandleTable, LimbTable, Puppet
from engine_bridge.rigging.skeleton import Skeleton, from_t_pose

from ..bones import in_world, points, turned

JOINTS = ("hip_center", "spine", "shoulder_center", "head")


def limb(name, text):
    """Return the table of a limb."""
    places = points(text)
    return LimbTable(name=name, points=tuple(map(tuple, places.tolist())), joints=JOINTS[: len(places)])


A_POSED = Puppet(
    character=CharacterTable(mesh="a.glb"),
    limb=(
        limb("trunk", "0 1 0, 0 1.2 0, 0 1.5 0"),
        limb("left arm", "0.2 1.5 0, 0.4 1.3 0, 0.6 1.1 0, 0.7 1.0 0"),
        limb("right leg", "-0.1 1 0, -0.1 0.5 0, -0.1 0.1 0, -0.2 0 0.1"),
        limb("tail", "0 1 -0.1, 0 0.8 -0.4"),
    ),
    handle=(HandleTable(name="hump", position=(0, 1.3, -0.3)),),
)


def test_at_rest_joints_are_at_their_heads_and_point_to_their_tails():
    skeleton = Skeleton.along_bones(A_POSED)
    posed = in_world(skeleton, *skeleton.rest)
    for joint, (place, turn) in zip(skeleton.joints, posed.values(), strict=True):
        assert_allclose(place, joint.head, atol=1e-12)
        along = joint.tail - joint.head
        assert_allclose(turn.apply([0, np.linalg.norm(along), 0]), along, atol=1e-12)


def test_the_first_z_axis_of_a_limb_is_near_the_front_or_for_bones_that_point_there_near_up():
    skeleton = Skeleton.along_bones(A_POSED)
    axes = dict(zip(skeleton.names, skeleton.axes, strict=True))
    assert_allclose(axes["hips"], np.column_stack([[1, 0, 0], [0, 1, 0], [0, 0, 1]]), atol=1e-12)
    assert_allclose(axes["leftUpperArm"][:, 2], [0, 0, 1], atol=1e-12)
    forward = Puppet(character=CharacterTable(mesh="a.glb"), limb=(limb("nose", "0 0 0, 0 0 1"),))
    assert_allclose(Skeleton.along_bones(forward).axes[0][:, 2], [0, 1, 0], atol=1e-12)
    for each in axes.values():
        assert_allclose(each @ each.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(each) > 0


def test_joints_of_a_limb_bend_about_the_same_axis_even_if_one_bone_points_to_the_front():
    bent = limb("left arm", "1 0 0, 2 0 0, 2 0 1, 1 0 1")
    skeleton = Skeleton.along_bones(Puppet(character=CharacterTable(mesh="a.glb"), limb=(bent,)))
    bending = skeleton.axes[[skeleton.names.index(name) for name in ("leftUpperArm", "leftLowerArm", "leftHand")], :, 0]
    assert_allclose(np.abs(bending), [[0, 1, 0]] * 3, atol=1e-12)
    assert_allclose(bending, bending[[0, 0, 0]], atol=1e-12)


def test_posed_joints_are_where_their_bones_take_them():
    rng = np.random.default_rng(1)
    skeleton = Skeleton.along_bones(A_POSED)
    turns = Rotation.from_rotvec(rng.normal(size=(skeleton.bones.max() + 1, 3)))
    motions = np.concatenate([turns.as_matrix(), rng.normal(size=(len(turns), 1, 3))], axis=1)
    root = np.array([1.0, 2.0, 3.0])
    posed = in_world(skeleton, *skeleton.pose(motions, root))
    for joint, axes, (place, turn) in zip(skeleton.joints, skeleton.axes, posed.values(), strict=True):
        own = motions[joint.bone]
        assert_allclose(place, joint.head @ own[:3] + own[3] + root, atol=1e-9)
        assert_allclose(turn.as_matrix(), own[:3].T @ axes, atol=1e-9)


@pytest.mark.parametrize(("up", "front"), [("y", "z"), ("z", "-y"), ("x", "y")])
def test_the_turn_from_the_t_pose_takes_its_directions_to_those_at_rest_in_character_axes(up, front):
    character = CharacterTable(mesh="a.glb", up=up, front=front)
    lying = turned(A_POSED, character.basis).model_copy(update={"character": character, "handle": ()})
    joints = Skeleton.along_bones(lying).joints
    turns = {joint.name: turn for joint, turn in zip(joints, from_t_pose(lying, joints), strict=True)}
    down_left = np.array([1, -1, 0]) / np.sqrt(2)
    for name in ("leftUpperArm", "leftLowerArm", "leftHand"):
        assert_allclose(turns[name] @ [1, 0, 0], down_left, atol=1e-12)
    for name in ("hips", "chest", "rightUpperLeg", "tail_1", "leftShoulder"):
        assert_allclose(turns[name], np.eye(3), atol=1e-12)
    foot = Rotation.from_matrix(turns["rightFoot"]).as_rotvec(degrees=True)
    assert_allclose(foot, [0, -45, 0], atol=1e-9)
    assert_array_equal(turns["rightToes"], turns["rightFoot"])
