"""Scripted devices and trackers, virtual sensors, and a source received from like in the service."""

import math
import mmap
import os
import queue
import shutil
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from capture.events import Tick
from capture.sensors.source import SensorSource
from capture.skeleton import SkeletonFrame
from capture.source import Counts, wait
from capture.trackers.picture import Lens, Person, Picture
from puppetline import clock
from puppetline.errors import SourceError

from ..outside import OPENNI_HEADERS, found
from ..waiting import wait_until
from .bodies import STANDS

LENS = Lens(4, 3, 4.0)


class ScriptedDevice:
    """Returns the images in its queue, and raises the exceptions in it."""

    name = "a scripted device"

    def __init__(self):
        self.pictures = queue.SimpleQueue()
        self.closed = 0

    def show(self, *times, color=None):
        """Put images with these times into the queue."""
        for taken in times:
            self.pictures.put(Picture(taken, LENS, color, None))

    def read(self, timeout):
        try:
            picture = self.pictures.get(timeout=timeout)
        except queue.Empty:
            return None
        if isinstance(picture, Exception):
            raise picture
        return picture

    def close(self):
        self.closed += 1


class ScriptedTracker:
    """Finds the performers `users`, or raises `users` if it is an exception; remembers the images' times.

    All positions of a performer are the image's time.
    """

    name = "a scripted tracker"

    def __init__(self, *users):
        self.users = users
        self.seen = []
        self.closed = 0

    def track(self, picture):
        self.seen.append(picture.time)
        if isinstance(self.users, Exception):
            raise self.users
        positions = np.full((20, 3), picture.time, dtype=np.float32)
        return [Person(user, positions, np.ones(20, dtype=np.float32)) for user in self.users]

    def close(self):
        self.closed += 1


class ScriptedSource:
    """A source that returns one list of a script per call, or raises its exception; nothing at the end."""

    def __init__(self, *script, name="scripted", ahead=0.0, recorded=False, **counts):
        self.name, self.script, self.counts, self.ahead = name, list(script), Counts(**counts), ahead
        self.recorded, self.closed = recorded, False

    def fileno(self):
        return None

    def due(self):
        return clock.now() if self.script else math.inf

    def now(self):
        return clock.now() + self.ahead

    def receive(self):
        found = self.script.pop(0) if self.script else []
        if isinstance(found, Exception):
            raise found
        return found

    def close(self):
        self.closed = True


class Watched:
    """A source, received from like in the service."""

    def __init__(self, watched):
        self.source = watched

    def events(self, count=1, until=None):
        """Return the next events without ticks, at least `count`, or until a condition is true."""
        found = []

        def enough():
            if until(found) if until else len(found) >= count:
                return True
            wait(self.source, math.inf)
            found.extend(event for event in self.source.receive() if not isinstance(event, Tick))
            return False

        wait_until(enough)
        return found

    def frames(self, count=1):
        """Return the next frames, at least `count`."""
        events = self.events(until=lambda found: sum(isinstance(each, SkeletonFrame) for each in found) >= count)
        return [each for each in events if isinstance(each, SkeletonFrame)]

    def error(self):
        """Return the error that ends it."""
        with pytest.raises(Exception) as caught:  # noqa: PT011
            self.events(until=lambda _: False)
        assert not isinstance(caught.value, AssertionError), caught.value
        return caught.value


@pytest.fixture
def standing(given_clock):
    """A clock that only the test moves, for sources whose threads work in their own time."""
    with given_clock.standing():
        yield given_clock


@pytest.fixture
def scripted_device():
    return ScriptedDevice()


@pytest.fixture
def scripted_tracker():
    return ScriptedTracker(1)


@pytest.fixture
def watch(until_end, scripted_device, scripted_tracker):
    """Open a source of the scripted device and tracker, or of other ones, or of functions that open them."""

    def opened(device=scripted_device, tracker=scripted_tracker, **options):
        open_device = device if callable(device) else lambda: device
        open_tracker = tracker if callable(tracker) else lambda _device: tracker
        return Watched(until_end(SensorSource("test:", open_device, open_tracker, **options)))

    return opened


