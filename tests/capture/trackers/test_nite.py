"""NiTE2 as a tracker, with a stand-in for the library: nothing here says that NiTE2 itself was run.

The sensor is a virtual one, the OpenNI2 library between them is real; see nite_stand_in.cpp and virtual_sensor.cpp.
"""

import ctypes
import logging
import subprocess
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from capture.events import Lost, Tick
from capture.sensors import openni
from capture.sensors.openni import OpenNIDevice, Place, open_openni
from capture.skeleton import INFERRED, JOINT_INDEX, LOST, TRACKED, SkeletonFrame
from capture.trackers import nite
from capture.trackers.nite import NiTE, library_path
from puppetline.errors import SourceError

from ..devices import HEADERS, PATIENCE, Watched

NAME = "openni:"

NEW, VISIBLE, OUT_OF_SIGHT, GONE = 3, 1, 0, 4
CALIBRATING, CALIBRATED, NO_LEGS = 1, 2, 6
STARTING, TRACKING, READING, ANSWERING = 1, 2, 4, 8

PARTS = ["head", "shoulder_center", "shoulder_?", "elbow_?", "hand_?", "spine", "hip_?", "knee_?", "foot_?"]
AT_THE_LEFT_OF_THE_PICTURE = "right"  # is a performer's own side, who faces the sensor
OURS = [
    JOINT_INDEX[part.replace("?", side)]
    for part in PARTS
    for side in ([AT_THE_LEFT_OF_THE_PICTURE, "left"] if "?" in part else [""])
]
"""The joints of NiTE2, in its order: it calls left what is at the left of the picture."""


class StandIn:
    """The stand-in's own functions."""

    def __init__(self, path):
        self._library = ctypes.CDLL(str(path))
        self.refuse = self._library.stand_in_refuse
        self.clear = self._library.stand_in_clear

    def show(self, user, state, skeleton, joints, confidence=1.0):
        """Have this user be there, and no other; see `add`."""
        self.clear()
        self.add(user, state, skeleton, joints, confidence)

    def add(self, user, state, skeleton, joints, confidence=1.0):
        """Put in a user, of the (15, 3) millimetres that NiTE2 would give and their confidence."""
        rows = np.empty((15, 4), np.float32)
        rows[:, :3], rows[:, 3] = joints, confidence
        self._library.stand_in_show(user, state, skeleton, rows.ctypes.data_as(ctypes.c_void_p))

    @property
    def held(self):
        """How many trackers and frames are not given back."""
        return self._library.stand_in_trackers(), self._library.stand_in_frames()


@pytest.fixture(scope="session")
def _stand_in(openni_folder, tmp_path_factory):
    folder = tmp_path_factory.mktemp("nite")
    source = Path(__file__).parent / "nite_stand_in.cpp"
    command = ["g++", "-std=c++17", "-O2", "-fPIC", "-shared", "-Wall", "-Wno-return-type-c-linkage", f"-I{HEADERS}"]
    library = next(openni_folder.glob("libOpenNI2*"))
    subprocess.run([*command, "-o", folder / "libNiTE2.so", source, library], check=True, capture_output=True)
    return folder / "libNiTE2.so"


@pytest.fixture
def stand_in(virtual_sensors, _stand_in, monkeypatch):  # in that order, or it has an OpenNI2 library of its own
    """The stand-in, where Puppetline looks for NiTE2, with nobody in it."""
    monkeypatch.setenv("NITE2_REDIST", str(_stand_in.parent))
    found = StandIn(_stand_in)
    found.refuse(0)
    found.clear()
    yield found
    assert found.held == (0, 0)


@pytest.fixture
def sensor(virtual_sensors):
    virtual_sensors[0].plug()
    return virtual_sensors[0]


@pytest.fixture
def show(sensor):
    """Have the sensor show a black picture at a moment."""

    def shown(moment):
        sensor.show(np.zeros((480, 640), np.uint16), np.zeros((480, 640, 3), np.uint8), moment)

    return shown


@pytest.fixture
def look(stand_in, show):
    """Open the sensor and NiTE2 on it; `look(moment)` returns who is in the picture of that moment."""
    with closing(OpenNIDevice(NAME, Place())) as device, closing(device.nite()) as tracker:

        def looked(moment):
            show(moment)
            while (picture := device.read(1.0)) is None:
                pass
            assert picture.time == pytest.approx(moment)
            return tracker.track(picture)

        yield looked


