"""Debian's libfreenect, and its fakenect with images from the tests, in processes of their own."""

import ctypes.util
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.sensors import freenect
from capture.sensors.depth_camera import metres
from capture.sensors.freenect import LENS, UDEV_RULES, FreenectDevice, open_source

from ..conftest import refused

ROWS, COLUMNS = np.mgrid[:480, :640]

FRAME = 2_002_000
"""Ticks from one image to the next."""

READ = """
import sys
import numpy as np
from capture.sensors.depth_camera import metres
from capture.sensors.freenect import FreenectDevice
from puppetline.errors import SourceError
devices, pictures = [], []
try:
    for index in map(int, sys.argv[3:]):
        devices.append(FreenectDevice(f"freenect:{index or ''}", index))
    while len(pictures) < int(sys.argv[2]) and (picture := devices[len(pictures) % len(devices)].read(0.5)):
        pictures.append(picture)
except SourceError as error:
    print("SourceError", error)
print("closed", *(device.close() for device in 2 * devices))
np.savez(
    sys.argv[1],
    times=[picture.time for picture in pictures],
    depths=[picture.depth for picture in pictures],
    colors=[picture.color for picture in pictures],
)
"""


@pytest.fixture
def read(run_with_kinect, tmp_path):
    """Read images of a dump in another process, of sensors in turn: `run(dump, count)` returns it and the images."""

    def run(dump, count, fault="", sensors=(0,)):
        process = run_with_kinect(dump, READ, tmp_path / "read.npz", count, *sensors, fault=fault)
        return process, np.load(tmp_path / "read.npz")

    return run


def depth_of(number):
    """Return a slope with a hole, in metres, that differs for each number."""
    depth = metres((1000 + 100 * number + 3 * COLUMNS + ROWS).astype(np.uint16))
    depth[100:110, 200:230] = 0
    return depth


