"""A rendered performer with known joints waves: from images of the real libraries through MediaPipe to joints."""

import time
from contextlib import closing

import numpy as np
import pytest
from puppetline.examples.performances import clean

from capture.events import Cue
from capture.sensor_tilt import SensorTilt
from capture.sensors import freenect, realsense
from capture.sensors.camera import Options, Video
from capture.sensors.depth_camera import Selection
from capture.skeleton import JOINT_INDEX, SkeletonFrame
from capture.sources.registry import open_source
from capture.trackers.mediapipe import MediaPipePose

from ..conftest import Watched, read

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("camera")]

POSES = range(99, 144, 4)
"""Frames of the bundled walk in which the performer stands and waves."""
STEP = 4 / 30
"""Seconds between these frames."""

MAX_ERROR_METRES = {"head": 0.09, "wrist_right": 0.13}
"""Largest median error, 0.07 for other joints. The character's head is very large, and its right hand waves."""

FOLLOW = """
import sys
import time
import numpy as np
from capture.sensors import freenect, source
from capture.skeleton import SkeletonFrame
from capture.source import wait
from capture.sources.registry import open_source

for limit in ("MAX_AGE_SECONDS", "SILENCE_SECONDS", "OPENING_SECONDS"):
    setattr(source, limit, 100.0)  # no image is too old or missing, even on a busy machine
frames = []

class Patient(freenect.FreenectDevice):
    given = 0

    def read(self, timeout):
        while len(frames) < self.given:
            time.sleep(0.001)
        picture = super().read(timeout)
        self.given += picture is not None
        return picture

freenect.FreenectDevice = Patient
kinect = open_source("freenect:")
while len(frames) < int(sys.argv[2]):
    wait(kinect, time.monotonic() + 1)
    frames += [event for event in kinect.receive() if isinstance(event, SkeletonFrame)]
kinect.close()
np.savez(sys.argv[1], times=[each.time for each in frames], positions=[each.positions for each in frames])
"""
"""Reads each image only after the one before was tracked, so that none is dropped."""


@pytest.fixture(scope="module")
def shots(rendered_body):
    """Render the performer 2.5 m in front of a lens, with a sensor's noise: `shots(lens)` returns images and joints."""
    body, poses = rendered_body.Body(), clean("walk").positions

    def shot(lens):
        studio = rendered_body.Studio(body, 2.5, 0.0, seed=1, lens=lens)
        return [studio.shoot(k * STEP, poses[pose]) for k, pose in enumerate(POSES)]

    return shot


@pytest.fixture(scope="module")
def shown(shots, _virtual_sensors):
    """The images of the virtual OpenNI2 sensor, with joints."""
    return shots(_virtual_sensors[0].lens)


def tracked(pictures):
    """Return the joints (T, 20, 3) that MediaPipe finds."""
    with closing(MediaPipePose()) as tracker:
        return np.stack([person.positions for picture in pictures for person in tracker.track(picture)])


def check_joints(rendered_body, positions, shots):
    """Check that joints are near the known positions, and that the hand waves."""
    positions, known = positions[:, rendered_body.KINECT], np.stack([shot.joints for shot in shots])
    off = np.linalg.norm(positions - known, axis=2)
    assert np.median(off) < 0.05
    for name, median in zip(rendered_body.NAMES, np.median(off, axis=0), strict=True):
        assert median < MAX_ERROR_METRES.get(name, 0.07), name
    waving = rendered_body.NAMES.index("wrist_right")
    assert np.ptp(known[:, waving, 1]) > 0.5
    assert np.corrcoef(positions[:, waving, 1], known[:, waving, 1])[0, 1] > 0.98


@pytest.fixture
def only_sensor(virtual_sensors, tmp_path, monkeypatch):
    """A virtual OpenNI2 sensor that is plugged in, without NiTE2."""
    monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
    virtual_sensors[0].plug()
    return virtual_sensors[0]


def test_joints_through_openni2_have_the_true_positions_and_the_times_of_their_images(
    only_sensor, shown, rendered_body
):
    frames, moments = [], []
    with closing(open_source("openni:")) as source:
        watched = Watched(source)
        only_sensor.wait_for_streams()
        start = time.monotonic()
        for shot in shown:
            before = time.monotonic()
            only_sensor.show(shot.picture.depth, shot.picture.color, before - start)
            frames += watched.frames()
            moments.append((before, time.monotonic()))
    assert [frame.user for frame in frames] == [1] * len(shown)
    for frame, (before, after) in zip(frames, moments, strict=True):
        assert before - 1e-6 <= frame.time <= after
    positions = np.stack([frame.positions for frame in frames])
    np.testing.assert_array_equal(positions, tracked([shot.picture for shot in shown]))
    check_joints(rendered_body, positions, shown)


