from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.clip import SkeletonClip
from capture.events import TICK_SECONDS, Cue, Lost, Tick
from capture.formats import read_log
from capture.recording import HEADER, as_recorded, encode
from capture.skeleton import LOST, MAX_DISTANCE_METRES, SkeletonFrame
from capture.sources.replay import MAX_EVENTS, MAX_LATENESS_SECONDS, MAX_SILENCE_SECONDS, RecordingSource
from puppetline.clock import use
from puppetline.errors import SkeletonLogError, SourceError

from ...clock import GivenClock
from ...recordings import key, record


def make_frame(moment, user=1):
    rng = np.random.default_rng(abs(int(moment * 1000)) + user)
    confidence = rng.choice([1.0, 0.5, LOST], size=20).astype(np.float32)
    positions = np.where(confidence[:, None] == LOST, np.nan, rng.normal(size=(20, 3)))
    return SkeletonFrame(moment, user, positions, confidence)


def make_clip(times, user=1):
    frames = [make_frame(moment, user) for moment in times]
    arrays = (np.array([getattr(frame, what) for frame in frames]) for what in ("time", "positions", "confidence"))
    return SkeletonClip("made", user, *arrays)


def play(source, given_clock, step=1 / 120, most=10_000):
    """Call the source like the service until it ends; return the events, each with the clock's time."""
    came = []
    for _ in range(most):
        try:
            came += [(given_clock.now(), event) for event in source.receive()]
        except SourceError:
            return came
        given_clock.advance_to(max(given_clock.now() + step, min(source.due(), given_clock.now() + 10 * step)))
    raise AssertionError("no end")


def performance():
    """Return some seconds of a stage: all kinds of events, a gap of 1 s without ticks, several events at a time."""
    yield Cue(100, "stage", {"characters": {"dog": {"since": 1 / 3, "user": None}}})
    for k in range(60):
        yield make_frame(100 + k / 30, user=1 + k % 2)
        if k % 10 == 7:
            yield Cue(100 + k / 30, "mirror", {"character": {"name": "dog", "at": k / 7}})
    yield Lost(102.0, 2)
    yield Tick(102.033)
    yield make_frame(103.1)


def test_a_stages_take_yields_exactly_the_recorded_events(tmp_path, given_clock):
    written = list(performance())
    source = RecordingSource.of_file("replay:take", record(tmp_path / "take", written))
    assert (source.name, source.fileno()) == ("replay:take", None)
    expected = [key(as_recorded(e) if isinstance(e, SkeletonFrame) else e) for e in written]
    assert [key(event) for _, event in play(source, given_clock)] == expected
    assert (source.counts.received, source.counts.dropped, source.counts.refused) == (len(written), 0, {})


def test_each_event_is_returned_at_its_time(tmp_path, given_clock):
    start = given_clock.now()
    came = play(RecordingSource.of_file("r", record(tmp_path / "take", performance())), given_clock, step=0.001)
    late = [moment - start - (event.time - 100) for moment, event in came]
    assert min(late) >= -1e-9
    assert max(late) <= 0.001 + 1e-9


def test_the_recordings_clock_starts_with_the_first_call(given_clock):
    source = RecordingSource.of_clips("demo:x", [make_clip([3.0, 3.5])])
    given_clock.advance(100)
    assert source.now() == 3.0
    assert source.due() == given_clock.now()
    assert [event.time for event in source.receive()] == [3.0]
    assert source.due() == given_clock.now() + MAX_SILENCE_SECONDS - 2 * TICK_SECONDS


def test_a_late_caller_gets_all_that_is_due_in_order(given_clock):
    source = RecordingSource.of_clips("demo:x", [make_clip(np.arange(90) / 30)])
    source.receive()
    given_clock.advance(MAX_LATENESS_SECONDS - 0.01)
    assert [event.time for event in source.receive()] == [k / 30 for k in range(1, 30)]
    assert source.counts.dropped == 0


def test_a_late_caller_delays_the_recording(given_clock):
    times = np.arange(90) / 30
    source = RecordingSource.of_clips("demo:x", [make_clip(times)])
    came = source.receive()
    given_clock.advance(60)
    came += source.receive()
    assert [event.time for event in came] == [0.0, 1 / 30]
    assert source.now() == 1 / 30
    came += [event for _, event in play(source, given_clock)]
    np.testing.assert_array_equal([event.time for event in came], times)


