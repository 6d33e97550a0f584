import base64
import time
from io import BytesIO
from select import select

import numpy as np
import pytest
from PIL import Image

from capture.sensors.source import SensorSource
from capture.skeleton import JOINT_INDEX
from capture.trackers.picture import Lens, Person, Picture
from engine_bridge.service import look_command
from engine_bridge.service.background_jobs import Jobs
from engine_bridge.service.look_command import Looking
from engine_bridge.service.stages import stage_runner
from engine_bridge.service.stages.stage_runner import StageRunner

TIMEOUT_SECONDS = 60.0
LENS = Lens(640, 480, 525.0)
COLOR = np.full((480, 640, 3), (200, 100, 50), np.uint8)


class Camera:
    """Shows the same image over and over."""

    name = "a camera"

    def read(self, timeout):
        time.sleep(0.01)
        return Picture(time.monotonic(), LENS, COLOR, None)

    def close(self):
        pass


class Tracker:
    """Finds a performer, or none for None."""

    name = "a tracker"

    def __init__(self, positions):
        self._positions = positions

    def track(self, _):
        if self._positions is None:
            return []
        confidence = np.ones(20, np.float32)
        confidence[JOINT_INDEX["hand_left"]] = 0.0
        return [Person(3, self._positions.astype(np.float32), confidence)]

    def close(self):
        pass


@pytest.fixture
def positions():
    """(20, 3) joints on a line in front of the sensor."""
    return np.stack([np.linspace(-0.4, 0.5, 20), np.linspace(-0.6, 0.7, 20), np.full(20, 2.5)], axis=1)


@pytest.fixture
def make_runner(make_stage, monkeypatch, tmp_path, until_end):
    """Run a stage whose camera sees a performer with these positions."""

    def make(positions):
        def opened(uri, _folder):
            return SensorSource(uri, Camera, lambda _: Tracker(positions))

        monkeypatch.setattr(stage_runner, "open_source", opened)
        return until_end(StageRunner("camera:0", make_stage(), tmp_path))

    return make


class Desk:
    """Looks as the service does, and notes the answers."""

    def __init__(self):
        self.jobs, self.answers = Jobs(), []
        self.looking = Looking(self.jobs, self._answer)

    def _answer(self, deferred, done, result):
        error = done.exception()
        self.answers.append((deferred, result(done.result()) if error is None else error))

    def turn(self, runners):
        for runner in runners:
            select([runner.source.fileno()], [], [], 0.01)
            runner.take_in()
        self.looking.advance(runners)
        for future, finish in self.jobs.take_finished():
            finish(future)

    def until(self, runners, condition):
        end = time.monotonic() + TIMEOUT_SECONDS
        while not condition():
            assert time.monotonic() < end
            self.turn(runners)


@pytest.fixture
def desk():
    made = Desk()
    yield made
    made.jobs.close()


def test_the_answer_has_the_picture_and_the_joints_where_they_are_in_it(make_runner, desk, positions):
    runner = make_runner(positions)
    desk.looking.ask(runner)
    desk.until([runner], lambda: desk.answers)
    ((_, answer),) = desk.answers
    pixels = np.asarray(Image.open(BytesIO(base64.b64decode(answer["picture"]["jpeg"]))))
    assert np.abs(pixels.astype(int) - COLOR).max() <= 4
    (performer,) = answer["performers"]
    expected = (LENS.project(positions) / [640, 480]).tolist()
    hidden = JOINT_INDEX["hand_left"]
    assert performer["joints"][hidden] is None
    for k in range(20):
        assert k == hidden or performer["joints"][k] == pytest.approx(expected[k], abs=1e-6)
    assert performer["text"].startswith("user 3: 19 of 20 joints tracked, ")
    assert "User 3: lost joints: left hand." in [reason["what"] for reason in answer["reasons"]]
    assert (answer["stage"], answer["source"]) == ("stage", "camera:0")


def test_without_a_performer_the_answer_says_why(make_runner, desk):
    runner = make_runner(None)
    desk.looking.ask(runner)
    desk.until([runner], lambda: desk.answers)
    ((_, answer),) = desk.answers
    assert answer["performers"] == []
    assert answer["picture"]["width"] == 640
    assert [reason["what"] for reason in answer["reasons"]] == ["No performer is in view."]


def test_nothing_is_remembered_unless_a_client_asks(make_runner, desk, positions, monkeypatch):
    runner = make_runner(positions)
    skeletons = runner.skeletons
    desk.until([runner], lambda: runner.skeletons > skeletons + 3)
    assert runner._monitor is None
    monkeypatch.setattr(stage_runner, "WATCHED_SECONDS", 0.2)
    runner.report()
    assert runner._monitor is not None
    desk.until([runner], lambda: runner._monitor is None)


def test_requests_that_wait_share_one_picture_and_the_next_comes_later(make_runner, desk, positions, monkeypatch):
    made = []
    monkeypatch.setattr(
        look_command, "seen", lambda stage, report: made.append(time.monotonic()) or {"number": len(made)}
    )
    runner = make_runner(positions)
    asked = [desk.looking.ask(runner) for _ in range(3)]
    desk.until([runner], lambda: len(desk.answers) == 3)
    assert desk.answers == [(deferred, {"number": 1}) for deferred in asked]
    desk.looking.ask(runner)
    desk.until([runner], lambda: len(desk.answers) == 4)
    assert desk.answers[3][1] == {"number": 2}
    assert made[1] - made[0] >= look_command.PERIOD_SECONDS


def test_a_stage_that_is_gone_is_an_error(make_runner, desk, positions):
    runner = make_runner(positions)
    deferred = desk.looking.ask(runner)
    desk.looking.advance([])
    assert desk.answers == [(deferred, look_command.NO_STAGE)]