@pytest.fixture
def body(standing):
    """(15, 3) joints of `standing` as NiTE2 has them: millimetres, x to the right of the picture."""
    return standing[OURS] * [-1000, 1000, 1000]


class FoundNobody:
    name = "MediaPipe's place"

    def track(self, _picture):
        return []

    def close(self):
        pass


@pytest.fixture
def opened(sensor, monkeypatch):
    """Open `openni:`, in which something that finds nobody is in MediaPipe's place."""
    monkeypatch.setattr(openni, "library", lambda: None)
    monkeypatch.setattr(openni, "MediaPipePose", FoundNobody)
    sources = []

    def openni_source():
        sources.append(open_openni(NAME, "", Path()))
        return Watched(sources[-1])

    yield openni_source
    for source in sources:
        source.close()
        source._done.wait(10)


def _wait_for(caplog, message):
    give_up = time.monotonic() + PATIENCE
    while message not in caplog.messages:
        assert time.monotonic() < give_up, caplog.messages
        time.sleep(0.001)


def test_a_calibrated_user_is_a_person_where_and_as_sure_as_the_library_says(stand_in, look, body, standing):
    confidence = np.linspace(0.6, 1.0, 15)
    stand_in.show(4, NEW, CALIBRATED, body, confidence)
    assert look(1.0) == []  # nobody has asked for the skeleton before
    [person] = look(1.1)
    assert person.user == 4
    np.testing.assert_allclose(person.positions[OURS], standing[OURS], atol=1e-6)
    np.testing.assert_array_equal(person.confidence[OURS], confidence.astype(np.float32))


def test_a_performers_right_hand_is_at_the_left_of_the_picture(stand_in, look, body):
    left_of_the_picture = 6  # of NiTE2's joints: what it calls the left hand
    body[left_of_the_picture] = -500, 200, 2000
    stand_in.show(1, NEW, CALIBRATED, body)
    look(1.0)
    [person] = look(1.1)
    np.testing.assert_allclose(person.positions[JOINT_INDEX["hand_right"]], [0.5, 0.2, 2.0], atol=1e-6)


def test_a_sensor_that_stays_mirrored_shows_a_mirrors_sides_which_are_the_performers_own(sensor, stand_in, show, body):
    sensor.unplug()
    sensor.plug(refuses=["mirror off"])
    body[6] = -500, 200, 2000
    stand_in.show(1, NEW, CALIBRATED, body)
    with closing(OpenNIDevice(NAME, Place())) as device, closing(device.nite()) as tracker:
        for moment in (1.0, 1.1):
            show(moment)
            while (picture := device.read(1.0)) is None:
                pass
            people = tracker.track(picture)
    [person] = people
    np.testing.assert_allclose(person.positions[JOINT_INDEX["hand_left"]], [-0.5, 0.2, 2.0], atol=1e-6)


def test_joints_that_the_library_lacks_are_between_their_neighbours_and_inferred(stand_in, look, body):
    stand_in.show(1, NEW, CALIBRATED, body)
    look(1.0)
    [person] = look(1.1)
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
def test_a_joint_that_is_not_known_is_lost_with_what_is_made_of_it(stand_in, look, body, bad):
    confidence = np.ones(15)
    if bad == "no number":
        body[6] = np.nan
    else:
        confidence[6] = 0
    stand_in.show(1, NEW, CALIBRATED, body, confidence)
    look(1.0)
    [person] = look(1.1)
    lost = [name for name, k in JOINT_INDEX.items() if person.confidence[k] == LOST]
    assert lost == ["wrist_right", "hand_right"]


def test_who_is_out_of_sight_has_every_joint_lost_until_the_library_gives_up(stand_in, look, body):
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
    assert look(1.4) == []  # somebody new, who is to be calibrated
    assert len(look(1.5)) == 1


def test_users_that_are_not_calibrated_give_no_joints_and_the_log_says_why_once(stand_in, look, body, caplog):
    caplog.set_level(logging.INFO, "capture.trackers.nite")
    stand_in.show(1, NEW, CALIBRATING, body)
    assert [look(moment) for moment in (1.0, 1.1, 1.2)] == [[], [], []]
    stand_in.show(1, VISIBLE, NO_LEGS, body)
    assert [look(moment) for moment in (1.3, 1.4)] == [[], []]
    assert caplog.messages == [
        "NiTE2: user 1 is being calibrated: stand upright and face the sensor",
        "NiTE2: user 1 cannot be calibrated: the legs are not seen",
    ]