def test_the_end_is_an_error_on_every_call(given_clock):
    source = RecordingSource.of_clips("demo:x", [make_clip([0.0])])
    assert len(source.receive()) == 1
    for _ in range(2):
        with pytest.raises(SourceError, match=r"demo:x: found the end of the recording; .* \?loop"):
            source.receive()
        assert source.due() == given_clock.now()


def test_in_a_loop_the_first_pass_is_exact_and_times_increase(tmp_path, given_clock):
    written = list(performance())
    users = sorted({event.user for event in written if isinstance(event, SkeletonFrame)})
    whole = len(written) + len(users)
    source = RecordingSource.of_file("r", record(tmp_path / "take", written), loop=True)
    came = []
    while len(came) < 3 * whole:
        came += source.receive()
        given_clock.advance_to(max(given_clock.now(), source.due()))
    passes = [came[k * whole : (k + 1) * whole] for k in range(3)]
    first, second, third = (each[: len(written)] for each in passes)
    assert [key(e) for e in first] == [key(as_recorded(e) if isinstance(e, SkeletonFrame) else e) for e in written]
    period = first[-1].time - first[0].time + TICK_SECONDS
    for number, again in ((1, second), (2, third)):
        shifts = [event.time - earlier.time for event, earlier in zip(again, first, strict=True)]
        np.testing.assert_allclose(shifts, number * period, rtol=0, atol=1e-9)
        assert [key(replace(event, time=0)) for event in again] == [key(replace(event, time=0)) for event in first]
    for each in passes:  # or they would jump from the end to the beginning
        assert each[len(written) :] == [Lost(each[len(written) - 1].time, user, again=True) for user in users]
    times = [event.time for event in came]
    assert times == sorted(times)


def test_several_performers_play_together(given_clock):
    clips = [make_clip([0.0, 0.05, 0.1], user=4), make_clip([0.02, 0.05], user=7)]
    came = [event for _, event in play(RecordingSource.of_clips("demo:x", clips), given_clock)]
    assert [(event.time, event.user) for event in came] == [(0.0, 4), (0.02, 7), (0.05, 4), (0.05, 7), (0.1, 4)]
    assert [key(e) for e in came if e.user == 7] == [key(frame) for frame in clips[1].frames()]


def test_ticks_fill_the_gaps_of_a_recording(tmp_path, given_clock):
    clip = make_clip([1.0, 1.05, 2.0, 2.09])
    ticks = [1.05 + k * TICK_SECONDS for k in range(1, 29)]
    expected = [1.0, 1.05, *ticks, 2.0, 2.09]
    for source in (
        RecordingSource.of_clips("demo:x", [clip]),
        RecordingSource.of_file("r", record(tmp_path / "take", map(as_recorded, clip.frames()))),
    ):
        came = [event for _, event in play(source, given_clock)]
        assert [event.time for event in came] == expected
        assert [event for event in came if isinstance(event, Tick)] == list(map(Tick, ticks))


def test_a_take_of_an_earlier_version_is_played_and_logged_once(tmp_path, given_clock, caplog):
    frames = [as_recorded(make_frame(k / 30)) for k in range(3)]
    old = b'{"beginning": {"version": 3, "roles": []}}\n'
    (tmp_path / "take").write_bytes(HEADER + old + b"".join(map(encode, frames)))
    source = RecordingSource.of_file("r", tmp_path / "take", loop=True)
    came = []
    while len(came) < 9:
        came += source.receive()
        given_clock.advance_to(max(given_clock.now(), source.due()))
    assert [key(event) for event in came[:3]] == [key(frame) for frame in frames]
    assert caplog.messages == [f"{tmp_path / 'take'}: recorded by an earlier version: performers are calibrated again"]


def test_a_foreign_log_plays_as_it_reads(tmp_path, given_clock):
    rng = np.random.default_rng(0)
    rows = [(frame, *rng.normal(size=60).round(3) + 2) for frame in (1, 2, 3, 4, 30)]
    log = tmp_path / "utkinect.txt"
    log.write_text("\n".join(" ".join(map(str, row)) for row in rows) + "\n")
    (clip,) = read_log(log)
    came = [event for _, event in play(RecordingSource.of_file("replay:log", log), given_clock)]
    assert [key(e) for e in came if isinstance(e, SkeletonFrame)] == [key(frame) for frame in clip.frames()]
    assert sum(isinstance(event, Tick) for event in came) == 25


