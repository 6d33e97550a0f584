"""Placed joints are compared with the known joints of a body in front of a lens."""

import numpy as np
import pytest

from capture import body
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, OPPOSITE, PARENTS, TRACKED
from capture.trackers.joint_depth import SKIN_TO_JOINT_METRES
from capture.trackers.picture import Lens
from capture.trackers.placing import BodyPlacer, distance_of

LENS = Lens(640, 480, 525.0)
TRACKED_ALL = np.full(20, TRACKED, np.float32)
HAND, HEAD, KNEE = (JOINT_INDEX[joint] for joint in ("hand_left", "head", "knee_right"))

_DIRECTIONS = {
    "spine": (0, 1, 0.1),
    "shoulder_center": (0, 1, -0.05),
    "head": (0, 1, -0.1),
    "shoulder": (1, -0.2, 0),
    "elbow": (1, -0.5, -0.3),
    "wrist": (0.3, 0.6, -0.8),
    "hand": (0, 1, -0.5),
    "hip": (1, -0.6, 0),
    "knee": (0.2, -1, -0.3),
    "ankle": (0, -1, 0.2),
    "foot": (0.3, -0.4, -1),
}


@pytest.fixture
def truth():
    """A body of usual proportions with bent limbs, 2.5 m away; its sides have equal lengths, but different poses."""
    joints = np.zeros((20, 3))
    joints[0] = 0.3, 0.1, 2.5
    for joint, parent in PARENTS.items():
        name, _, side = joint.partition("_") if joint.endswith(("_left", "_right")) else (joint, "", "")
        direction = np.array(_DIRECTIONS[name]) * ((-1, 1, 1) if side == "left" else (1, 1, 0.7))
        length = body.typical_bone_length(joint)
        joints[JOINT_INDEX[joint]] = joints[JOINT_INDEX[parent]] + direction * (length / np.linalg.norm(direction))
    return joints


def posture_of(joints):
    """Return the best possible estimate of a tracker, in metres of another scale."""
    return (joints - joints[0]) / 1.2


def bones(joints):
    return np.array([np.linalg.norm(joints[JOINT_INDEX[a]] - joints[JOINT_INDEX[b]]) for a, b in PARENTS.items()])


def depth_of(joints, wall=4.5, without=()):
    """Return a depth image, in metres, of a disc of skin for each joint in front of a wall."""
    depth = np.full((LENS.height, LENS.width), wall, np.float32)
    rows, columns = np.indices(depth.shape)
    for joint in np.argsort(-joints[:, 2]):
        if joint not in without:
            column, row = LENS.project(joints[joint])
            disc = np.hypot(columns - column, rows - row) < 0.05 * LENS.focal / joints[joint, 2]
            depth[disc] = round(joints[joint, 2] - SKIN_TO_JOINT_METRES[joint], 3)
    return depth


@pytest.mark.parametrize("place", [(0.0, 0.0, 2.0), (0.8, -0.3, 3.5), (-1.5, 0.4, 1.2)])
def test_the_distance_of_a_posture_is_exact(truth, place):
    posture = truth - truth[0]
    joints = posture + place
    assert distance_of(posture, joints / joints[:, 2:], np.linspace(0.1, 1, 20)) == pytest.approx(place[2], abs=1e-6)


def test_the_height_determines_the_scale_without_depth(truth):
    placing = BodyPlacer(body.height(truth))
    positions, confidence = placing.place(0.0, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL, None)
    np.testing.assert_allclose(positions, truth, atol=1e-5)
    np.testing.assert_array_equal(confidence, TRACKED_ALL)


def test_a_taller_performer_is_farther_away_in_proportion(truth):
    view = 0.0, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL, None
    small, tall = (BodyPlacer(height).place(*view)[0] for height in (1.4, 2.0))
    crown_and_soles = body.HEAD_TOP_METRES + body.ANKLE_HEIGHT_METRES
    np.testing.assert_allclose(tall, small * (2.0 - crown_and_soles) / (1.4 - crown_and_soles))


def test_the_height_is_exact_and_both_sides_are_equal_for_noisy_estimates(truth):
    rng = np.random.default_rng(1)
    placing = BodyPlacer(1.6)
    for k in range(60):
        pixels = LENS.project(truth) + rng.normal(0, 3, (20, 2))
        posture = posture_of(truth) + rng.normal(0, 0.03, (20, 3))
        positions, _ = placing.place(k / 30, LENS, pixels, posture, rng.uniform(0, 1, 20).astype(np.float32), None)
        assert body.height(positions) == pytest.approx(1.6, abs=1e-9)
        lengths = np.zeros(len(JOINTS))
        lengths[1:] = bones(positions)
        np.testing.assert_allclose(lengths, lengths[OPPOSITE], atol=1e-9)


