"""Placed joints are compared with the known joints of a body in front of a lens."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture import body
from capture.skeleton import INFERRED, JOINT_INDEX, OPPOSITE, PARENTS

from .. import bodies
from .skin import LENS, TRACKED_ALL, WALL_METRES, drawn

HAND, HEAD, KNEE = (JOINT_INDEX[joint] for joint in ("hand_left", "head", "knee_right"))

WAYS = bodies.table("""
spine           0 1 0.1
shoulder_center 0 1 -0.05
head            0 1 -0.1
shoulder        1 -0.2 0
elbow           1 -0.5 -0.3
wrist           0.3 0.6 -0.8
hand            0 1 -0.5
hip             1 -0.6 0
knee            0.2 -1 -0.3
ankle           0 -1 0.2
foot            0.3 -0.4 -1
""")
TRUTH = bodies.body(WAYS, (0.3, 0.1, 2.5), right=(1, 1, 0.7), typical=True)
"""A body of usual proportions with bent limbs, 2.5 m away; its sides have equal lengths, but different poses."""
POSTURE = (TRUTH - TRUTH[0]) / 1.2
"""The best possible estimate of a tracker, in metres of another scale."""


def bones(joints):
    return np.array([0, *(np.linalg.norm(joints[JOINT_INDEX[a]] - joints[JOINT_INDEX[b]]) for a, b in PARENTS.items())])


def around(joint, up, down, left, right):
    """Return the pixels around a joint's."""
    column, row = LENS.project(TRUTH[joint]).astype(int)
    return np.s_[row - up : row + down, column - left : column + right]


@pytest.fixture(scope="module")
def BodyPlacer(interpreted):  # noqa: N802
    return interpreted("capture.trackers.placing").BodyPlacer


def placed(placer, depth=None, time=0.0, pixels=None, posture=POSTURE, confidence=TRACKED_ALL):
    return placer.place(time, LENS, LENS.project(TRUTH) if pixels is None else pixels, posture, confidence, depth)


def test_the_height_determines_the_scale_without_depth(BodyPlacer):
    positions, confidence = placed(BodyPlacer(body.height(TRUTH)))
    assert_allclose(positions, TRUTH, atol=1e-5)
    assert_array_equal(confidence, TRACKED_ALL)
    small, tall = (placed(BodyPlacer(height))[0] for height in (1.4, 2.0))
    crown_and_soles = body.HEAD_TOP_METRES + body.ANKLE_HEIGHT_METRES
    assert_allclose(tall, small * (2.0 - crown_and_soles) / (1.4 - crown_and_soles))


def test_height_and_sides_are_exact_and_bones_keep_their_lengths_for_noisy_estimates(BodyPlacer):
    rng, placer = np.random.default_rng(1), BodyPlacer(1.6)
    for k in range(60):
        noisy = {
            "pixels": LENS.project(TRUTH) + rng.normal(0, 3, (20, 2)),
            "posture": POSTURE + rng.normal(0, 0.03, (20, 3)),
        }
        positions, _ = placed(placer, time=k / 30, confidence=rng.uniform(0, 1, 20).astype(np.float32), **noisy)
        assert body.height(positions) == pytest.approx(1.6, abs=1e-9)
        assert_allclose(bones(positions), bones(positions)[OPPOSITE], atol=1e-9)
    placer, guessed, found = BodyPlacer(1.7), [], []
    for k in range(90):
        posture = POSTURE + rng.normal(0, 0.02, (20, 3))
        guessed.append(bones(posture)[1:])
        found.append(bones(placed(placer, time=k / 30, posture=posture)[0])[1:])
    spread = [np.ptp(lengths[30:], axis=0) / np.median(lengths, axis=0) for lengths in (guessed, found)]
    assert np.median(spread[0]) > 0.25
    assert spread[1].max() < 0.1


def test_the_estimated_distance_is_smoothed_with_a_time_constant_of_0_1_s(BodyPlacer):
    placer, farther = BodyPlacer(body.height(TRUTH)), TRUTH + np.array([0, 0, 1.2])
    placed(placer)
    for k in range(1, 7):
        positions, _ = placed(placer, time=k / 20, pixels=LENS.project(farther))
    assert positions[0, 2] == pytest.approx(farther[0, 2] - 1.2 * np.exp(-3), abs=1e-3)


def test_depth_places_joints_exactly_whatever_the_height_and_the_scale_outlasts_the_depth(BodyPlacer):
    placer, depth = BodyPlacer(1.2), drawn(TRUTH, size=9)
    depth[around(KNEE, 20, 20, -1, 20)] = WALL_METRES  # a wall beside a thin limb
    positions, confidence = placed(placer, depth)
    assert_array_equal(confidence, TRACKED_ALL)
    assert_allclose(positions, TRUTH, atol=1e-3)
    assert_allclose(placed(placer, time=0.1)[0], TRUTH, atol=0.01)


def test_a_joint_without_depth_is_inferred_at_its_estimate(BodyPlacer):
    depth = drawn(TRUTH, without=[HAND], size=9)
    depth[around(HEAD, 60, 20, 40, 40)] = 1.0  # an object in front of the face
    positions, confidence = placed(BodyPlacer(1.7), depth)
    expected = TRACKED_ALL.copy()
    expected[[HAND, HEAD]] = INFERRED
    assert_array_equal(confidence, expected)
    assert_allclose(positions, TRUTH, atol=0.01)


def test_an_empty_depth_image_is_like_none_and_pixels_that_no_body_can_have_give_no_result(BodyPlacer):
    empty = np.zeros((LENS.height, LENS.width), np.float32)
    for with_it, without in zip(placed(BodyPlacer(1.7), empty), placed(BodyPlacer(1.7)), strict=True):
        assert_array_equal(with_it, without)
    for pixels in (LENS.project(TRUTH) * -1, np.full((20, 2), 100.0)):  # upside down, and a heap
        assert placed(BodyPlacer(1.7), pixels=pixels) is None
