from dataclasses import replace

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.events import Cue, Tick
from capture.formats import puppetline_log, read_log
from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from capture.sound import SAMPLE_RATE, WavWriter, read_wav
from engine_bridge.studio.long_work.trimming import trimmed
from puppetline.errors import SkeletonLogError

from ...refusals import refused


@pytest.fixture
def walk_take(record_events, tmp_path):
    """A take that begins at second 100 with the state of its stage."""
    events = [Cue(100.0, "stage", {"time": 100.0, "characters": {}}), Tick(100.0)]
    for frame in PERFORMANCES["walk"]().frames():
        events.append(replace(frame, time=100.0 + frame.time))
        if frame.time >= 1.0:
            events.append(Cue(100.0 + frame.time, "calibrate", {"character": "dog"}))
    return record_events(tmp_path / "take.log", events)


def test_a_part_has_the_frames_between_two_seconds_its_beginning_and_no_other_command(walk_take, tmp_path):
    trimmed(walk_take, tmp_path / "part.log", 0.5, 1.5)
    [whole], [part] = read_log(walk_take), read_log(tmp_path / "part.log")
    inside = (whole.times >= 100.5) & (whole.times <= 101.5)
    assert inside.sum() == 31
    assert np.array_equal(part.times, whole.times[inside])
    assert np.array_equal(part.positions, whole.positions[inside], equal_nan=True)
    begin, *others = puppetline_log.events(tmp_path / "part.log")
    assert begin == Cue(others[0].time, "stage", {"time": 100.0, "characters": {}})
    assert all(isinstance(event, SkeletonFrame) for event in others)


def test_a_part_keeps_its_part_of_the_sound(walk_take, tmp_path):
    samples = np.linspace(-1, 1, 3 * SAMPLE_RATE, dtype=np.float32)
    with WavWriter(tmp_path / "take.wav") as writer:
        writer.write(samples)
    with Recorder(walk_take) as recorder:
        recorder.write(Cue(float(read_log(walk_take)[0].times[-1]), "sound", {"file": "take.wav", "at": 99.9}))
    trimmed(walk_take, tmp_path / "part.log", 0.5, 1.5)
    begin, *_, end, cue = puppetline_log.events(tmp_path / "part.log")
    assert cue.arguments == {"file": "part.wav", "at": pytest.approx(begin.time, abs=1e-4)}
    part, _ = read_wav(tmp_path / "part.wav")
    assert len(part) == pytest.approx((end.time - begin.time) * SAMPLE_RATE, abs=2)
    first = round((cue.arguments["at"] - 99.9) * SAMPLE_RATE)
    np.testing.assert_allclose(part, samples[first : first + len(part)], atol=1e-4)


def test_a_part_without_a_skeleton_is_refused(walk_take, tmp_path):
    refused(SkeletonLogError, trimmed, walk_take, tmp_path / "part.log", 500.0, 501.0)
    assert not (tmp_path / "part.log").exists()


@pytest.mark.parametrize(("first", "place"), [(15, 16), (45, 1)])
def test_a_calibration_stays_and_follows_the_first_skeleton_if_it_was_before_the_part(
    record_events, tmp_path, first, place
):
    """A take may begin while a performer is being calibrated; nobody would move the character otherwise."""
    frames = list(PERFORMANCES["walk"]().frames())
    cue = Cue(frames[30].time, "begin", {"character": "dog", "calibration": {"rest": []}})
    path = record_events(tmp_path / "take.log", [*frames[:31], cue, *frames[31:]])
    trimmed(path, tmp_path / "part.log", frames[first].time - frames[0].time - 0.001, 2.0)
    events = list(puppetline_log.events(tmp_path / "part.log"))
    assert [index for index, event in enumerate(events) if not isinstance(event, SkeletonFrame)] == [place]
    assert events[0].time == frames[first].time
    assert events[place] == replace(cue, time=max(cue.time, events[0].time))
