import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.body import ANKLE_HEIGHT_METRES
from capture.skeleton import JOINT_INDEX, to_character_axes
from engine_bridge.export.performer.motion import FLOOR_PERCENTILE, motion_of

from .conftest import OF_JOINTS, joints_of, timeline_of


def kinect_joints(places, frame):
    """Return the Kinect's joints (20, 3) of a written motion in a frame."""
    pose = np.empty((20, 3))
    for joint, bone in OF_JOINTS.items():
        pose[JOINT_INDEX[joint]] = places[bone][frame]
    for side in ("left", "right"):
        pose[JOINT_INDEX[f"hand_{side}"]] = places[f"{side}Hand_end"][frame]
        pose[JOINT_INDEX[f"foot_{side}"]] = places[f"{side}Foot_end"][frame]
    pose[JOINT_INDEX["head"]] = (places["head"][frame] + places["head_end"][frame]) / 2
    return pose


@pytest.mark.parametrize("frame", [20, 90, 150, 230])
def test_a_performer_with_constant_bones_is_followed_exactly(motion, places, frame):
    # first the T-pose, which has all lengths, and long enough in the pose for the smoothing to arrive there
    rest, pose = motion.body.pose, kinect_joints(places, frame)
    poses = np.concatenate([np.tile(rest, (201, 1, 1)), np.tile(pose, (150, 1, 1))])
    found = joints_of(motion_of(timeline_of(poses), to_character_axes(rest[0])))
    written = kinect_joints(found, -1)
    assert_allclose(written - written[0], pose - pose[0], atol=2e-3)
    before = kinect_joints(found, 150)
    assert_allclose(before - before[0], rest - rest[0], atol=1e-6)


def test_hips_travel_as_the_performers_do_and_begin_above_the_origin(kung_fu):
    timeline, motion = kung_fu
    assert_allclose(motion.hips[0, [0, 2]], 0, atol=1e-12)
    hips = to_character_axes(timeline.positions[:, 0])
    apart = (motion.hips - motion.hips[0]) - (hips - hips[0])
    assert np.linalg.norm(apart, axis=1).max() < 0.03  # what the smoothing may change


def test_low_ankles_are_at_their_height_above_the_floor(places):
    low = np.minimum(places["leftFoot"][:, 1], places["rightFoot"][:, 1])
    assert np.percentile(low, FLOOR_PERCENTILE) == pytest.approx(ANKLE_HEIGHT_METRES)


def test_neighbouring_quaternions_have_the_same_sign_and_unit_length(motion):
    assert (np.einsum("fnc,fnc->fn", motion.rotations[1:], motion.rotations[:-1]) > 0).all()
    assert_allclose(np.linalg.norm(motion.rotations, axis=2), 1)
