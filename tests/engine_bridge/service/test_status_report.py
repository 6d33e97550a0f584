from dataclasses import asdict
from types import SimpleNamespace

import numpy as np
import pytest

from capture.sensor_tilt import SensorTilt
from capture.source import Counts
from engine_bridge.service.monitoring.status import ClientsStatus, LatencyStatus, OutputStatus
from engine_bridge.service.players.character_player import PlayerSettings
from engine_bridge.service.status_report import Reporter

CLIENTS = ClientsStatus(connected=1, refused=0, limit=64)
OUTPUTS = [OutputStatus("osc", "127.0.0.1:9000", sent=1, bytes=100, skipped=0, failed=0)]


@pytest.fixture
def runner(make_stage):
    """A runner whose source is at a time that the test sets."""
    stage = make_stage(("dog", "cat"), PlayerSettings(calibrate="command"))
    source = SimpleNamespace(name="osc:7110", counts=Counts(dropped=2, refused={"short": 3}), clock=0.0)
    source.now = lambda: source.clock
    return SimpleNamespace(stage=stage, source=source, faults=1, recording="evening")


def test_the_status_is_put_together_from_the_stage_the_counts_and_what_is_given(runner, kung_fu, moved):
    reporter = Reporter()
    for frame in kung_fu[:30]:
        for shown in runner.stage.step(moved(frame, user=5), 0):
            reporter.sent("stage", shown)
    reporter.received("stage", 30)
    runner.source.clock = kung_fu[29].time + 0.25
    status = reporter.status([runner], CLIENTS, OUTPUTS)
    (stage,) = status.stages
    assert (stage.name, stage.source, stage.frames, stage.dropped) == ("stage", "osc:7110", 30, 2)
    assert (stage.refused, stage.faults, stage.recording) == ({"short": 3}, 1, "evening")
    (user,) = stage.users
    assert (user.user, user.state, user.character, user.seen) == (5, "calibrating", "dog", 0.25)
    assert (user.height, user.reach) == (None, None)
    assert user.distance == pytest.approx(np.hypot(*np.median(kung_fu[0].positions[:, ::2], axis=0)), abs=0.2)
    assert asdict(stage.sensor) == asdict(SensorTilt())
    assert stage.latency_ms != LatencyStatus()
    assert [(each.name, each.performer, each.state, each.frames) for each in status.characters] == [
        ("dog", 5, "calibrating", 30),
        ("cat", None, "waiting", status.characters[1].frames),
    ]
    assert (status.clients, status.outputs, status.performing) == (CLIENTS, OUTPUTS, 0)


def test_a_calibrated_performer_has_a_height_and_a_reach(runner, kung_fu):
    for frame in kung_fu[:30]:
        runner.stage.step(frame, 0)
    player = runner.stage.players[0]
    assert player.calibrate(kung_fu[29].time)
    player.begin(kung_fu[29].time)
    status = Reporter().status([runner], CLIENTS, OUTPUTS)
    (user,) = status.stages[0].users
    assert (user.state, user.height, user.reach) == (
        "performing",
        round(player.calibration.height, 2),
        round(player.calibration.reach, 2),
    )
    assert status.performing == 1


def test_figures_of_characters_that_have_been_removed_are_forgotten(runner, kung_fu):
    reporter = Reporter()
    for shown in runner.stage.step(kung_fu[0], 0):
        reporter.sent("stage", shown)
    assert reporter.status([runner], CLIENTS, OUTPUTS).characters[0].frames == 1
    assert reporter.status([], CLIENTS, OUTPUTS).characters == []
    assert reporter.status([runner], CLIENTS, OUTPUTS).characters[0].frames == 0
