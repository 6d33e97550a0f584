import wave
from collections import Counter
from itertools import islice

import numpy as np
import pytest
from puppetline.examples.performances import clean

from capture.events import Cue, Lost, Tick
from capture.formats.puppetline_log import events
from capture.skeleton import SkeletonFrame
from capture.sound_input import SoundInput
from capture.sources.replay import RecordingSource
from capture.sources.take import RecordSummary, record
from puppetline import clock
from puppetline.errors import OutputError, SourceError

from ...recordings import key, keys, random_clip, tracked_frame
from ..conftest import ScriptedSource
from ..test_sound import Card, blocks

pytestmark = pytest.mark.usefixtures("given_clock")


END = SourceError("openni:", found="an unplugged sensor", expected="a sensor", fix="Plug it in.")


def live(*events, **options):
    """Return a live source that returns events one by one, or raises errors."""
    script = (event if event is END else [event] for event in events)
    return ScriptedSource(*script, name="openni:", dropped=3, refused=Counter(short=2), **options)


def frame(time, user=1):
    return tracked_frame(time, np.zeros((20, 3)), user)


def test_a_source_is_recorded_until_it_ends(tmp_path):
    clips = [random_clip([10.0, 10.01, 10.3]), random_clip([10.02], user=7)]
    reports = []
    path = tmp_path / "evening.take"
    summary = record(RecordingSource.of_clips("demo:x", clips), path, report=lambda *report: reports.append(report))
    came = list(events(path))
    frames = sorted((frame for clip in clips for frame in clip.frames()), key=lambda frame: frame.time)
    assert [key(e) for e in came if isinstance(e, SkeletonFrame)] == keys(frames)
    assert [type(e) for e in came if not isinstance(e, SkeletonFrame)] == [Tick] * 8
    assert summary == RecordSummary(
        take=str(path),
        source="demo:x",
        seconds=10.3 - 10.0,
        frames=4,
        users=(1, 7),
        dropped=0,
        refused={},
        ended="source",
    )
    assert reports[-1][0] == 4


@pytest.mark.parametrize("given", [[frame(1.0), frame(1.1, 4), Lost(1.2, 1), frame(1.3, 4)], []])
def test_all_events_of_a_live_source_are_recorded_as_they_arrive(tmp_path, given):
    summary = record(live(*given), tmp_path / "take", seconds=0.2)
    expected = (3, (1, 4), 1.3 - 1.0) if given else (0, (), 0.0)
    assert (summary.frames, summary.users, summary.seconds) == expected
    assert (summary.ended, summary.dropped, summary.refused) == ("time", 3, {"short": 2})
    assert list(map(key, events(tmp_path / "take"))) == list(map(key, given))


@pytest.mark.parametrize("came", [[], [Tick(0.0), Tick(1.0)], [Tick(0.0), Lost(1.0, 1), Tick(2.0)]])
@pytest.mark.parametrize("recorded", [False, True])
def test_the_error_of_a_source_is_reported_and_earlier_events_are_kept(tmp_path, came, recorded):
    path = tmp_path / "take"
    source = live(*came, END, recorded=recorded)
    summary = record(source, path)
    assert (summary.ended, summary.why) == ("source", str(END))
    assert path.exists() == (Lost(1.0, 1) in came)
    assert not path.exists() or list(events(path)) == came


def test_a_take_and_a_sound_that_are_there_are_replaced_only_by_force(tmp_path):
    source = live(frame(0.0, 5))
    path = tmp_path / "take.log"
    for there in (path.with_suffix(".wav"), path):
        there.write_text("dear to me")
        with pytest.raises(OutputError):
            record(source, path, seconds=0, sound=SoundInput(lambda: Card([])))
        assert [each.read_text() for each in tmp_path.iterdir()] == ["dear to me"]
        there.unlink()
    path.write_text("dear to me")
    assert record(source, path, seconds=0.1, force=True).users == (5,)
    assert [event.user for event in events(path)] == [5]


def test_an_unwritable_path_is_refused_before_any_event_is_received(tmp_path):
    source = live(frame(0.0))
    with pytest.raises(OutputError):
        record(source, tmp_path / "none" / "take", seconds=1)
    with pytest.raises(OutputError):
        record(source, tmp_path, seconds=1, force=True)
    assert len(source.script) == 1


def test_stopped_it_leaves_a_take_that_can_be_read(tmp_path):
    path, walk = tmp_path / "take", clean("walk")

    def stop(frames, _seconds):
        if frames >= 5:
            raise KeyboardInterrupt

    summary = record(RecordingSource.of_clips("demo:walk", [walk], loop=True), path, report=stop)
    assert (summary.frames, summary.ended) == (5, "stopped")
    frames = [event for event in events(path) if isinstance(event, SkeletonFrame)]
    assert list(map(key, frames)) == keys(islice(walk.frames(), 5))
    assert path.read_bytes().endswith(b"}\n")


SUNG = np.sin(np.arange(4800) / 5).astype(np.float32)


def test_the_sound_beside_a_take_is_on_its_clock(tmp_path):
    now = clock.now()
    source = live(frame(now), frame(now + 0.01), frame(now + 0.02, 2))
    summary = record(source, tmp_path / "a.log", 0.3, sound=SoundInput(lambda: Card(blocks(SUNG, 41.5))))
    cues = [event for event in events(tmp_path / "a.log") if isinstance(event, Cue)]
    assert [(cue.do, cue.arguments["file"]) for cue in cues] == [("sound", "a.wav")]
    assert cues[0].arguments["at"] == pytest.approx(41.5, abs=0.005)
    times = [event.time for event in events(tmp_path / "a.log")]
    assert times == sorted(times)
    assert summary.sound == str(tmp_path / "a.wav")
    assert summary.sound_overflows == 1
    with wave.open(summary.sound) as file:
        samples = np.frombuffer(file.readframes(960), "<i2") / 32767
    np.testing.assert_allclose(samples, SUNG[:960], atol=1e-4)
