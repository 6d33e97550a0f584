import base64
import json
from io import BytesIO

import numpy as np
import pytest
from numpy.testing import assert_allclose
from PIL import Image

from capture.events import TICK_SECONDS, Tick
from capture.sensors.source import SensorSource
from capture.skeleton import JOINT_INDEX, SkeletonFrame
from capture.source import Counts
from capture.trackers.picture import Lens, Picture
from engine_bridge.service import look_command
from engine_bridge.service.stages import stage_runner
from puppetline import clock

LENS = Lens(640, 480, 525.0)
COLOR = np.full((480, 640, 3), (200, 100, 50), np.uint8)
HIDDEN = JOINT_INDEX["hand_left"]
POSITIONS = np.stack([np.linspace(-0.4, 0.5, 20), np.linspace(-0.6, 0.7, 20), np.full(20, 2.5)], axis=1)
"""Joints on a line in front of the sensor."""


class Camera(SensorSource):
    """Shows the same image with a performer, or without one, thirty times a second; it has no thread."""

    def __init__(self, name, has_performer):
        self.name, self.counts, self.recorded = name, Counts(), False
        self._has_performer, self._last = has_performer, clock.now()
        self.tracked_picture = Picture(self._last, LENS, COLOR, None)

    def fileno(self):
        return None

    def due(self):
        return self._last + TICK_SECONDS

    def now(self):
        return clock.now()

    def receive(self):
        if clock.now() < self.due():
            return []
        self._last = clock.now()
        self.counts.received += 1
        confidence = np.where(np.arange(20) == HIDDEN, 0, 1).astype(np.float32)
        return [SkeletonFrame(self._last, 3, POSITIONS, confidence) if self._has_performer else Tick(self._last)]

    def close(self):
        pass


@pytest.fixture
def watched(play, blob_puppet, monkeypatch):
    """Play a service whose camera sees a performer, or nobody."""

    def start(has_performer=True):
        monkeypatch.setattr(stage_runner, "open_source", lambda uri, _: Camera(uri, has_performer))
        return play("--puppet", blob_puppet, "--source", "camera:0")

    return start


def test_the_answer_has_the_picture_and_the_joints_where_they_are_in_it(watched):
    answer = watched().ask("look")
    pixels = np.asarray(Image.open(BytesIO(base64.b64decode(answer["picture"]["jpeg"]))))
    assert np.abs(pixels.astype(int) - COLOR).max() <= 4
    [performer] = answer["performers"]
    assert performer["joints"].pop(HIDDEN) is None
    assert_allclose(performer["joints"], np.delete(LENS.project(POSITIONS) / [640, 480], HIDDEN, axis=0))
    assert performer["text"].startswith("user 3: 19 of 20 joints tracked, ")
    assert "User 3: lost joints: left hand." in [reason["what"] for reason in answer["reasons"]]
    assert answer["stage"] == "stage"
    assert answer["source"] == "camera:0"


def test_without_a_performer_the_answer_says_why_and_nothing_is_remembered_unless_a_client_asks(watched):
    service = watched(has_performer=False)
    service.run(1.0)
    assert service.runner._monitor is None
    answer = service.ask("look")
    assert answer["performers"] == []
    assert answer["picture"]["width"] == 640
    assert [reason["what"] for reason in answer["reasons"]] == ["No performer is in view."]
    service.run(stage_runner.WATCHED_SECONDS - 0.1)
    assert service.runner._monitor is not None
    service.run(0.2)
    assert service.runner._monitor is None


def test_requests_that_wait_share_one_picture_and_the_next_comes_later(watched, monkeypatch):
    made = []
    monkeypatch.setattr(look_command, "seen", lambda *_: made.append(clock.now()) or len(made))
    service = watched()
    asked = [service.request("look") for _ in range(3)]
    service.until(lambda: all(asked))
    assert [json.loads(reply)["result"] for [reply] in asked] == [1] * 3
    assert service.ask("look") == 2
    assert look_command.PERIOD_SECONDS <= made[1] - made[0] <= look_command.PERIOD_SECONDS + 2 * TICK_SECONDS
    replies = service.request("look")
    service.service._looking.advance([])  # the stage is gone
    assert json.loads(replies[0])["error"]["where"] == "the service"
