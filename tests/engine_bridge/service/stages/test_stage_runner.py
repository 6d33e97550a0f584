from dataclasses import replace
from pathlib import Path
from unittest.mock import DEFAULT, Mock

import numpy as np
import pytest

from capture.body import upright
from capture.events import Tick
from capture.formats import read_log
from capture.source import SilentSource, wait
from engine_bridge.service.players.player_settings import PlayerSettings
from engine_bridge.service.stages.stage_runner import StageRunner
from puppetline import clock
from puppetline.errors import ServiceError

from ...refusals import refused
from ..stage_steps import apart


def run(runner, until=lambda: False, seconds=20.0):
    """Process events as the service does, until something is true or for some seconds; return the frames."""
    frames, end = [], clock.now() + seconds
    while not until() and clock.now() < end:
        wait(runner.source, end)
        frames += runner.take_in()
    return frames


def run_to(runner, skeletons):
    """Process events until so many skeletons have come."""
    return run(runner, lambda: runner.skeletons >= skeletons)


def run_out(runner):
    """Process events until the recording has ended."""
    return run(runner, lambda: isinstance(runner.source.inner, SilentSource))


@pytest.fixture
def open_stage(make_stage, tmp_path, until_end, given_clock):
    """Open a source before a stage."""
    return lambda source, **more: until_end(StageRunner(source, make_stage(**more), tmp_path))


@pytest.fixture
def given(open_stage, sender):
    """Open a stage whose source has the events that are added to a list."""
    runner, events = open_stage(sender.uri, player_settings=PlayerSettings(calibrate="at_once")), []

    def receive():
        taken = events[:]
        events.clear()
        return taken

    runner.source.inner.receive = receive
    return runner, events


@pytest.fixture
def short(record_events, tmp_path, kung_fu):
    record_events(tmp_path / "short.log", kung_fu[:10])
    return "replay:short.log"


def test_the_clock_continues_after_the_end_of_a_recording(short, open_stage, kung_fu):
    runner = open_stage(short)
    run_out(runner)
    assert runner.skeletons == 10
    frames = run(runner, seconds=1.0)
    assert frames[0].time >= kung_fu[9].time
    assert frames[-1].state == "waiting"
    assert runner.source.name == short


def test_a_take_has_every_frame_that_waited_and_only_the_newest_is_used_otherwise(given, tmp_path, kung_fu, moved):
    runner, events = given
    waiting = [moved(each, time=clock.now() + 0.01 * k) for k, each in enumerate(kung_fu[:12])]
    events += waiting[:6]
    assert len(runner.take_in()) == runner.skeletons == 1
    assert runner.source.counts.dropped == 5
    runner.start_recording(tmp_path / "take.log")
    events += waiting[6:]
    assert len(runner.take_in()) == 6
    runner.close()
    [clip] = read_log(tmp_path / "take.log")
    assert clip.times.tolist() == [each.time for each in waiting[6:]]


def test_events_of_a_take_are_in_order_even_if_the_sources_are_not(given, open_stage, tmp_path, kung_fu, moved):
    (runner, events), start, live = given, clock.now(), []
    runner.start_recording(tmp_path / "take.log")
    for k, frame in enumerate(kung_fu[:60]):
        events += [moved(frame, time=start + k / 30), Tick(start + k / 30 - 0.01)]  # out of order
        live += runner.take_in()
        if k % 20 == 10:
            live += runner.cue("mirror", character="dog", on=k == 10)  # now, which is before the frames that follow
    runner.stop_recording().close()
    replayed = [frame for frame in run_out(open_stage("replay:take.log")) if frame.time <= live[-1].time]
    assert apart(live, replayed, "pose.controls").max() == 0


@pytest.fixture
def calibration(open_stage, record_events, tmp_path, kung_fu):
    """Record a take that begins before the performer is calibrated, and return the calibration."""
    record_events(tmp_path / "log", kung_fu[:90])
    runner = open_stage("replay:log")
    run_to(runner, 20)
    runner.start_recording(tmp_path / "take.log")
    run_to(runner, 90)
    [player] = runner.stage.players
    runner.close()
    return player.calibration


