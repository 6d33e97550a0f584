"""Python loads this at its start if its folder is on the path: /dev/video0 is a camera in front of a performer, who
speaks into a microphone for 0.3 s from each second of the motion on."""

import importlib.abc
import importlib.util
import sys
import time


class _Patch(importlib.abc.MetaPathFinder):
    """Changes a module as soon as it is loaded."""

    def __init__(self, name, change):
        self._name, self._change = name, change

    def find_spec(self, name, path=None, target=None):
        if name != self._name:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        run = spec.loader.exec_module

        def exec_module(module):
            run(module)
            self._change(module)

        spec.loader.exec_module = exec_module
        return spec


def _open_camera(registry):
    others = registry.open_source
    registry.open_source = lambda uri, *rest: _camera(uri) if uri == "camera:0" else others(uri, *rest)


def _install_camera(installation):
    others = installation.is_installed
    installation.is_installed = lambda extra: extra in ("camera", "sound") or others(extra)


def _plug_in_camera(sensors):
    found = sensors.Finding("/dev/video0", True, "a virtual camera, can be opened", "")
    sensors._cameras = lambda: iter([found])


def _camera(uri):
    import numpy as np
    from puppetline.examples.performances import PERFORMANCES

    from capture.sensors.source import SensorSource
    from capture.trackers.picture import Lens, Person, Picture

    lens, clip = Lens(640, 480, 420.0), PERFORMANCES["rear"]()

    def pose(moment):
        return clip.positions[int(30 * moment) % len(clip.positions)]

    class Camera:
        name = "a virtual camera"

        def read(self, timeout):
            time.sleep(1 / 30)
            now = time.monotonic()
            image = np.full((lens.height, lens.width, 3), int(30 * now) % 256, np.uint8)  # another one each time
            return Picture(now, lens, image, None)

        def close(self):
            pass

    class Tracker:
        name = "a virtual tracker"

        def track(self, picture):
            return [Person(1, pose(picture.time).astype(np.float32), np.ones(20, np.float32))]

        def close(self):
            pass

    return SensorSource(uri, Camera, lambda _: Tracker())


def _plug_in_microphone(sound):
    class Microphone:
        rate, overflows = sound.SAMPLE_RATE, 0

        def __init__(self, device=None):
            from puppetline.examples.performances import PERFORMANCES

            self._next, self._cycle = time.monotonic(), len(PERFORMANCES["rear"]().positions)

        def blocks(self):
            import numpy as np

            count = round(sound.BLOCK_SECONDS * self.rate)
            while self._next + sound.BLOCK_SECONDS <= time.monotonic():
                times = self._next + np.arange(count) / self.rate
                word = (30 * times) % self._cycle % 30
                tone = np.sin((150 + 20 * word) * word)  # rises: words of two takes cannot silence each other
                yield sound.Block(self._next, (0.4 * tone * (word < 9)).astype(np.float32))
                self._next += sound.BLOCK_SECONDS

        def close(self):
            pass

    sound.Microphone = Microphone


sys.meta_path.insert(0, _Patch("capture.sound", _plug_in_microphone))
sys.meta_path.insert(0, _Patch("capture.sources.registry", _open_camera))
sys.meta_path.insert(0, _Patch("engine_bridge.inspection.sensors", _plug_in_camera))
sys.meta_path.insert(0, _Patch("engine_bridge.studio.long_work.installation", _install_camera))
