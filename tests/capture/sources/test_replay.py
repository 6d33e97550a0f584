from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.events import TICK_SECONDS, Cue, Lost, Tick
from capture.formats import read_log
from capture.recording import HEADER, as_recorded, encode
from capture.skeleton import MAX_DISTANCE_METRES
from capture.sources.replay import MAX_EVENTS, MAX_LATENESS_SECONDS, MAX_SILENCE_SECONDS, RecordingSource
from puppetline.clock import use
from puppetline.errors import SkeletonLogError, SourceError

from ...clock import GivenClock
from ...recordings import key, keys, random_clip, random_frame, record, tracked_frame
from ..conftest import refused
from ..formats.bvh_files import body_file, still


def of_clip(*times, **options):
    return RecordingSource.of_clips("demo:x", [random_clip(times)], **options)


@pytest.fixture
def of_events(tmp_path):
    """Return a source of a recording of events."""
    return lambda events, **options: RecordingSource.of_file("r", record(tmp_path / "take", events), **options)


def play(source, given_clock, step=1 / 120, most=10_000):
    """Call the source like the service until its end or `most` events; return them, each with the clock's time."""
    came = []
    while len(came) < most:
        try:
            came += [(given_clock.now(), event) for event in source.receive()]
        except SourceError:
            break
        given_clock.advance_to(max(given_clock.now() + step, min(source.due(), given_clock.now() + 10 * step)))
    return came


def events(source, given_clock, most=10_000):
    return [event for _, event in play(source, given_clock, most=most)]


def times(source, given_clock, most=10_000):
    return [event.time for event in events(source, given_clock, most)]


def performance():
    """Return some seconds of a stage: all kinds of events, a gap of 1 s without ticks, several events at a time."""
    yield Cue(100, "stage", {"characters": {"dog": {"since": 1 / 3, "user": None}}})
    for k in range(60):
        yield random_frame(100 + k / 30, user=1 + k % 2)
        if k % 10 == 7:
            yield Cue(100 + k / 30, "mirror", {"character": {"name": "dog", "at": k / 7}})
    yield Lost(102.0, 2)
    yield Tick(102.033)
    yield random_frame(103.1)


def test_a_stages_take_yields_exactly_the_recorded_events_each_at_its_time(of_events, given_clock):
    written, start = list(performance()), given_clock.now()
    source = of_events(written)
    came = play(source, given_clock, step=0.001)
    assert [key(event) for _, event in came] == keys(written)
    assert (source.counts.received, source.counts.dropped, source.counts.refused) == (len(written), 0, {})
    late = [moment - start - (event.time - 100) for moment, event in came]
    assert -1e-9 <= min(late) <= max(late) <= 0.001 + 1e-9


def test_the_recordings_clock_starts_with_the_first_call(given_clock):
    source = of_clip(3.0, 3.5)
    given_clock.advance(100)
    assert (source.now(), source.due(), source.fileno()) == (3.0, given_clock.now(), None)
    assert [event.time for event in source.receive()] == [3.0]
    assert source.due() == given_clock.now() + MAX_SILENCE_SECONDS - 2 * TICK_SECONDS


def test_a_late_caller_gets_all_that_is_due_and_a_very_late_one_delays_the_recording(given_clock):
    recorded = [k / 30 for k in range(90)]
    source = of_clip(*recorded)
    came = source.receive()
    given_clock.advance(MAX_LATENESS_SECONDS - 0.01)
    came += source.receive()
    assert [event.time for event in came] == recorded[:30]
    given_clock.advance(60)
    came += source.receive()
    assert (len(came), source.now(), source.counts.dropped) == (31, recorded[30], 0)
    assert [event.time for event in came] + times(source, given_clock) == recorded


def test_the_end_is_an_error_on_every_call(given_clock):
    source = of_clip(0.0)
    assert len(source.receive()) == 1
    for _ in range(2):
        assert refused(source.receive).found == "the end of the recording"
        assert source.due() == given_clock.now()


def test_in_a_loop_the_first_pass_is_exact_and_times_increase(of_events, given_clock):
    written = list(performance())
    whole, count = len(written) + 2, len(written)
    came = events(of_events(written, loop=True), given_clock, 3 * whole)
    first = came[:count]
    assert [key(event) for event in first] == keys(written)
    for number in range(3):
        *again, one, other = came[number * whole : (number + 1) * whole]
        shift = number * (first[-1].time - first[0].time + TICK_SECONDS)
        for event, earlier in zip(again, first, strict=True):
            assert event.time == pytest.approx(earlier.time + shift, abs=1e-9)
            assert key(replace(event, time=earlier.time)) == key(earlier)
        end = again[-1].time  # or they would jump from the end to the beginning
        assert [one, other] == [Lost(end, 1, again=True), Lost(end, 2, again=True)]
    assert [event.time for event in came] == sorted(event.time for event in came)