class VirtualSensor:
    """A sensor of virtual_sensor.cpp: shared images of 640×480, and its plug.

    Its horizontal field of view is 1 radian.
    """

    lens = Lens(640, 480, 320 / np.tan(0.5))
    refusals = ("opening", "registration", "synchronisation", "mirror off")

    def __init__(self, path):
        head, pixels = 32, self.lens.width * self.lens.height
        path.write_bytes(bytes(head + 5 * pixels))
        with path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        self._plugged, self._listed, self._shown, self._given, self._streaming, self._refuses = (
            np.frombuffer(self._map, np.uint32, 1, 4 * k) for k in range(6)
        )
        self._time = np.frombuffer(self._map, np.uint64, 1, 24)
        shape = self.lens.height, self.lens.width
        self._depth = np.frombuffer(self._map, np.uint16, pixels, head).reshape(shape)
        self._color = np.frombuffer(self._map, np.uint8, 3 * pixels, head + 2 * pixels).reshape(*shape, 3)
        self.uri, self.serial = f"virtual/{path.name}", f"serial-{path.name}"

    def plug(self, refuses=()):
        """Plug it in, without some of its functions in `refusals`."""
        self.refuse(*refuses)
        self._plugged[:] = 1
        wait_until(lambda: self._listed[0])

    def refuse(self, *what):
        """Disable some of its functions in `refusals`."""
        self._refuses[:] = sum(1 << self.refusals.index(each) for each in what)

    def unplug(self):
        self._plugged[:] = 0
        wait_until(lambda: not self._listed[0])

    def show(self, depth, color, moment):
        """Show metres and RGB at a time of the sensor's clock, in seconds; return when they were delivered."""
        self.wait_for_streams()
        self._depth[:], self._color[:], self._time[:] = np.rint(1000 * depth), color, round(moment * 1e6)
        self._shown += 1
        wait_until(lambda: self._given == self._shown)

    def wait_for_streams(self):
        """Wait until depth and colour are being streamed."""
        wait_until(lambda: self._streaming == 2)

    @property
    def streaming(self):
        """Number of running streams."""
        return int(self._streaming[0])


@pytest.fixture(scope="session")
def openni_folder(tmp_path_factory):
    """Folder of the real OpenNI2 library with its driver of files and that of virtual sensors, for this process."""
    library = found("openni")
    folder = tmp_path_factory.mktemp("openni")
    drivers = folder / "OpenNI2" / "Drivers"
    drivers.mkdir(parents=True)
    shutil.copy(library, folder)
    shutil.copy(library.parent / "OpenNI2" / "Drivers" / "libOniFile.so.0", drivers)
    command = ["g++", "-std=c++17", "-O2", "-fPIC", "-shared", f"-I{OPENNI_HEADERS}"]
    source = Path(__file__).parent / "sensors" / "virtual_sensor.cpp"
    subprocess.run([*command, "-o", drivers / "libVirtualSensor.so.0", source], check=True, capture_output=True)
    os.environ["OPENNI2_REDIST"] = str(folder)
    return folder


@pytest.fixture(scope="session")
def _virtual_sensors(openni_folder):
    os.environ["PUPPETLINE_VIRTUAL_SENSORS"] = str(openni_folder)
    return [VirtualSensor(openni_folder / str(k)) for k in range(2)]


@pytest.fixture
def virtual_sensors(_virtual_sensors):
    """Two sensors, unplugged, that the real OpenNI2 library finds in this process once they are plugged in."""
    from capture.sensors.openni_library import load_openni2

    load_openni2("test")
    yield _virtual_sensors
    for sensor in _virtual_sensors:
        sensor.unplug()


@pytest.fixture
def sensor(virtual_sensors):
    """A virtual sensor that is plugged in."""
    virtual_sensors[0].plug()
    return virtual_sensors[0]


