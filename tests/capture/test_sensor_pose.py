import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from capture.sensor_pose import SensorPose, fit

ANGLE = st.floats(-179, 179)
AXES = np.eye(3)


@given(st.floats(-89, 89), ANGLE, ANGLE)
def test_degrees_are_read_back(tilt, turn, roll):
    pose = SensorPose.of_degrees(tilt, turn, roll, np.zeros(3))
    assert_allclose(pose.rotation @ pose.rotation.T, AXES, atol=1e-12)
    assert np.linalg.det(pose.rotation) == pytest.approx(1)
    assert_allclose(pose.degrees, [tilt, turn, roll], atol=1e-9)


@pytest.mark.parametrize(
    ("degrees", "looks_to"),
    [((90, 0, 0), -AXES[1]), ((0, 90, 0), AXES[0]), ((0, 180, 0), -AXES[2]), ((0, 0, 90), AXES[2])],
)
def test_tilt_is_down_and_turn_is_to_the_sensors_left(degrees, looks_to):
    pose = SensorPose.of_degrees(*degrees, np.array([1.0, 2.0, 3.0]))
    assert_allclose(pose.apply(AXES[2]), looks_to + np.array([1, 2, 3]), atol=1e-12)


@given(ANGLE, ANGLE, ANGLE, st.integers(0, 2**32 - 1))
def test_a_fit_finds_the_pose_that_moved_the_points(tilt, turn, roll, seed):
    random = np.random.default_rng(seed)
    pose = SensorPose.of_degrees(tilt, turn, roll, random.uniform(-5, 5, 3))
    points, weights = random.standard_normal((8, 3)), random.uniform(0.1, 1, 8)
    found = fit(points, pose.apply(points), weights)
    assert_allclose(found.rotation, pose.rotation, atol=1e-9)
    assert_allclose(found.position, pose.position, atol=1e-9)


def test_points_without_weight_do_not_count_and_no_reflection_is_fitted():
    points = np.vstack([np.random.default_rng(0).standard_normal((6, 3)), [[100.0, 0, 0]]])
    onto = np.vstack([points[:6] + 1, [[0.0, 0, 0]]])
    found = fit(points, onto, np.array([1.0] * 6 + [0.0]))
    assert_allclose(found.apply(points[:6]), onto[:6], atol=1e-12)
    mirrored = fit(points, points * [-1, 1, 1], np.ones(7))
    assert np.linalg.det(mirrored.rotation) == pytest.approx(1)
