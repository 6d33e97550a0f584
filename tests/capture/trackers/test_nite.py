"""NiTE2 as a tracker, with a stand-in for the library: these tests do not run NiTE2 itself.

The sensor is virtual, and the OpenNI2 library is real; see nite_stand_in.cpp and virtual_sensor.cpp.
"""

import ctypes
import logging
import subprocess
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.sensors import openni
from capture.sensors.depth_camera import Selection
from capture.sensors.openni import OpenNIDevice, open_source
from capture.skeleton import JOINT_INDEX, LOST, TRACKED
from capture.trackers import nite
from capture.trackers.nite import NiTE, library_path

from ...outside import OPENNI_HEADERS
from ...waiting import wait_until
from ..conftest import ScriptedTracker, Watched, read, refused
from ..network.conftest import assert_of_fifteen

NAME = "openni:"

NEW, VISIBLE, OUT_OF_SIGHT, GONE = 3, 1, 0, 4
CALIBRATING, CALIBRATED, NO_LEGS = 1, 2, 6
STARTING, TRACKING, READING, ANSWERING = 1, 2, 4, 8

PARTS = ["head", "shoulder_center", "shoulder_?", "elbow_?", "hand_?", "spine", "hip_?", "knee_?", "foot_?"]
LEFT_IN_THE_IMAGE = "right"  # side of a performer who faces the sensor
OURS = [
    JOINT_INDEX[part.replace("?", side)]
    for part in PARTS
    for side in ([LEFT_IN_THE_IMAGE, "left"] if "?" in part else [""])
]
"""Indices of NiTE2's joints, in its order; its left is the left of the image."""
LEFT_HAND = 6  # in NiTE2's order


class StandIn:
    """The stand-in's functions."""

    def __init__(self, path):
        self._library = ctypes.CDLL(str(path))
        self.refuse = self._library.stand_in_refuse
        self.clear = self._library.stand_in_clear

    def show(self, user, state, skeleton, joints, confidence=1.0):
        """Replace all users by this one; see `add`."""
        self.clear()
        self.add(user, state, skeleton, joints, confidence)

    def add(self, user, state, skeleton, joints, confidence=1.0):
        """Add a user with NiTE2's joints, (15, 3) millimetres, and their confidence."""
        rows = np.empty((15, 4), np.float32)
        rows[:, :3], rows[:, 3] = joints, confidence
        self._library.stand_in_show(user, state, skeleton, rows.ctypes.data_as(ctypes.c_void_p))

    @property
    def held(self):
        """Numbers of trackers and frames that are not released."""
        return self._library.stand_in_trackers(), self._library.stand_in_frames()


@pytest.fixture(scope="session")
def _stand_in(openni_folder, tmp_path_factory):
    library = tmp_path_factory.mktemp("nite") / "libNiTE2.so"
    command = f"g++ -std=c++17 -O2 -fPIC -shared -Wall -Wno-return-type-c-linkage -I{OPENNI_HEADERS} -o".split()
    parts = Path(__file__).with_name("nite_stand_in.cpp"), next(openni_folder.glob("libOpenNI2*"))
    subprocess.run([*command, library, *parts], check=True, capture_output=True)
    return library


@pytest.fixture
def stand_in(virtual_sensors, _stand_in, monkeypatch):  # in this order; otherwise it loads a second OpenNI2 library
    """The stand-in in NiTE2's place, without users."""
    monkeypatch.setenv("NITE2_REDIST", str(_stand_in.parent))
    found = StandIn(_stand_in)
    found.refuse(0)
    found.clear()
    yield found
    assert found.held == (0, 0)


@pytest.fixture
def show(sensor):
    """Let the sensor show a black image: `show(time)`."""
    return lambda moment: sensor.show(np.zeros((480, 640), np.uint16), np.zeros((480, 640, 3), np.uint8), moment)


@pytest.fixture
def open_nite(stand_in, show, until_end):
    """Open the sensor with NiTE2; return a function that returns the performers in an image of a time."""

    def opened():
        device = until_end(OpenNIDevice(NAME, Selection()))
        tracker = until_end(device.nite())

        def looked(moment):
            show(moment)
            picture = read(device)
            assert picture.time == pytest.approx(moment)
            return tracker.track(picture)

        return looked

    return opened


@pytest.fixture
def look(open_nite):
    return open_nite()


@pytest.fixture
def body(performer):
    """(15, 3) joints of `performer` in NiTE2's coordinates: millimetres, x to the right of the image."""
    return performer[OURS] * [-1000, 1000, 1000]


@pytest.fixture
def opened(sensor, monkeypatch):
    """Open `openni:` with a stand-in for MediaPipe that finds nobody."""
    monkeypatch.setattr(nite, "_started", False)
    monkeypatch.setattr(openni, "load_mediapipe", lambda: None)
    monkeypatch.setattr(openni, "MediaPipePose", ScriptedTracker)
    source = open_source(NAME, "", Path())
    yield Watched(source)
    source.close()
    source._done.wait(10)


