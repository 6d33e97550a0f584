"""NiTE2 as a tracker, with a stand-in for the library: these tests do not run NiTE2 itself.

The sensor is virtual, and the OpenNI2 library is real; see nite_stand_in.cpp and virtual_sensor.cpp.
"""

import ctypes
import logging
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from capture.sensors import openni
from capture.sensors.depth_camera import Selection
from capture.sensors.openni import OpenNIDevice, open_source
from capture.skeleton import INFERRED, JOINT_INDEX, LOST, TRACKED
from capture.trackers import nite
from capture.trackers.nite import NiTE, library_path
from puppetline.errors import SourceError

from ...outside import OPENNI_HEADERS
from ...waiting import wait_until
from ..conftest import Watched

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
    folder = tmp_path_factory.mktemp("nite")
    source = Path(__file__).parent / "nite_stand_in.cpp"
    command = [
        "g++",
        "-std=c++17",
        "-O2",
        "-fPIC",
        "-shared",
        "-Wall",
        "-Wno-return-type-c-linkage",
        f"-I{OPENNI_HEADERS}",
    ]
    library = next(openni_folder.glob("libOpenNI2*"))
    subprocess.run([*command, "-o", folder / "libNiTE2.so", source, library], check=True, capture_output=True)
    return folder / "libNiTE2.so"


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

    def shown(moment):
        sensor.show(np.zeros((480, 640), np.uint16), np.zeros((480, 640, 3), np.uint8), moment)

    return shown


@pytest.fixture
def look(stand_in, show):
    """Open the sensor with NiTE2; `look(time)` returns the performers in an image of that time."""
    with closing(OpenNIDevice(NAME, Selection())) as device, closing(device.nite()) as tracker:

        def looked(moment):
            show(moment)
            while (picture := device.read(1.0)) is None:
                pass
            assert picture.time == pytest.approx(moment)
            return tracker.track(picture)

        yield looked


@pytest.fixture
def track(stand_in, look, body):
    """Show a user with `body` until NiTE2 has calibrated them; return the performer."""

    def tracked(confidence=1.0):
        stand_in.show(4, NEW, CALIBRATED, body, confidence)
        assert look(1.0) == []  # calibration has only started
        [person] = look(1.1)
        assert person.user == 4
        return person

    return tracked


@pytest.fixture
def body(standing):
    """(15, 3) joints of `standing` in NiTE2's coordinates: millimetres, x to the right of the image."""
    return standing[OURS] * [-1000, 1000, 1000]


class FoundNobody:
    name = "MediaPipe's place"

    def track(self, _picture):
        return []

    def close(self):
        pass


@pytest.fixture
def opened(sensor, monkeypatch):
    """Open `openni:` with a stand-in for MediaPipe that finds nobody."""
    monkeypatch.setattr(openni, "load_mediapipe", lambda: None)
    monkeypatch.setattr(openni, "MediaPipePose", FoundNobody)
    sources = []

    def openni_source():
        sources.append(open_source(NAME, "", Path()))
        return Watched(sources[-1])

    yield openni_source
    for source in sources:
        source.close()
        source._done.wait(10)


def test_a_calibrated_user_is_a_performer_with_the_librarys_positions_and_confidence(track, standing):
    confidence = np.linspace(0.6, 1.0, 15)
    person = track(confidence)
    np.testing.assert_allclose(person.positions[OURS], standing[OURS], atol=1e-6)
    np.testing.assert_array_equal(person.confidence[OURS], confidence.astype(np.float32))


def test_a_performers_right_hand_is_at_the_left_of_the_image(track, body):
    body[LEFT_HAND] = -500, 200, 2000
    np.testing.assert_allclose(track().positions[JOINT_INDEX["hand_right"]], [0.5, 0.2, 2.0], atol=1e-6)


def test_sides_of_a_sensor_that_stays_mirrored_are_the_performers_own(sensor, stand_in, show, body):
    sensor.unplug()
    sensor.plug(refuses=["mirror off"])
    body[LEFT_HAND] = -500, 200, 2000
    stand_in.show(1, NEW, CALIBRATED, body)
    with closing(OpenNIDevice(NAME, Selection())) as device, closing(device.nite()) as tracker:
        for moment in (1.0, 1.1):
            show(moment)
            while (picture := device.read(1.0)) is None:
                pass
            people = tracker.track(picture)
    [person] = people
    np.testing.assert_allclose(person.positions[JOINT_INDEX["hand_left"]], [-0.5, 0.2, 2.0], atol=1e-6)


