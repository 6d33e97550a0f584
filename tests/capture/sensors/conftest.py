"""Sources of these tests accept late images; OpenNI2 sensors and a recording of one."""

from contextlib import ExitStack, closing

import numpy as np
import pytest

from capture.sensors import source
from capture.sensors.depth_camera import metres

from ...outside import found
from ..conftest import TIMEOUT_SECONDS


@pytest.fixture(autouse=True)
def unhurried(monkeypatch):
    """No image is too old, even on a busy machine."""
    monkeypatch.setattr(source, "MAX_AGE_SECONDS", TIMEOUT_SECONDS)


@pytest.fixture
def opened():
    """Open a device that is closed after the test: `opened(*selection, **options)`."""
    from capture.sensors.depth_camera import Selection
    from capture.sensors.openni import OpenNIDevice

    with ExitStack() as stack:
        yield lambda *args, **options: stack.enter_context(
            closing(OpenNIDevice("openni:", Selection(*args, **options)))
        )


@pytest.fixture
def virtual_realsense():
    """Make a virtual sensor of the real librealsense: `virtual_realsense(serial, …)`."""
    found("realsense")
    from .virtual_realsense import VirtualRealSense

    return VirtualRealSense


@pytest.fixture(scope="session")
def noise():
    """Return depth in metres and colours of a random image: `noise()`."""
    rng = np.random.default_rng(3)

    def image():
        return metres(rng.integers(400, 4000, (480, 640), np.uint16)), rng.integers(0, 255, (480, 640, 3), np.uint8)

    return image


@pytest.fixture(scope="session")
def recording(record, noise, _virtual_sensors, tmp_path_factory):
    """A mirrored recording of ten images by OpenNI2's recorder, and the images."""
    [sensor, _] = _virtual_sensors
    sensor.plug(refuses=["mirror off"])
    path = tmp_path_factory.mktemp("oni") / "take.oni"
    pictures = [noise() for _ in range(10)]
    record(sensor, path, pictures, step=0.1)
    sensor.unplug()
    return path, pictures