def test_events_that_go_back_in_time_are_skipped(tmp_path, given_clock):
    """The recording was continued after a restart of the machine, whose clock restarted."""
    events = [
        make_frame(50.0),
        make_frame(50.05),
        make_frame(50.05),
        make_frame(0.5),
        Tick(0.6),
        make_frame(50.05, user=2),
    ]
    path = record(tmp_path / "take", [*events, make_frame(50.1)])
    source = RecordingSource.of_file("r", path)
    came = [(event.time, event.user) for _, event in play(source, given_clock)]
    assert came == [(50.0, 1), (50.05, 1), (50.05, 2), (50.1, 1)]
    assert source.counts.refused == {"goes back in time": 3}
    assert [list(clip.times) for clip in read_log(path)] == [[50.0, 50.05, 50.1], [50.05]]


def test_a_loop_over_decreasing_times_continues(tmp_path, given_clock):
    source = RecordingSource.of_file(
        "r", record(tmp_path / "t", [make_frame(50.0), make_frame(50.01), Tick(0.5)]), loop=True
    )
    times = []
    while len(times) < 6:
        times += [event.time for event in source.receive() if not isinstance(event, Lost)]
        given_clock.advance_to(source.due())
    np.testing.assert_allclose(np.diff(times), [0.01, TICK_SECONDS, 0.01, TICK_SECONDS, 0.01], atol=1e-9)


@pytest.mark.parametrize(
    ("line", "error"),
    [
        (b'{"t": 1, "tick"}\n', "not JSON"),
        (encode(make_frame(0.02)).replace(b'"p": [[', b'"p": [[9e9, 1, 1], ['), "20"),
    ],
)
def test_an_invalid_line_ends_the_recording_there(tmp_path, given_clock, line, error):
    path = tmp_path / "take"
    path.write_bytes(HEADER + encode(make_frame(0.0)) + encode(make_frame(0.01)) + line + encode(make_frame(0.03)))
    source = RecordingSource.of_file("r", path)
    given_clock.advance(1)
    source.receive()
    given_clock.advance(0.5)
    assert [event.time for event in source.receive()] == [0.01]
    with pytest.raises(SourceError, match=f"line 4.*{error}"):
        source.receive()


def test_a_position_out_of_range_ends_the_recording(tmp_path, given_clock):
    far = SkeletonFrame(0.01, 1, np.full((20, 3), 2 * MAX_DISTANCE_METRES), np.ones(20, np.float32))
    source = RecordingSource.of_file("r", record(tmp_path / "take", [make_frame(0.0), far]))
    assert len(source.receive()) == 1
    with pytest.raises(SourceError, match=r"2000 m away at second 0\.01"):
        source.receive()


def test_a_file_that_cannot_be_opened_is_refused_immediately(tmp_path):
    (tmp_path / "empty").write_bytes(HEADER)
    (tmp_path / "other").write_bytes(b"something else")
    with pytest.raises(SourceError, match="the end of the recording"):
        RecordingSource.of_file("r", tmp_path / "empty")
    for loop in (False, True):
        with pytest.raises(SourceError, match="the end of the recording"):
            RecordingSource.of_clips("r", [], loop)
    for name in ("other", "none"):
        with pytest.raises(SkeletonLogError):
            RecordingSource.of_file("r", tmp_path / name)


def test_many_events_at_one_time_are_returned_in_portions(tmp_path, given_clock):
    source = RecordingSource.of_file("r", record(tmp_path / "take", [Tick(1.0)] * (2 * MAX_EVENTS + 5)))
    assert [len(source.receive()) for _ in range(3)] == [MAX_EVENTS, MAX_EVENTS, 5]


@given(
    start=st.sampled_from([0.0, 1.7e9, -12.5, 0.1]),
    gaps=st.lists(st.floats(1e-3, 3), min_size=1, max_size=20),
    steps=st.lists(st.floats(0, 2.5), min_size=1, max_size=50),
)
def test_the_time_is_between_the_last_event_and_the_next(start, gaps, steps):
    """A cue with this time is between the events around it."""
    clock = GivenClock()
    with use(clock):
        source = RecordingSource.of_clips("r", [make_clip(np.unique(start + np.cumsum([0.0, *gaps])))])
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


def test_closing_closes_the_file_and_ends_the_recording(tmp_path, given_clock):
    source = RecordingSource.of_file("r", record(tmp_path / "take", performance()))
    source.receive()
    source.close()
    source.close()
    with pytest.raises(SourceError):
        source.receive()