def test_joints_that_the_library_lacks_are_interpolated_and_inferred(track):
    person = track()
    joints = dict(zip(JOINT_INDEX, person.positions, strict=True))
    made = ["hip_center", "wrist_left", "wrist_right", "ankle_left", "ankle_right"]
    for side in ("left", "right"):
        wrist = 0.25 * joints[f"elbow_{side}"] + 0.75 * joints[f"hand_{side}"]
        np.testing.assert_allclose(joints[f"wrist_{side}"], wrist, atol=1e-6)
        ankle = 0.15 * joints[f"knee_{side}"] + 0.85 * joints[f"foot_{side}"]
        np.testing.assert_allclose(joints[f"ankle_{side}"], ankle, atol=1e-6)
    np.testing.assert_allclose(joints["hip_center"], (joints["hip_left"] + joints["hip_right"]) / 2, atol=1e-6)
    assert [name for name, k in JOINT_INDEX.items() if person.confidence[k] == INFERRED] == sorted(
        made, key=JOINT_INDEX.__getitem__
    )
    assert (person.confidence[OURS] == TRACKED).all()


@pytest.mark.parametrize("bad", ["confidence 0", "no number"])
def test_a_lost_joint_also_loses_the_joint_interpolated_from_it(track, body, bad):
    confidence = np.ones(15)
    if bad == "no number":
        body[LEFT_HAND] = np.nan
    else:
        confidence[LEFT_HAND] = 0
    person = track(confidence)
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


def test_several_users_are_several_performers(stand_in, look, body):
    stand_in.add(1, NEW, CALIBRATED, body)
    stand_in.add(2, NEW, CALIBRATED, body + np.array([800, 0, 0]))
    stand_in.add(3, NEW, CALIBRATING, body)
    look(1.0)
    first, second = look(1.1)
    assert (first.user, second.user) == (1, 2)
    np.testing.assert_allclose(second.positions - first.positions, np.tile([-0.8, 0, 0], (20, 1)), atol=1e-6)


def test_an_image_that_the_library_does_not_process_is_an_error(stand_in, look, monkeypatch):
    look(1.0)
    monkeypatch.setattr(nite, "TIMEOUT_SECONDS", 0.1)
    stand_in.refuse(ANSWERING)
    with pytest.raises(SourceError, match=r"NiTE2: found no result from NiTE2 for 0\.1 s"):
        look(1.1)


def test_a_library_that_fails_later_is_an_error_and_the_sensor_is_released(stand_in, opened, sensor, show, caplog):
    caplog.set_level(logging.INFO, "capture")
    watched = opened()
    wait_until(lambda: "openni: tracking images of Puppetline virtual sensor 0 with NiTE2" in caplog.messages)
    stand_in.refuse(READING)
    show(1.0)
    assert watched.error().found == "the status 1 of niteReadUserTrackerFrame"
    assert (stand_in.held, sensor.streaming) == ((0, 0), 0)


@pytest.mark.parametrize(
    ("refusal", "call"), [(STARTING, "niteInitialize"), (TRACKING, "niteInitializeUserTrackerByDevice")]
)
def test_mediapipe_tracks_if_the_library_does_not_start(stand_in, opened, sensor, caplog, monkeypatch, refusal, call):
    caplog.set_level(logging.INFO, "capture")
    monkeypatch.setattr(nite, "_started", False)
    stand_in.refuse(refusal)
    opened()
    sensor.wait_for_streams()
    wait_until(
        lambda: "openni: tracking images of Puppetline virtual sensor 0 with MediaPipe's place" in caplog.messages
    )
    [said] = [record for record in caplog.records if record.levelname == "WARNING"]
    assert "tracking with MediaPipe, because NiTE2 did not start" in said.getMessage()
    assert f"the status 1 of {call};" in said.getMessage()
    assert "s.dat" in said.getMessage()


def test_mediapipe_tracks_without_the_library(opened, sensor, caplog, monkeypatch, tmp_path):
    caplog.set_level(logging.INFO, "capture")
    monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
    assert library_path() is None
    opened()
    sensor.wait_for_streams()
    wait_until(
        lambda: "openni: tracking images of Puppetline virtual sensor 0 with MediaPipe's place" in caplog.messages
    )
    said = "Puppetline virtual sensor 0: tracking with MediaPipe, because NiTE2 is not installed (or set NITE2_REDIST)"
    assert said in caplog.messages


@pytest.mark.usefixtures("openni_folder")
def test_a_file_that_is_not_a_library_is_an_error(tmp_path, monkeypatch):
    from openni import _nite2

    (tmp_path / "libNiTE2.so").write_bytes(b"no library")
    monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
    monkeypatch.setattr(_nite2, "_the_dll", None)
    with pytest.raises(SourceError, match="a library that cannot be loaded") as caught:
        NiTE(None, False)
    assert "NITE2_REDIST" in caught.value.fix