def test_joints_of_a_recording_are_those_of_the_recorded_images(only_sensor, shown, record, tmp_path, rendered_body):
    record(only_sensor, tmp_path / "take.oni", [(shot.picture.depth, shot.picture.color) for shot in shown], step=STEP)
    with closing(open_source("openni:file=take.oni&fast", tmp_path)) as source:
        events = Watched(source).events(len(shown) + 1)
    [stands] = [SensorTilt.of_json(event.arguments) for event in events if isinstance(event, Cue)]
    assert stands.near(SensorTilt(0.0, rendered_body.EYE), 0.3, 0.02)
    frames = [event for event in events if isinstance(event, SkeletonFrame)]
    np.testing.assert_allclose([frame.time for frame in frames], [shot.picture.time for shot in shown], atol=2e-6)
    positions = np.stack([frame.positions for frame in frames])
    np.testing.assert_array_equal(positions, tracked([shot.picture for shot in shown]))
    check_joints(rendered_body, positions, shown)


def test_joints_through_librealsense_are_those_through_openni2(
    virtual_realsense, shown, tmp_path, monkeypatch, rendered_body
):
    """Recorded and played by the library; OpenNI2's joints are those of the images, by the tests above."""
    lens = shown[0].picture.lens
    sensor = virtual_realsense("7", focal=lens.focal, center=(319.5, 239.5))
    monkeypatch.setattr(realsense, "plugged_in", lambda _rs: [sensor.device])
    with closing(realsense.RealSenseDevice("realsense:", Selection(), record=tmp_path / "take.db3")) as device:
        for shot in shown:
            sensor.show(shot.picture.depth, shot.picture.color, shot.picture.time + 1.0)
            read(device)
    with closing(open_source("realsense:take.db3&fast", tmp_path)) as source:
        events = Watched(source).frames(len(shown))
    positions = np.stack([event.positions for event in events if isinstance(event, SkeletonFrame)])
    np.testing.assert_allclose(positions, tracked([shot.picture for shot in shown]), atol=1e-3)
    check_joints(rendered_body, positions, shown)


def test_a_person_in_a_real_video_is_found_through_librealsense(virtual_realsense, real_data, monkeypatch):
    """The images of the video, 2.5 m away, are in the middle of the sensor's; MediaPipe finds what it finds in them."""
    import cv2

    sensor, pictures, depth = virtual_realsense("7"), [], np.full((480, 640), 2.5, np.float32)
    monkeypatch.setattr(realsense, "plugged_in", lambda _rs: [sensor.device])
    path = real_data / "video" / "tfjs" / "pose_squats.mp4"
    with (
        closing(Video("video:squats", path, Options("squats"))) as video,
        closing(realsense.RealSenseDevice("realsense:", Selection())) as device,
    ):
        for k in range(20):
            color = np.zeros((480, 640, 3), np.uint8)
            color[:, 185:455] = cv2.resize(video.read(1.0).color, (270, 480))
            sensor.show(depth, color, 1.0 + k / 5)
            pictures.append(read(device))
            np.testing.assert_array_equal(pictures[-1].color, color)
    positions = tracked(pictures)
    assert positions.shape == (20, 20, 3)
    assert np.abs(positions[:, JOINT_INDEX["hip_center"], 2] - 2.5).max() < 0.3


def test_joints_through_libfreenect_are_those_of_the_rendered_images(
    shots, write_dump, run_with_kinect, tmp_path, rendered_body
):
    shown = shots(freenect.LENS)
    pictures = [
        (each, round(shot.picture.time * freenect.TICKS_PER_SECOND))
        for shot in shown
        for each in (shot.picture.depth, shot.picture.color)
    ]
    run_with_kinect(write_dump(pictures, interval=STEP / 2), FOLLOW, tmp_path / "found.npz", len(shown))
    found = np.load(tmp_path / "found.npz")
    np.testing.assert_array_equal(found["positions"], tracked([shot.picture for shot in shown]))
    check_joints(rendered_body, found["positions"], shown)
    assert (np.diff(found["times"]) > 0).all()
