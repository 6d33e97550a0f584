import socket
import time
from pathlib import Path
from select import select

import numpy as np
import pytest

from capture.events import Tick
from capture.formats import read_log
from capture.recording import Recorder
from capture.source import SilentSource
from engine_bridge.service.character_player import Manner
from engine_bridge.service.stage_runner import StageRunner
from puppetline.errors import ServiceError, SourceError


def run(line, seconds=None, until=lambda: False):
    """Take in as the service does; return the frames."""
    frames = []
    give_up = time.monotonic() + (20.0 if seconds is None else seconds)
    while not until():
        if time.monotonic() >= give_up:
            assert seconds is not None
            break
        number = line.source.fileno()
        select([] if number is None else [number], [], [], max(0.0, min(line.due() - time.monotonic(), 0.2)))
        frames += line.take_in()
    return frames


@pytest.fixture
def short(tmp_path, kung_fu):
    with Recorder(tmp_path / "short.log") as recorder:
        for frame in kung_fu[:10]:
            recorder.write(frame)
    return "replay:short.log"


def test_a_recording_that_has_ended_leaves_silence_and_its_clock_goes_on(short, make_stage, tmp_path, kung_fu):
    line = StageRunner(short, make_stage(), tmp_path)
    run(line, until=lambda: isinstance(line.source.inner, SilentSource))
    assert line.skeletons == 10
    frames = run(line, seconds=1.0)
    assert frames[0].time >= kung_fu[9].time
    assert frames[-1].state == "waiting"
    assert line.source.name == short
    line.close()


def test_a_source_that_fails_is_opened_again(make_stage, tmp_path, sender, kung_fu):
    line = StageRunner(sender.uri, make_stage(), tmp_path)

    def fail():
        raise SourceError("osc", found="a fault", expected="none", fix="None.")

    line.source.inner.receive = fail
    line.take_in()
    assert isinstance(line.source.inner, SilentSource)
    run(line, until=lambda: not isinstance(line.source.inner, SilentSource))
    sender.send(kung_fu[0])
    run(line, until=lambda: line.skeletons == 1)
    line.close()


def test_a_source_that_stays_away_is_waited_for(make_stage, tmp_path, sender):
    line = StageRunner(sender.uri, make_stage(), tmp_path)
    line.source.inner.close()
    line.source.inner.receive = lambda: (_ for _ in ()).throw(SourceError("osc", found="x", expected="y", fix="z"))
    line.take_in()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", sender.port))
        frames = run(line, seconds=1.5)
        assert isinstance(line.source.inner, SilentSource)
    assert len(frames) > 20  # the character goes on
    run(line, until=lambda: not isinstance(line.source.inner, SilentSource))
    line.close()


def test_trouble_is_told_once_and_its_end_when_something_comes(make_stage, tmp_path, sender, kung_fu, caplog):
    caplog.set_level("INFO")
    line = StageRunner(sender.uri, make_stage(), tmp_path)
    trouble = SourceError("osc", found="x", expected="y", fix="z")
    for _ in range(3):
        line.source.inner.receive = lambda: (_ for _ in ()).throw(trouble)
        line.take_in()
        run(line, until=lambda: not isinstance(line.source.inner, SilentSource))
    assert caplog.messages == [f"the source is silent: {trouble}"]
    sender.send(kung_fu[0])
    run(line, until=lambda: line.skeletons == 1)
    assert caplog.messages[1:] == ["the source is back"]
    line.close()


def test_a_source_that_fails_in_its_own_way_is_opened_again_and_goes_on_counting(make_stage, tmp_path, sender):
    line = StageRunner(sender.uri, make_stage(), tmp_path)
    sender.raw(b"garbage!")
    run(line, until=lambda: sum(line.source.counts.refused.values()) == 1)

    def fail():
        raise RuntimeError("the cable")

    line.source.inner.receive = fail
    run(line, until=lambda: isinstance(line.source.inner, SilentSource))
    run(line, until=lambda: not isinstance(line.source.inner, SilentSource))
    sender.raw(b"garbage!")
    run(line, until=lambda: sum(line.source.counts.refused.values()) == 2)
    line.close()


def test_what_a_take_holds_is_in_order_whatever_the_source_gives(make_stage, tmp_path, sender, kung_fu, moved):
    line = StageRunner(sender.uri, make_stage(manner=Manner(calibrate="at_once")), tmp_path)
    line.start_recording(tmp_path / "take.log")
    start = time.monotonic()
    given = []

    def receive():
        events, given[:] = given[:], []
        return events

    line.source.inner.receive = receive
    live = []
    for k, frame in enumerate(kung_fu[:60]):
        given += [moved(frame, time=start + k / 30), Tick(start + k / 30 - 0.01)]  # parts of bodies come as they may
        live += line.take_in()
        if k % 20 == 10:
            live += line.cue("mirror", character="dog", on=k == 10)  # now, which is before the frames that follow
    line.stop_recording().close()
    again = StageRunner("replay:take.log", make_stage(), tmp_path)
    replayed = run(again, until=lambda: isinstance(again.source.inner, SilentSource))
    replayed = [frame for frame in replayed if frame.time <= live[-1].time]
    assert len(live) == len(replayed)
    for a, b in zip(live, replayed, strict=True):
        np.testing.assert_array_equal(a.controls, b.controls)
    for each in (line, again):
        each.close()


