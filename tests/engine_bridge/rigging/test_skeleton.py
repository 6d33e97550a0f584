import numpy as np
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from engine_bridge.puppet.puppet import CharacterTable, HandleTable, LimbTable, Puppet
from engine_bridge.rigging.skeleton import Skeleton

from ..bones import in_world, points

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
    axes = skeleton.axes[[skeleton.names.index(name) for name in ("leftUpperArm", "leftLowerArm", "leftHand")]]
    assert_allclose(axes[:, :, 1], [[1, 0, 0], [0, 0, 1], [-1, 0, 0]], atol=1e-12)
    bending = axes[:, :, 0]
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