@pytest.fixture(scope="session")
def record(_virtual_sensors):
    """Record depth and colour of a sensor that is plugged in, at even steps, with OpenNI2's recorder.

    On a busy machine, the recorder skips images; then the recording is repeated.
    """
    from capture.sensors.depth_camera import Selection
    from capture.sensors.openni import OpenNIDevice
    from capture.sensors.openni_library import load_openni2

    bindings = load_openni2("test")

    def once(sensor, path, pictures, step):
        with closing(OpenNIDevice("openni:", Selection())) as device:
            recorder = bindings.Recorder(os.fsencode(path))
            for stream in device._streams.values():
                recorder.attach(stream)
            recorder.start()
            for k, (depth, color) in enumerate(pictures):
                sensor.show(depth, color, 3.0 + k * step)
                read(device)
            recorder.stop()
            recorder.close()

    def recorded(sensor, path, pictures, step):
        for _ in range(5):
            once(sensor, path, pictures, step)
            if len(data_of(path.read_bytes())) == 2 * len(pictures):
                return
        pytest.fail("OpenNI2's recorder left pictures out five times")

    return recorded


def read(device):
    """Return the next image of a device."""
    return wait_until(lambda: device.read(0.5))


def refused(function, *args, **options):
    """Return the error of a source with which a function ends."""
    with pytest.raises(SourceError) as caught:
        function(*args, **options)
    return caught.value


def data_of(content):
    """Return where the depths and colours are in a recording, in the order of time."""
    found, place = [], 24
    while (kind := int.from_bytes(content[place + 4 : place + 8], "little")) != 11:
        own, size = (int.from_bytes(content[place + at : place + at + 4], "little") for at in (12, 16))
        if kind == 10:
            found.append(slice(place + own, place + own + size))
        place += own + size
    return found


@pytest.fixture(scope="session")
def freenect():
    """The path of Debian's libfreenect."""
    return found("freenect")


@pytest.fixture(scope="session")
def fakenect(freenect, tmp_path_factory):
    """A folder with fakenect, behind a library of the tests that has libfreenect's name."""
    folder, name, other = tmp_path_factory.mktemp("fakenect"), "libfreenect.so.0.5", "libfakenect.so.0.5"
    content = (freenect.parent / "fakenect" / freenect.name).read_bytes()
    (folder / other).write_bytes(content.replace(f"{name}\0".encode(), f"{other}\0".encode()))
    source = Path(__file__).parent / "sensors" / "kinect.c"
    link = f"-Wl,-soname,{name},--no-as-needed,-rpath,$ORIGIN"
    subprocess.run(
        ["gcc", "-shared", "-fPIC", source, "-o", folder / name, link, "-L", folder, f"-l:{other}"], check=True
    )
    return folder


@pytest.fixture
def run_with_kinect(fakenect):
    """Run a program that finds fakenect where the library would be: `run(dump, program, *arguments)`, to its end."""

    def run(dump, program, *arguments, fault=""):
        environment = {"LD_LIBRARY_PATH": str(fakenect), "FAKENECT_PATH": str(dump), "KINECT_FAULT": fault}
        return subprocess.run(
            [sys.executable, "-c", program, *map(str, arguments)],
            env=os.environ | environment,
            capture_output=True,
            text=True,
            timeout=240,
            check=True,
        )

    return run


@pytest.fixture
def write_dump(tmp_path):
    """Write a dump for fakenect: depth in metres or colours with their ticks, in order of arrival."""

    def write(pictures, interval=0.01):
        folder = tmp_path / "dump"
        folder.mkdir()
        names = []
        for number, (picture, ticks) in enumerate(pictures):
            kind, header = ("d", b"P5 640 480 65535\n") if picture.ndim == 2 else ("r", b"P6 640 480 255 \n")
            names.append(f"{kind}-{100 + interval * number:.6f}-{ticks % 2**32}.p")
            pixels = np.rint(1000 * picture).astype(np.uint16) if kind == "d" else picture
            (folder / names[-1]).write_bytes(header + pixels.tobytes())
        (folder / "INDEX.txt").write_text("".join(f"{name}\n" for name in names))
        return folder

    return write


@pytest.fixture
def performer():
    """(20, 3) joints of a performer who faces the sensor, 2.5 m away, with the right arm up."""
    return STANDS + np.array([0.1, 0.05, 2.5])