def test_calibrated_users_are_performers_with_the_librarys_joints_and_those_between_them(
    stand_in, look, body, performer
):
    confidence = np.linspace(0.6, 1.0, 15)
    stand_in.add(4, NEW, CALIBRATED, body)
    stand_in.add(5, NEW, CALIBRATED, body + np.array([800, 0, 0]), confidence)
    stand_in.add(6, NEW, CALIBRATING, body)
    assert look(1.0) == []  # calibration has only started
    first, second = look(1.1)
    assert (first.user, second.user) == (4, 5)
    assert_of_fifteen(first.positions, first.confidence, performer)
    assert_allclose(second.positions, first.positions - [0.8, 0, 0], atol=1e-6)
    assert_array_equal(second.confidence[OURS], confidence.astype(np.float32))


def test_sides_of_a_sensor_that_stays_mirrored_are_the_performers_own(sensor, stand_in, open_nite, body):
    sensor.unplug()
    sensor.plug(refuses=["mirror off"])
    body[LEFT_HAND] = -500, 200, 2000
    stand_in.show(1, NEW, CALIBRATED, body)
    look = open_nite()
    look(1.0)
    [person] = look(1.1)
    assert_allclose(person.positions[JOINT_INDEX["hand_left"]], [-0.5, 0.2, 2.0], atol=1e-6)


@pytest.mark.parametrize(("sure", "factor"), [(0, 1), (1, np.nan)])
def test_a_lost_joint_also_loses_the_joint_interpolated_from_it(stand_in, look, body, sure, factor):
    confidence = np.ones(15)
    confidence[LEFT_HAND] = sure
    body[LEFT_HAND] *= factor
    stand_in.show(4, NEW, CALIBRATED, body, confidence)
    look(1.0)
    [person] = look(1.1)
    lost = [name for name, k in JOINT_INDEX.items() if person.confidence[k] == LOST]
    assert lost == ["wrist_right", "hand_right"]


def test_a_user_out_of_view_has_every_joint_lost_until_the_library_drops_them(stand_in, look, body):
    stand_in.show(1, NEW, CALIBRATED, body)
    look(1.0)
    stand_in.show(1, OUT_OF_SIGHT, CALIBRATED, body)
    [person] = look(1.1)
    assert (person.confidence == LOST).all()
    stand_in.show(1, VISIBLE, CALIBRATED, body)
    [person] = look(1.2)
    assert (person.confidence[OURS] == TRACKED).all()
    stand_in.show(1, GONE, CALIBRATED, body)
    assert look(1.3) == []
    stand_in.show(1, NEW, CALIBRATED, body)
    assert look(1.4) == []  # a new user, not calibrated yet
    assert len(look(1.5)) == 1


def test_uncalibrated_users_have_no_joints_and_the_log_says_why_once(stand_in, look, body, caplog):
    caplog.set_level(logging.INFO, "capture.trackers.nite")
    stand_in.show(1, NEW, CALIBRATING, body)
    assert [look(moment) for moment in (1.0, 1.1, 1.2)] == [[], [], []]
    stand_in.show(1, VISIBLE, NO_LEGS, body)
    assert [look(moment) for moment in (1.3, 1.4)] == [[], []]
    assert caplog.messages == [
        "NiTE2: user 1 is being calibrated: stand upright and face the sensor",
        "NiTE2: user 1 cannot be calibrated: the legs are not in view",
    ]


def test_an_image_that_the_library_does_not_process_is_an_error(stand_in, look, monkeypatch):
    look(1.0)
    monkeypatch.setattr(nite, "TIMEOUT_SECONDS", 0.1)
    stand_in.refuse(ANSWERING)
    refused(look, 1.1)


def tracking_with(caplog, tracker):
    """Wait until the sensor is being tracked with a tracker."""
    wait_until(lambda: f"openni: tracking images of Puppetline virtual sensor 0 with {tracker}" in caplog.messages)


@pytest.mark.usefixtures("standing")
def test_a_library_that_fails_later_is_an_error_and_the_sensor_is_released(caplog, stand_in, sensor, show, request):
    caplog.set_level(logging.INFO, "capture")
    watched = request.getfixturevalue("opened")
    tracking_with(caplog, "NiTE2")
    stand_in.refuse(READING)
    show(1.0)
    assert watched.error().found == "the status 1 of niteReadUserTrackerFrame"
    assert (stand_in.held, sensor.streaming) == ((0, 0), 0)


@pytest.mark.usefixtures("standing")
@pytest.mark.parametrize(
    ("refusal", "says"),
    [
        (STARTING, "the status 1 of niteInitialize;"),
        (TRACKING, "the status 1 of niteInitializeUserTrackerByDevice;"),
        (None, "NiTE2 is not installed"),
    ],
)
def test_mediapipe_tracks_without_the_library_or_if_it_does_not_start(
    stand_in, sensor, caplog, monkeypatch, tmp_path, request, refusal, says
):
    caplog.set_level(logging.INFO, "capture")
    if refusal is None:
        monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
        assert library_path() is None
    stand_in.refuse(refusal or 0)
    request.getfixturevalue("opened")
    sensor.wait_for_streams()
    tracking_with(caplog, ScriptedTracker.name)
    assert any(says in message and "tracking with MediaPipe" in message for message in caplog.messages)


@pytest.mark.usefixtures("openni_folder")
def test_a_file_that_is_not_a_library_is_an_error(tmp_path, monkeypatch):
    from openni import _nite2

    (tmp_path / "libNiTE2.so").write_bytes(b"no library")
    monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
    monkeypatch.setattr(_nite2, "_the_dll", None)
    assert "NITE2_REDIST" in refused(NiTE, None, False).fix
