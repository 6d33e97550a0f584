import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.pose import Pose
from capture.sensor_tilt import SensorTilt, estimate_tilt
from capture.skeleton import JOINT_INDEX, JOINTS, SkeletonFrame

from .network.conftest import STANDING


def turned(pose, degrees, height):
    """Return a pose as seen by a sensor with a tilt, at a height above the floor."""
    angle = np.radians(degrees)
    x, y, z = (pose - [0.0, height, 0.0]).T
    up, forward = (np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))  # the sensor's axes in the room
    return np.stack([x, y * up[0] + z * up[1], y * forward[0] + z * forward[1]], axis=1)


@pytest.fixture
def upright():
    """Return a performer on the floor, with ankles at their height above it, and legs and trunk in one line."""
    pose = np.array([STANDING[name] for name in JOINTS]) + np.array([0.0, 0.0, 2.5])
    pose[:, 2] = 2.5 + 0.2 * (pose[:, 2] - 2.5)
    pose[:, 1] += 0.09 - pose[[JOINT_INDEX["ankle_left"], JOINT_INDEX["ankle_right"]], 1].mean()
    return pose


@pytest.mark.parametrize("degrees", [-20.0, 0.0, 8.0, 15.0, 35.0])
@pytest.mark.parametrize("height", [0.0, 0.9, 2.2])
def test_a_performer_who_stands_upright_determines_the_tilt(upright, degrees, height):
    seen = turned(upright, degrees, height)
    sensor = estimate_tilt(seen)
    assert sensor.tilt == pytest.approx(degrees, abs=1.5)
    np.testing.assert_allclose(sensor.upright(seen)[:, 1], upright[:, 1], atol=0.04)


def test_levelling_undoes_the_sensor_exactly(upright):
    np.testing.assert_allclose(SensorTilt(25.0, 1.4).upright(turned(upright, 25.0, 1.4)), upright, atol=1e-12)


def test_bones_are_turned_with_the_joints_that_are_levelled(upright):
    sensor, turns = SensorTilt(25.0, 1.4, 5.0), Rotation.random(len(JOINTS), rng=2)
    ends = upright + turns.apply([0.0, 0.3, 0.0])
    seen = SkeletonFrame(1.0, 0, upright, np.ones(len(JOINTS)), turns.as_quat()[:, [3, 0, 1, 2]])
    frame = sensor.levelled(seen)
    np.testing.assert_array_equal(frame.positions, sensor.upright(upright))
    found = Rotation.from_quat(frame.orientations[:, [1, 2, 3, 0]]).apply([0.0, 0.3, 0.0])
    np.testing.assert_allclose(frame.positions + found, sensor.upright(ends), atol=1e-12)
    assert SensorTilt().levelled(seen) is seen


@pytest.mark.parametrize(("tilt", "roll", "height"), [(25.0, 0.0, 1.4), (10.0, -7.0, 0.8), (-15.0, 90.0, 0.0)])
def test_a_tilt_equals_the_pose_of_its_angles(upright, tilt, roll, height):
    pose = Pose.of_degrees(tilt, 0.0, roll, np.array([0.0, height, 0.0]))
    seen = (upright - pose.position) @ pose.rotation
    np.testing.assert_allclose(SensorTilt(tilt, height, roll).upright(seen), upright, atol=1e-12)


def test_a_level_sensor_changes_nothing(upright):
    assert SensorTilt().upright(upright) is upright


def test_bent_seated_or_incomplete_performers_determine_nothing(upright):
    bent = upright.copy()
    bent[[JOINT_INDEX[name] for name in ("shoulder_center", "head", "spine")], 2] += 0.4
    assert estimate_tilt(bent) is None
    sitting = upright.copy()
    sitting[[JOINT_INDEX[name] for name in JOINTS if name.startswith(("knee", "ankle", "foot"))], 2] -= 0.5
    assert estimate_tilt(sitting) is None
    cut = upright.copy()
    cut[JOINT_INDEX["ankle_left"]] = np.nan
    assert estimate_tilt(cut) is None
    assert estimate_tilt(turned(upright, 80.0, 0.0)) is None


def test_json_values_are_converted():
    assert SensorTilt.of_json({"tilt": 12, "roll": -1.5, "height": 1.3, "more": "x"}) == SensorTilt(12.0, 1.3, -1.5)


@pytest.mark.parametrize(
    "wrong", [{"tilt": "steep"}, {"height": None}, {"roll": float("nan")}, {"tilt": [1.0]}, {"tilt": 10**400}]
)
def test_invalid_json_values_are_errors(wrong):
    with pytest.raises(ValueError, match=r"."):
        SensorTilt.of_json({"tilt": 1.0, "roll": 0.0, "height": 1.0} | wrong)
    with pytest.raises(ValueError, match="no tilt"):
        SensorTilt.of_json({})


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (SensorTilt(12.2, 1.304, -2.6), "1.30 m above the floor, looks 12° down, leans by 3°"),
        (SensorTilt(-7.0, 0.8, 0.6), "0.80 m above the floor, looks 7° up"),
        (SensorTilt(0.4, 0.8), "0.80 m above the floor, level"),
    ],
)
def test_a_tilt_is_described(sensor, words):
    assert str(sensor) == words


def test_a_clip_is_made_level_as_its_frames_are():
    random = np.random.default_rng(0)
    quaternions = random.normal(size=(3, 20, 4))
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    positions = random.normal(size=(3, 20, 3))
    clip = SkeletonClip("", 1, np.arange(3.0), positions, np.ones((3, 20), np.float32), orientations=quaternions)
    sensor = SensorTilt(12.0, 1.1, 3.0)
    for found, frame in zip(sensor.levelled(clip).frames(), clip.frames(), strict=True):
        np.testing.assert_allclose(found.positions, sensor.levelled(frame).positions, atol=1e-12)
        np.testing.assert_allclose(found.orientations, sensor.levelled(frame).orientations, atol=1e-12)
    assert SensorTilt().levelled(clip) is clip


def test_an_accelerometers_tilt_gets_its_height_from_a_performer_who_stands_on_the_floor(upright):
    seen = turned(upright, 20.0, 1.4)
    stands = SensorTilt(20.0).above_floor(seen)
    assert stands.height == pytest.approx(1.4)
    assert stands.above_floor(seen + 1.0) is stands
    seen[JOINT_INDEX["ankle_left"]] = np.nan
    assert SensorTilt(20.0).above_floor(seen) == SensorTilt(20.0)
