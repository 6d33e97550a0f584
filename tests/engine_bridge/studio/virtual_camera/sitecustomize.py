"""Python loads this at its start if its folder is on the path: /dev/video0 is a camera in front of a performer, and a
microphone hears a hum."""

import time
from functools import cache

import numpy as np

from capture import sound
from capture.sensors.source import SensorSource
from capture.sources import registry
from capture.trackers.picture import Lens, Person, Picture
from engine_bridge.inspection import sensors
from engine_bridge.studio.long_work import installation

LENS = Lens(640, 480, 420.0)


@cache
def poses():
    """The performer's motion, which only the service loads."""
    from puppetline.examples.performances import PERFORMANCES

    return PERFORMANCES["rear"]().positions


class Camera:
    """A camera whose picture changes; the tracker knows what it sees."""

    name = "a virtual camera"

    def read(self, timeout):
        time.sleep(1 / 30)
        now = time.monotonic()
        return Picture(now, LENS, np.full((LENS.height, LENS.width, 3), int(30 * now) % 256, np.uint8), None)

    def track(self, picture):
        pose = poses()[int(30 * picture.time) % len(poses())]
        return [Person(1, pose.astype(np.float32), np.ones(20, np.float32))]

    def close(self):
        pass


class Microphone:
    """A microphone that hears a hum."""

    rate, overflows = sound.SAMPLE_RATE, 0

    def __init__(self, device=None):
        self._next = time.monotonic()

    def blocks(self):
        hum = 0.4 * np.sin(np.arange(round(sound.BLOCK_SECONDS * self.rate)) / 20)
        while self._next + sound.BLOCK_SECONDS <= time.monotonic():
            yield sound.Block(self._next, hum.astype(np.float32))
            self._next += sound.BLOCK_SECONDS

    def close(self):
        pass


others, installed = registry.open_source, installation.is_installed
registry.open_source = lambda uri, *rest: (
    SensorSource(uri, Camera, lambda _: Camera()) if uri == "camera:0" else others(uri, *rest)
)
installation.is_installed = lambda extra: extra in ("camera", "sound") or installed(extra)
sound.Microphone = Microphone
sensors._cameras = lambda: iter([sensors.Finding("/dev/video0", True, "a virtual camera, can be opened", "")])
