import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from capture.clip import SkeletonClip
from capture.sensor_pose import SensorPose
from capture.sensor_tilt import SensorTilt, estimate_tilt
from capture.skeleton import JOINT_INDEX, JOINTS

from .bodies import STANDS, both

ANKLES = both("ankle")


def turned(pose, degrees, height):
    """Return a pose as seen by a sensor with a tilt, at a height above the floor."""
    angle = np.radians(degrees)
    x, y, z = (pose - [0.0, height, 0.0]).T
    up, forward = (np.cos(angle), np.sin(angle)), (-np.sin(angle), np.cos(angle))  # the sensor's axes in the room
    return np.stack([x, y * up[0] + z * up[1], y * forward[0] + z * forward[1]], axis=1)


@pytest.fixture
def upright():
    """Return a performer on the floor, with ankles at their height above it, and legs and trunk in one line."""
    pose = STANDS * [1, 1, 0.2] + [0, 0, 2.5]
    pose[:, 1] += 0.09 - pose[ANKLES, 1].mean()
    return pose


@pytest.mark.parametrize("degrees", [-20.0, 0.0, 8.0, 15.0, 35.0])
@pytest.mark.parametrize("height", [0.0, 0.9, 2.2])
def test_a_performer_who_stands_upright_determines_the_tilt(upright, degrees, height):
    seen = turned(upright, degrees, height)
    sensor = estimate_tilt(seen)
    assert sensor.tilt == pytest.approx(degrees, abs=1.5)
    assert_allclose(sensor.upright(seen)[:, 1], upright[:, 1], atol=0.04)


def test_levelling_undoes_the_sensor_exactly(upright):
    assert_allclose(SensorTilt(25.0, 1.4).upright(turned(upright, 25.0, 1.4)), upright, atol=1e-12)
    pose = SensorPose.of_degrees(-15.0, 0.0, 90.0, np.array([0.0, 0.8, 0.0]))
    seen = (upright - pose.position) @ pose.rotation
    assert_allclose(SensorTilt(-15.0, 0.8, 90.0).upright(seen), upright, atol=1e-12)


def test_bones_of_clips_and_frames_are_turned_with_the_joints_that_are_levelled(upright):
    sensor, turns = SensorTilt(25.0, 1.4, 5.0), Rotation.random(len(JOINTS), rng=2)
    ends, turns = upright + turns.apply([0.0, 0.3, 0.0]), turns.as_quat(scalar_first=True)
    clip = SkeletonClip("", 1, np.zeros(1), upright[None], np.ones((1, 20), np.float32), orientations=turns[None])
    [seen], [of_clip] = clip.frames(), sensor.levelled(clip).frames()
    for frame in (sensor.levelled(seen), of_clip):
        assert_allclose(frame.positions, sensor.upright(upright), atol=1e-12)
        found = Rotation.from_quat(frame.orientations, scalar_first=True).apply([0.0, 0.3, 0.0])
        assert_allclose(frame.positions + found, sensor.upright(ends), atol=1e-12)
    assert SensorTilt().levelled(seen) is seen
    assert SensorTilt().upright(upright) is upright


def test_bent_seated_or_incomplete_performers_determine_nothing(upright):
    def changed(change, *joints):
        pose = upright.copy()
        pose[[JOINT_INDEX[name] for name in JOINTS if name.startswith(joints)], 2] += change
        return pose

    bent, sitting = changed(0.4, "shoulder_center", "head", "spine"), changed(-0.5, "knee", "ankle", "foot")
    for pose in (bent, sitting, changed(np.nan, "ankle_left"), turned(upright, 80.0, 0.0)):
        assert estimate_tilt(pose) is None


def test_json_values_are_converted_and_invalid_ones_are_errors():
    good = {"tilt": 12, "roll": -1.5, "height": 1.3, "more": "x"}
    assert SensorTilt.of_json(good) == SensorTilt(12.0, 1.3, -1.5)
    for wrong in ({"tilt": "steep"}, {"height": None}, {"roll": float("nan")}, {"tilt": [1.0]}, {"tilt": 10**400}):
        with pytest.raises(ValueError, match=r"."):
            SensorTilt.of_json(good | wrong)
    with pytest.raises(ValueError, match="no tilt"):
        SensorTilt.of_json({})


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (SensorTilt(12.2, 1.304, -2.6), "1.30 m above the floor, looks 12° down, leans by 3°"),
        (SensorTilt(-7.0, 0.8, 0.6), "0.80 m above the floor, looks 7° up"),
        (SensorTilt(0.4), "level"),
    ],
)
def test_a_tilt_is_described(sensor, words):
    assert str(sensor) == words


def test_an_accelerometers_tilt_gets_its_height_from_a_performer_who_stands_on_the_floor(upright):
    seen = turned(upright, 20.0, 1.4)
    stands = SensorTilt(20.0).above_floor(seen)
    assert stands.height == pytest.approx(1.4)
    assert stands.above_floor(seen + 1.0) is stands
    seen[ANKLES[0]] = np.nan
    assert SensorTilt(20.0).above_floor(seen) == SensorTilt(20.0)