def color_of(number):
    """Return an image whose red grows to the right and green downwards; blue encodes the number."""
    return np.dstack([COLUMNS * 255 // 639, ROWS * 255 // 479, np.full((480, 640), 40 * number)]).astype(np.uint8)


def assert_shows(seen, *numbers):
    """Check that images of these numbers were read."""
    assert_array_equal(seen["depths"], list(map(depth_of, numbers)))
    assert_array_equal(seen["colors"], list(map(color_of, numbers)))


SIX_IMAGES = [each for n in range(6) for each in ((depth_of(n), n * FRAME), (color_of(n), n * FRAME))]


def test_depth_and_colour_arrive_unchanged_on_a_clock_that_does_not_overflow(read, write_dump):
    start, shows = 2**32 - 2 * FRAME, ((depth_of, 0), (color_of, FRAME // 2))  # the sensor's clock overflows
    images = [(show(n), start + n * FRAME + late) for n in range(5) for show, late in shows]
    process, seen = read(write_dump(images), 5)
    assert_shows(seen, *range(5))
    assert_allclose(np.diff(seen["times"]), FRAME / 60e6, atol=1e-9)
    assert seen["times"][0] == start / 60e6
    assert LENS.unproject(np.array([320.0, 240.0]), np.array(2.0)).tolist() == [0.0, 0.0, 2.0]
    assert "closed None None" in process.stdout
    skew = "freenect: the times of depth and colour of Kinect v1 differ by 16.7 ms\n"
    assert process.stderr == f"{skew}shut down with 0 open\n"


def test_depth_without_colour_of_the_same_time_is_skipped(read, write_dump):
    dump = write_dump(
        [
            (color_of(0), 0),
            (depth_of(0), 300),
            (depth_of(1), FRAME),  # its colour is lost
            (depth_of(2), 2 * FRAME),
            (color_of(2), 2 * FRAME - 300),
            (color_of(3), 3 * FRAME),  # and this one's depth
            (depth_of(4), 4 * FRAME + 200),
            (color_of(4), 4 * FRAME),
        ]
    )
    _, seen = read(dump, 3)
    assert_shows(seen, 0, 2, 4)
    assert_allclose(seen["times"] * 60e6, [300, 2 * FRAME, 4 * FRAME + 200])


@pytest.mark.parametrize(
    ("fault", "said"),
    [("still", "closed None None"), ("unplugged", "found an unplugged Kinect (libfreenect: USB device disappeared")],
)
def test_a_sensor_that_stops_delivers_its_images_and_none_or_an_error(read, write_dump, fault, said):
    process, seen = read(write_dump(SIX_IMAGES), 6, fault)
    assert_shows(seen, *range(4))
    assert said in process.stdout
    assert process.stderr == "shut down with 0 open\n"


@pytest.mark.parametrize(
    ("fault", "found", "fix"),
    [
        ("absent", "no Kinect v1 on USB", "plug in its power supply too"),
        ("forbidden", "no permission to open the Kinect on USB", "60-libfreenect0.5.rules"),
        ("busy", "a Kinect that another program uses", "Close the other program"),
        ("broken", "(libfreenect: freenect_camera_init(): Failed to fetch zero plane info for device)", "Unplug it"),
    ],
)
def test_a_sensor_that_cannot_be_opened_is_an_error_and_nothing_stays_open(read, write_dump, fault, found, fix):
    process, _ = read(write_dump([]), 1, fault)
    (message,) = (line for line in process.stdout.splitlines() if line.startswith("SourceError"))
    assert found in message
    assert fix in message
    assert process.stderr == "shut down with 0 open\n"


def test_two_sensors_work_at_once_and_one_that_is_open_is_in_use(read, write_dump):
    """Fakenect has one sensor, so the second one is that of the stand-in kinect.c."""
    clocks = 0, 2**32 - FRAME  # that of the second sensor overflows
    images = [(shown(n), clocks[n % 2] + n // 2 * FRAME) for n in range(6) for shown in (depth_of, color_of)]
    process, seen = read(dump := write_dump(images), 6, sensors=(0, 1))
    assert_shows(seen, *range(6))
    for first, clock in enumerate(clocks):
        assert_allclose(seen["times"][first::2] * 60e6, clock + FRAME * np.arange(3))
    said = "closed None None None None\nshut down with 1 open\nshut down with 0 open\n"
    assert process.stdout + process.stderr == said
    for sensors, found in (((1, 1), "a Kinect that another program uses"), ((2,), "the number 2 for 2 Kinect v1")):
        assert f"found {found}" in read(dump, 1, sensors=sensors)[0].stdout


def test_the_stand_in_logs_the_librarys_messages_and_the_real_one_counts_sensors(freenect):
    library = freenect.read_bytes()
    for text in (
        b"Could not open camera: %d\n",
        b"Failed to claim camera interface: %s\n",
        b"USB device disappeared, cancelling stream %02x :(\n",
    ):
        assert text in library
    found = refused(FreenectDevice, "freenect:99", 99).found
    assert "the number 99" in found or found == "no Kinect v1 on USB"


@pytest.mark.usefixtures("freenect")
def test_the_udev_rule_in_the_error_is_that_of_the_package():
    rules = Path("/lib/udev/rules.d", UDEV_RULES)
    line = 'SUBSYSTEM=="usb", ATTRS{idVendor}=="045e", ATTRS{idProduct}=="02ae", GROUP="plugdev", MODE="0666"'
    assert line in rules.read_text().splitlines()


def test_a_missing_library_is_an_error_with_the_package(monkeypatch):
    monkeypatch.setattr(freenect, "LIBRARIES", ("libnosuchthing.so.0.5",))
    monkeypatch.setattr(ctypes.util, "find_library", lambda _name: None)
    assert "apt install libfreenect0.5" in refused(open_source, "freenect:", "", Path()).fix


@pytest.mark.parametrize("rest", ["x", "-1", "1?mirror", "100", "٣"])
def test_a_wrong_number_is_an_error(rest):
    refused(open_source, f"freenect:{rest}", rest, Path())
