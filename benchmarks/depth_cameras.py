"""Compare depth cameras by their virtual devices, as docs/sensors.md says.

python -m benchmarks.depth_cameras latency|memory

This requires what the tests of sensors require (CONTRIBUTING.md), and `latency` MediaPipe too. pytest runs it, because
the virtual devices are fixtures of the tests.
"""

import os
import sys
import time
from contextlib import ExitStack, closing

import numpy as np
import psutil
import pytest

from capture.sensors import realsense, source
from capture.sensors.depth_camera import Selection
from capture.sources.registry import open_source
from tests.capture.conftest import Watched, read
from tests.capture.sensors.test_depth_camera import OpenNI, Orbbec, RealSense

pytest_plugins = ["tests.conftest", "tests.capture.conftest", "tests.capture.sensors.conftest"]

IMAGES, WARM_UP = 300, 30
"""Numbers of images whose latency is measured, and of those before."""
HOUR = int(os.environ.get("PUPPETLINE_IMAGES", 108_000))
"""Number of images of an hour at 30 per second."""
SMALL = 96, 128
"""Height and width of small images, in pixels."""


@pytest.mark.parametrize("apart", [False, True], ids=["registered", "aligned"])
def test_latency(virtual_sensors, rendered_body, monkeypatch, tmp_path, apart):
    """Time from an image to the skeleton, in turns through OpenNI2 and librealsense."""
    from puppetline.examples.performances import clean

    from tests.capture.sensors.virtual_realsense import VirtualRealSense

    openni, rs = virtual_sensors[0], VirtualRealSense("7", apart=apart)
    monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
    monkeypatch.setattr(realsense, "plugged_in", lambda _rs: [rs.device])
    for seconds in ("SILENCE_SECONDS", "OPENING_SECONDS"):  # the devices wait for each other, and for both trackers
        monkeypatch.setattr(source, seconds, 60.0)
    openni.plug()
    shot = rendered_body.Studio(rendered_body.Body(), 2.5, 0.0, seed=3).shoot(0.0, clean("walk").positions[0])
    took = {"openni:": [], "realsense:": []}
    with ExitStack() as stack:
        watched = [Watched(stack.enter_context(closing(open_source(uri)))) for uri in took]
        openni.wait_for_streams()
        for _ in range(WARM_UP + IMAGES):
            for sensor, events, each in zip((openni, rs), watched, took.values(), strict=True):
                start = time.monotonic()
                sensor.show(shot.picture.depth, shot.picture.color, start)
                events.frames()
                each.append(time.monotonic() - start)
    medians = [1000 * np.median(each[WARM_UP:]) for each in took.values()]
    print(f"\nimage to skeleton, {medians[0]:.1f} ms by openni:, {medians[1] / medians[0]:.2f} × by realsense:")


@pytest.mark.parametrize("kind", [OpenNI, RealSense, Orbbec], ids=lambda kind: kind.__name__)
def test_memory(request, monkeypatch, kind, noise):
    """Memory of the process during an hour of images; those of librealsense are small, as it copies them often."""
    bus = kind(request)
    images = noise()
    if kind is RealSense:
        from tests.capture.sensors import virtual_realsense

        for name, size in zip(("HEIGHT", "WIDTH"), SMALL, strict=True):
            monkeypatch.setattr(virtual_realsense, name, size)
        images = [each[: SMALL[0], : SMALL[1]] for each in images]
    sensor = bus.plug(**({"apart": True} if kind is RealSense else {}))
    with closing(bus.open(Selection())) as device:
        for k in range(HOUR + 1):
            sensor.show(*images, 1.0 + k / 30)
            read(device)
            if k in (300, HOUR // 4, HOUR // 2, 3 * HOUR // 4, HOUR):
                memory = psutil.Process().memory_info().rss / 1e6
                print(f"\n{kind.__name__}: {memory:.1f} MB after {k} images", end="", flush=True)


if __name__ == "__main__":
    sys.exit(pytest.main(["-qs", "--disable-warnings", "--tb=short", __file__, "-k", " ".join(sys.argv[1:])]))
