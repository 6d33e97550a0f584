"""A rendered performer with known joints waves: from images of the real libraries through MediaPipe to joints."""

from contextlib import closing

import numpy as np
import pytest
from puppetline.examples.performances import clean

from capture.sources.registry import open_source
from capture.trackers.mediapipe import MediaPipePose

from ..conftest import Watched

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("camera")]

POSES = range(99, 144, 4)
"""Frames of the bundled walk in which the performer stands and waves."""
STEP = 4 / 30
"""Seconds between these frames."""

MAX_ERROR_METRES = {"head": 0.09, "wrist_right": 0.13}
"""Largest median error, 0.07 for other joints. The character's head is very large, and its right hand waves."""


@pytest.fixture(scope="module")
def shown(rendered_body, _virtual_sensors):
    """Images and joints of the performer 2.5 m in front of the virtual OpenNI2 sensor's lens, with a sensor's noise."""
    studio = rendered_body.Studio(rendered_body.Body(), 2.5, 0.0, seed=1, lens=_virtual_sensors[0].lens)
    poses = clean("walk").positions
    return [studio.shoot(k * STEP, poses[pose]) for k, pose in enumerate(POSES)]


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
    only_sensor, shown, rendered_body, standing, until_end
):
    watched, frames, times = Watched(until_end(open_source("openni:"))), [], []
    for shot in shown:
        standing.advance(STEP)
        only_sensor.show(shot.picture.depth, shot.picture.color, shot.picture.time)
        frames += watched.frames()
        times.append(standing.now())
    assert [(frame.user, frame.time) for frame in frames] == [(1, pytest.approx(time)) for time in times]
    positions = np.stack([frame.positions for frame in frames])
    np.testing.assert_array_equal(positions, tracked([shot.picture for shot in shown]))
    check_joints(rendered_body, positions, shown)