def test_a_take_uses_its_calibration_also_after_its_characters_are_loaded_again(open_stage, make_player, calibration):
    """The second without motion began before it."""
    runner = open_stage("replay:take.log")
    assert run_to(runner, 60)[-1].state == "performing"
    np.testing.assert_array_equal(runner.stage.players[0].calibration.rest, calibration.rest)
    runner.replace_players([make_player("dog")])
    assert run(runner, lambda: runner.stage.players[0].state == "performing")


def test_after_a_command_a_take_plays_like_any_other_recording(open_stage, calibration):
    runner = open_stage("replay:take.log?loop")
    [player] = runner.stage.players
    run_to(runner, 5)
    runner.cue("mirror", on=True)
    run_to(runner, 60)
    assert player.calibration is None  # no performer stood still for a second since
    run_to(runner, 80)  # the second pass
    assert player.motion.mirror


def test_a_take_with_a_damaged_beginning_plays_like_any_other_recording(open_stage, tmp_path, caplog, calibration):
    text = (tmp_path / "take.log").read_text()
    (tmp_path / "take.log").write_text(text.replace('"people": "each"', '"peoples": "each"'))
    frames = run_to(open_stage("replay:take.log"), 65)
    assert caplog.messages == ["an event was refused"]
    assert frames[-1].state == "performing"


def test_an_internal_error_loses_one_event(short, open_stage, monkeypatch):
    runner = open_stage(short)
    step = Mock(wraps=runner.stage.step, side_effect=[DEFAULT, DEFAULT, ZeroDivisionError, *[DEFAULT] * 100])
    monkeypatch.setattr(runner.stage, "step", step)
    run_to(runner, 10)
    assert runner.faults == 1
    assert step.call_count == runner.events


def test_a_take_of_a_runner_is_a_skeleton_log_and_ends_if_the_disk_is_full(short, open_stage, tmp_path, kung_fu):
    runner, take = open_stage(short), tmp_path / "take.log"
    runner.start_recording(take)
    run_to(runner, 10)
    refused(ServiceError, runner.cue, "calibrate", character="horse")
    runner.cue("mirror", character="dog", on=True)
    runner.stop_recording().close()
    assert runner.stop_recording() is None
    [clip] = read_log(take)
    assert clip.times.tolist() == [frame.time for frame in kung_fu[:10]]
    assert b'"do": "mirror"' in take.read_bytes()
    assert b"horse" not in take.read_bytes()
    runner.start_recording(tmp_path / "full.log")
    runner._recorder._file.close()
    runner._recorder._file = Path("/dev/full").open("ab", buffering=0)  # noqa: SIM115 - the runner closes it
    run(runner, seconds=2.0)
    assert runner.recording is None
    assert runner.faults == 0


@pytest.mark.parametrize(
    ("follow", "hanging", "told"), [("turn", False, True), ("turn", True, False), ("direction", False, False)]
)
def test_a_calibration_with_raised_arms_is_logged_if_limbs_turn(
    open_stage, limbed_figure, tmp_path, record, standing, caplog, follow, hanging, told
):
    """The performer of the fixture stretches the arms out."""
    record(tmp_path / "still.log", np.tile(upright(standing) if hanging else standing, (60, 1, 1)))
    limbs = [limb.model_copy(update={"follow": follow}) for limb in limbed_figure.puppet.limb]
    puppet = limbed_figure.puppet.model_copy(update={"limb": limbs})
    runner = open_stage("replay:still.log", prepared=replace(limbed_figure, puppet=puppet))
    assert run_to(runner, 60)[-1].state == "performing"
    warnings = [record.fields for record in caplog.records if "hanging arms" in record.message]
    assert [each["character"] for each in warnings] == ["dog"] * told
    assert all("elbow_left" in each["bent"] for each in warnings)