def test_bones_keep_their_lengths_for_noisy_estimates(truth):
    rng = np.random.default_rng(2)
    placing = BodyPlacer(1.7)
    guessed, placed = [], []
    for k in range(90):
        posture = posture_of(truth) + rng.normal(0, 0.02, (20, 3))
        guessed.append(bones(posture))
        placed.append(bones(placing.place(k / 30, LENS, LENS.project(truth), posture, TRACKED_ALL, None)[0]))
    spread = [np.ptp(lengths[30:], axis=0) / np.median(lengths, axis=0) for lengths in (guessed, placed)]
    assert np.median(spread[0]) > 0.25
    assert spread[1].max() < 0.1


def test_the_estimated_distance_is_smoothed_with_a_time_constant_of_0_1_s(truth):
    placing = BodyPlacer(body.height(truth))
    farther = truth + np.array([0, 0, 1.2])
    placing.place(0.0, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL, None)
    for k in range(1, 7):
        positions, _ = placing.place(k / 20, LENS, LENS.project(farther), posture_of(truth), TRACKED_ALL, None)
    assert positions[0, 2] == pytest.approx(farther[0, 2] - 1.2 * np.exp(-3), abs=1e-3)


def test_depth_places_joints_exactly_whatever_the_height(truth):
    placing = BodyPlacer(1.2)
    positions, confidence = placing.place(
        0.0, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL, depth_of(truth)
    )
    np.testing.assert_array_equal(confidence, TRACKED_ALL)
    np.testing.assert_allclose(positions, truth, atol=1e-3)


def test_a_joint_without_depth_is_inferred_at_its_estimate(truth):
    depth = depth_of(truth, without=[HAND])
    column, row = LENS.project(truth[HEAD]).astype(int)
    depth[row - 60 : row + 20, column - 40 : column + 40] = 1.0  # an object in front of the face
    positions, confidence = BodyPlacer(1.7).place(0.0, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL, depth)
    expected = TRACKED_ALL.copy()
    expected[[HAND, HEAD]] = INFERRED
    np.testing.assert_array_equal(confidence, expected)
    np.testing.assert_allclose(positions, truth, atol=0.01)


def test_a_wall_beside_a_thin_limb_is_ignored(truth):
    depth = depth_of(truth)
    column, row = LENS.project(truth[KNEE]).astype(int)
    depth[row - 20 : row + 20, column + 1 : column + 20] = 4.5
    positions, confidence = BodyPlacer(1.7).place(0.0, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL, depth)
    assert confidence[KNEE] == TRACKED
    np.testing.assert_allclose(positions[KNEE], truth[KNEE], atol=1e-3)


def test_depth_does_not_move_a_hidden_joint(truth):
    hidden = TRACKED_ALL.copy()
    hidden[HAND] = 0.3
    moved = depth_of(truth)
    column, row = LENS.project(truth[HAND]).astype(int)
    moved[row - 8 : row + 9, column - 8 : column + 9] -= 100
    positions, confidence = BodyPlacer(1.7).place(0.0, LENS, LENS.project(truth), posture_of(truth), hidden, moved)
    assert confidence[HAND] == hidden[HAND]
    np.testing.assert_allclose(positions[HAND], truth[HAND], atol=0.01)


def test_an_empty_depth_image_is_like_none(truth):
    view = 0.0, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL
    empty = np.zeros((LENS.height, LENS.width), np.float32)
    for with_it, without in zip(BodyPlacer(1.7).place(*view, empty), BodyPlacer(1.7).place(*view, None), strict=True):
        np.testing.assert_array_equal(with_it, without)


def test_the_scale_from_depth_outlasts_the_depth(truth):
    placing = BodyPlacer(1.2)
    placing.place(0.0, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL, depth_of(truth))
    positions, _ = placing.place(0.1, LENS, LENS.project(truth), posture_of(truth), TRACKED_ALL, None)
    np.testing.assert_allclose(positions, truth, atol=0.01)


def test_pixels_that_no_body_can_have_give_no_result(truth):
    upside_down = LENS.project(truth) * -1
    assert BodyPlacer(1.7).place(0.0, LENS, upside_down, posture_of(truth), TRACKED_ALL, None) is None
    heap = np.full((20, 2), 100.0)
    assert BodyPlacer(1.7).place(0.0, LENS, heap, posture_of(truth), TRACKED_ALL, None) is None