def test_several_users_are_several_people(stand_in, look, body):
    stand_in.add(1, NEW, CALIBRATED, body)
    stand_in.add(2, NEW, CALIBRATED, body + np.array([800, 0, 0]))
    stand_in.add(3, NEW, CALIBRATING, body)
    look(1.0)
    first, second = look(1.1)
    assert (first.user, second.user) == (1, 2)
    np.testing.assert_allclose(second.positions - first.positions, np.tile([-0.8, 0, 0], (20, 1)), atol=1e-6)


def test_a_picture_that_the_library_does_not_come_to_is_an_error(stand_in, look, monkeypatch):
    look(1.0)
    monkeypatch.setattr(nite, "PATIENCE", 0.1)
    stand_in.refuse(ANSWERING)
    with pytest.raises(SourceError, match=r"NiTE2.*no result from NiTE2 for 0.1 s"):
        look(1.1)


def test_people_are_found_and_lost_through_the_source(stand_in, opened, show, body, standing, caplog):
    caplog.set_level(logging.INFO, "capture")
    watched = opened()
    _wait_for(caplog, "openni: Puppetline virtual sensor 0 gives the pictures, NiTE2 finds people in them")
    moments = iter(np.arange(1.0, 100.0, 1 / 30))

    def events():
        found = []
        while not found:
            show(next(moments))
            watched.wait()
            found = [event for event in watched.source.receive() if not isinstance(event, Tick)]
        return found

    stand_in.show(7, NEW, CALIBRATED, body)
    [frame] = events()
    assert (type(frame), frame.user) == (SkeletonFrame, 7)
    np.testing.assert_allclose(frame.positions[OURS], standing[OURS], atol=1e-6)
    stand_in.show(7, GONE, CALIBRATED, body)
    while type(found := events()[0]) is SkeletonFrame:  # of pictures before
        pass
    assert (type(found), found.user) == (Lost, 7)


def test_a_library_that_fails_in_the_middle_is_an_error_and_lets_go_of_the_sensor(
    stand_in, opened, sensor, show, caplog
):
    caplog.set_level(logging.INFO, "capture")
    watched = opened()
    _wait_for(caplog, "openni: Puppetline virtual sensor 0 gives the pictures, NiTE2 finds people in them")
    stand_in.refuse(READING)
    show(1.0)
    assert watched.error().found == "an error in niteReadUserTrackerFrame (status 1)"
    assert (stand_in.held, sensor.streaming) == ((0, 0), 0)


@pytest.mark.parametrize(
    ("refusal", "call"), [(STARTING, "niteInitialize"), (TRACKING, "niteInitializeUserTrackerByDevice")]
)
def test_a_library_that_does_not_start_leaves_it_to_mediapipe(
    stand_in, opened, sensor, caplog, monkeypatch, refusal, call
):
    caplog.set_level(logging.INFO, "capture")
    monkeypatch.setattr(nite, "_started", False)
    stand_in.refuse(refusal)
    opened()
    sensor.wait_for_streams()
    _wait_for(caplog, "openni: Puppetline virtual sensor 0 gives the pictures, MediaPipe's place finds people in them")
    [said] = [record for record in caplog.records if record.levelname == "WARNING"]
    assert "MediaPipe finds people, as NiTE2 does not start" in said.getMessage()
    assert f"an error in {call} (status 1)" in said.getMessage()
    assert "s.dat" in said.getMessage()


def test_without_a_library_it_is_mediapipe_and_the_log_says_so(opened, sensor, caplog, monkeypatch, tmp_path):
    caplog.set_level(logging.INFO, "capture")
    monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
    assert library_path() is None
    opened()
    sensor.wait_for_streams()
    _wait_for(caplog, "openni: Puppetline virtual sensor 0 gives the pictures, MediaPipe's place finds people in them")
    said = "Puppetline virtual sensor 0: no NiTE2 library (NITE2_REDIST may name its folder), so MediaPipe finds people"
    assert said in caplog.messages


@pytest.mark.usefixtures("openni_folder")
def test_a_file_that_is_no_library_is_an_error_that_says_which_is_wanted(tmp_path, monkeypatch):
    from openni import _nite2

    (tmp_path / "libNiTE2.so").write_bytes(b"no library")
    monkeypatch.setenv("NITE2_REDIST", str(tmp_path))
    monkeypatch.setattr(_nite2, "_the_dll", None)
    with pytest.raises(SourceError, match="a library that cannot be loaded") as caught:
        NiTE(None, False)
    assert "NITE2_REDIST" in caught.value.fix