def recorded_from_the_middle(make_stage, tmp_path, kung_fu):
    """Record a take, from before the performer is calibrated on, and return the calibration."""
    with Recorder(tmp_path / "log") as recorder:
        for frame in kung_fu[:90]:
            recorder.write(frame)
    line = StageRunner("replay:log", make_stage(), tmp_path)
    run(line, until=lambda: line.skeletons >= 20)
    line.start_recording(tmp_path / "take.log")
    run(line, until=lambda: line.skeletons == 90)
    [player] = line.stage.players
    line.close()
    return player.calibration


def test_a_take_uses_the_calibration_that_was_used_though_its_still_second_began_before(make_stage, tmp_path, kung_fu):
    calibration = recorded_from_the_middle(make_stage, tmp_path, kung_fu)
    line = StageRunner("replay:take.log", make_stage(), tmp_path)
    [player] = line.stage.players
    frames = run(line, until=lambda: line.skeletons >= 60)
    assert frames[-1].state == "performing"
    np.testing.assert_array_equal(player.calibration.rest, calibration.rest)
    line.close()


def test_as_soon_as_somebody_has_a_say_a_take_is_like_any_other_recording(make_stage, tmp_path, kung_fu):
    recorded_from_the_middle(make_stage, tmp_path, kung_fu)
    line = StageRunner("replay:take.log?loop", make_stage(), tmp_path)
    [player] = line.stage.players
    run(line, until=lambda: line.skeletons >= 5)
    line.cue("mirror", on=True)
    run(line, until=lambda: line.skeletons >= 60)
    assert player.calibration is None  # and nobody stood still for a second since
    run(line, until=lambda: line.skeletons >= 80)  # the second pass
    assert player.mirror
    line.close()


def test_a_take_plays_on_when_its_characters_are_loaded_again(make_stage, make_player, tmp_path, kung_fu):
    recorded_from_the_middle(make_stage, tmp_path, kung_fu)
    line = StageRunner("replay:take.log", make_stage(), tmp_path)
    run(line, until=lambda: line.skeletons >= 60)
    assert line.stage.players[0].state == "performing"
    line.replace_players([make_player("dog")])
    run(line, until=lambda: line.stage.players[0].state == "performing")
    line.close()


def test_a_take_with_a_damaged_beginning_plays_like_any_other_recording(make_stage, tmp_path, kung_fu, caplog):
    recorded_from_the_middle(make_stage, tmp_path, kung_fu)
    text = (tmp_path / "take.log").read_text()
    (tmp_path / "take.log").write_text(text.replace('"people": "each"', '"peoples": "each"'))
    line = StageRunner("replay:take.log", make_stage(), tmp_path)
    frames = run(line, until=lambda: line.skeletons >= 65)
    assert caplog.messages == ["an event was refused"]
    assert "a take with a damaged beginning" in caplog.records[0].fields["why"]
    assert frames[-1].state == "performing"
    line.close()


def test_a_fault_costs_one_event(short, make_stage, tmp_path):
    stage = make_stage()
    line = StageRunner(short, stage, tmp_path)
    step, calls = stage.step, []

    def stumbling(event, received):
        calls.append(event)
        if len(calls) == 3:
            raise ZeroDivisionError
        return step(event, received)

    stage.step = stumbling
    run(line, until=lambda: line.skeletons == 10)
    assert (line.faults, len(calls)) == (1, line.events)
    line.close()


def test_a_take_ends_where_the_disk_is_full_and_the_stage_goes_on(short, make_stage, tmp_path):
    line = StageRunner(short, make_stage(), tmp_path)
    line.start_recording(tmp_path / "take.log")
    line._recorder._file.close()
    line._recorder._file = Path("/dev/full").open("ab", buffering=0)  # noqa: SIM115 - the line closes it
    run(line, until=lambda: line.skeletons == 10)
    assert line.recording is None
    assert line.faults == 0
    line.close()


def test_a_take_of_a_line_is_a_skeleton_log(short, make_stage, tmp_path, kung_fu):
    line = StageRunner(short, make_stage(), tmp_path)
    line.start_recording(tmp_path / "take.log")
    assert line.recording == "take"
    run(line, until=lambda: line.skeletons == 10)
    with pytest.raises(ServiceError):
        line.cue("calibrate", character="horse")
    line.cue("mirror", character="dog", on=True)
    line.stop_recording().close()
    assert line.stop_recording() is None
    [clip] = read_log(tmp_path / "take.log")
    assert clip.times.tolist() == [frame.time for frame in kung_fu[:10]]
    assert b'"do": "mirror"' in (tmp_path / "take.log").read_bytes()
    assert b"horse" not in (tmp_path / "take.log").read_bytes()
    line.close()