def test_ticks_fill_the_gaps_of_a_recording(of_events, given_clock):
    clip = random_clip([1.0, 1.05, 2.0, 2.09])
    ticks = [Tick(1.05 + k * TICK_SECONDS) for k in range(1, 29)]
    for source in (RecordingSource.of_clips("demo:x", [clip]), of_events(clip.frames())):
        came = events(source, given_clock)
        assert [event.time for event in came] == [1.0, 1.05, *(tick.time for tick in ticks), 2.0, 2.09]
        assert came[2:-2] == ticks


def test_a_take_of_an_earlier_version_is_played_and_logged_once(tmp_path, given_clock, caplog):
    frames = [as_recorded(random_frame(k / 30)) for k in range(3)]
    old = b'{"beginning": {"version": 3, "roles": []}}\n'
    (tmp_path / "take").write_bytes(HEADER + old + b"".join(map(encode, frames)))
    came = events(RecordingSource.of_file("r", tmp_path / "take", loop=True), given_clock, 9)
    assert [key(event) for event in came[:3]] == keys(frames)
    assert caplog.messages == [f"{tmp_path / 'take'}: recorded by an earlier version: performers are calibrated again"]


def test_a_foreign_log_plays_as_it_reads(tmp_path, given_clock):
    (clip,) = read_log(body_file(tmp_path, still(9)))
    came = events(RecordingSource.of_file("replay:log", tmp_path / "take.bvh"), given_clock)
    assert list(map(key, came)) == list(map(key, clip.frames()))


def test_events_that_go_back_in_time_are_skipped(of_events, given_clock, tmp_path):
    """The recording was continued after a restart of the machine, whose clock restarted."""
    back = random_frame(50.05), random_frame(0.5), Tick(0.6)
    source = of_events(
        [random_frame(50.0), random_frame(50.05), *back, random_frame(50.05, user=2), random_frame(50.1)]
    )
    came = [(event.time, event.user) for event in events(source, given_clock)]
    assert came == [(50.0, 1), (50.05, 1), (50.05, 2), (50.1, 1)]
    assert source.counts.refused == {"goes back in time": 3}
    assert [list(clip.times) for clip in read_log(tmp_path / "take")] == [[50.0, 50.05, 50.1], [50.05]]


FAR = tracked_frame(0.02, np.full((20, 3), 2 * MAX_DISTANCE_METRES))


@pytest.mark.parametrize(
    "line",
    [b'{"t": 1, "tick"}\n', encode(random_frame(0.02)).replace(b'"p": [[', b'"p": [[9e9, 1, 1], ['), encode(FAR)],
)
def test_an_invalid_line_or_a_position_out_of_range_ends_the_recording_there(tmp_path, given_clock, line):
    path = tmp_path / "take"
    path.write_bytes(
        HEADER + encode(random_frame(0.0)) + encode(random_frame(0.01)) + line + encode(random_frame(0.03))
    )
    source = RecordingSource.of_file("r", path)
    assert times(source, given_clock) == [0.0, 0.01]
    assert refused(source.receive).found != "the end of the recording"


def test_a_recording_without_events_or_of_no_format_is_refused_immediately(tmp_path):
    (tmp_path / "empty").write_bytes(HEADER)
    (tmp_path / "other").write_bytes(b"something else")
    refused(RecordingSource.of_file, "r", tmp_path / "empty")
    for loop in (False, True):
        refused(RecordingSource.of_clips, "r", [], loop)
    for name in ("other", "none"):
        with pytest.raises(SkeletonLogError):
            RecordingSource.of_file("r", tmp_path / name)


@pytest.mark.usefixtures("given_clock")
def test_many_events_at_one_time_are_returned_in_portions_and_closing_ends_the_recording(of_events):
    source = of_events([Tick(1.0)] * (2 * MAX_EVENTS + 5))
    assert [len(source.receive()) for _ in range(2)] == [MAX_EVENTS, MAX_EVENTS]
    for _ in range(2):
        source.close()
    refused(source.receive)


@given(
    start=st.sampled_from([0.0, 1.7e9, -12.5, 0.1]),
    gaps=st.lists(st.floats(1e-3, 3), min_size=1, max_size=20),
    steps=st.lists(st.floats(0, 2.5), min_size=1, max_size=50),
)
def test_the_time_is_between_the_last_event_and_the_next(start, gaps, steps):
    """A cue with this time is between the events around it."""
    clock = GivenClock()
    with use(clock):
        source = of_clip(*np.unique(start + np.cumsum([0.0, *gaps])))
        stamps = [source.now()]
        for step in steps:
            clock.advance(step)
            stamps.append(source.now())
            try:
                stamps += [event.time for event in source.receive()]
            except SourceError:
                break
            stamps.append(source.now())
        assert stamps == sorted(stamps)
