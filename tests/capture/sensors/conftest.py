"""OpenNI2 sensors and a recording of one, and librealsense's software devices."""

from contextlib import closing

import numpy as np
import pytest

from capture.sensors.depth_camera import Selection, metres

from ...outside import found
from ..conftest import read


@pytest.fixture
def opened(until_end):
    """Open a device that is closed after the test: `opened(*selection, **options)`."""
    from capture.sensors.openni import OpenNIDevice

    return lambda *args, **options: until_end(OpenNIDevice("openni:", Selection(*args, **options)))


@pytest.fixture
def virtual_realsense():
    """Make a virtual sensor of the real librealsense: `virtual_realsense(serial, …)`."""
    found("realsense")
    from .virtual_realsense import VirtualRealSense

    return VirtualRealSense


@pytest.fixture
def plug(virtual_realsense, monkeypatch):
    """Plug a virtual RealSense in: `plug(serial, …)`; `plug.sensors` are those that are plugged in."""
    from capture.sensors import realsense

    def plugged(*args, **options):
        plugged.sensors.append(virtual_realsense(*args, **options))
        return plugged.sensors[-1]

    plugged.sensors = []
    monkeypatch.setattr(realsense, "plugged_in", lambda _rs: [sensor.device for sensor in plugged.sensors])
    return plugged


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


@pytest.fixture
def recorded(plug, noise, tmp_path):
    """A recording of ten images by librealsense, and the images."""
    from capture.sensors.realsense import RealSenseDevice

    sensor, path, pictures = plug("7"), tmp_path / "take.db3", [noise() for _ in range(10)]
    with closing(RealSenseDevice("realsense:", Selection(), record=path)) as device:
        for k, images in enumerate(pictures):
            sensor.show(*images, 1.0 + k / 30)
            read(device)
    return path, pictures
