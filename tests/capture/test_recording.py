import errno
import itertools
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import capture.recording
from capture.events import Cue, Lost, Tick
from capture.formats.options import ReadOptions
from capture.formats.puppetline_log import events, read
from capture.recording import HEADER, Recorder, as_recorded, encode
from capture.skeleton import JOINTS, LOST, SkeletonFrame
from puppetline.errors import OutputError


def make_frame(k, user=1):
    """Return frame k of a motion that is equal in every process; every third one has lost joints, others channels."""
    rng = np.random.default_rng(k)
    confidence = rng.choice([1.0, 0.5, 0.7], size=20).astype(np.float32)
    if k % 3 == 0:
        confidence[rng.choice(20, size=4, replace=False)] = LOST
    positions = np.where(confidence[:, None] == LOST, np.nan, rng.normal(size=(20, 3)))
    channels = {"smile": rng.random(), "voice": 0.0} if k % 3 else None
    return SkeletonFrame(k / 30, user, positions, confidence, channels=channels)


def record(path, events):
    with Recorder(path) as recorder:
        for event in events:
            recorder.write(event)


def performance(count):
    """Return frames of two performers, and all other events between them."""
    state = {"dog": {"rest": [[0.1, 1 / 3, -0.0], None], "mirror": True, "since": 1e-320}}  # floats of every kind
    yield Cue(0.0, "stage", {"characters": state, "level": {}})
    for k in range(count):
        yield make_frame(k, user=1 + k % 2)
        yield Tick(k / 30)
        if k % 4 == 1:
            yield Lost(k / 30, user=2)
            yield Lost(k / 30, user=2, again=True)
            yield Cue(k / 30, "mirror", {"character": "dog", "rest": {"of": [k / 7, None, {"é}": "}"}]}})


def same(event, other):
    """Return whether two events are equal bit for bit."""
    if not isinstance(event, SkeletonFrame):
        return event == other and type(event) is type(other)
    return (
        isinstance(other, SkeletonFrame)
        and (event.time, event.user, event.channels) == (other.time, other.user, other.channels)
        and event.positions.tobytes() == other.positions.tobytes()
        and event.confidence.tobytes() == other.confidence.tobytes()
        and (event.positions.dtype, event.confidence.dtype) == (other.positions.dtype, other.confidence.dtype)
    )


def assert_reads_back(path, written):
    """All written events are read back bit for bit, frames as returned by `as_recorded`."""
    read_back = list(events(path))
    promised = [as_recorded(event) if isinstance(event, SkeletonFrame) else event for event in written]
    assert len(read_back) == len(promised)
    assert all(map(same, read_back, promised))


def assert_clip_is(clip, frames):
    np.testing.assert_array_equal(clip.times, [frame.time for frame in frames])
    np.testing.assert_array_equal(clip.positions, np.round([frame.positions for frame in frames], 5))
    np.testing.assert_array_equal(clip.confidence, [frame.confidence for frame in frames])


def read_one(path):
    (clip,) = read(path, ReadOptions())
    return clip


def test_a_frame_is_one_line_of_json_with_null_for_lost_joints():
    positions = np.full((20, 3), [0.1, -0.123456789, 2.5])
    positions[4] = np.nan
    confidence = np.full(20, 0.7, dtype=np.float32)
    confidence[3] = LOST
    x, nothing = "[0.1, -0.12346, 2.5]", "null"
    assert encode(SkeletonFrame(1.5, 3, positions, confidence)).decode() == (
        f'{{"t": 1.5, "user": 3, "p": [{", ".join([x] * 3 + [nothing] * 2 + [x] * 15)}], '
        f'"c": [{", ".join(["0.7"] * 3 + ["0.0"] * 2 + ["0.7"] * 15)}]}}\n'
    )


def test_each_frame_is_readable_as_soon_as_it_is_written(tmp_path):
    with Recorder(tmp_path / "take") as recorder:
        for k in range(5):
            recorder.write(make_frame(k))
            assert_clip_is(read_one(tmp_path / "take"), [make_frame(i) for i in range(k + 1)])


def test_the_disk_is_synced_once_a_second_and_at_the_end(tmp_path, monkeypatch):
    clock, synced = iter([10.0, 10.4, 10.9, 11.0, 11.5, 12.1]), []
    monkeypatch.setattr(capture.recording.clock, "now", lambda: next(clock))
    monkeypatch.setattr(capture.recording.os, "fsync", synced.append)
    counts = []
    with Recorder(tmp_path / "take") as recorder:
        for k in range(5):
            recorder.write(make_frame(k))
            if recorder._syncing is not None:
                recorder._syncing.result()
            counts.append(len(synced))
    assert counts == [0, 0, 1, 1, 2]
    assert len(synced) == 3


def test_no_frame_waits_for_the_disk(tmp_path, monkeypatch):
    """The disk is busy until the take is closed. All events are written, and nothing is synchronised twice."""
    clock, done, synced = itertools.count(), threading.Event(), []
    monkeypatch.setattr(capture.recording.clock, "now", lambda: next(clock))
    monkeypatch.setattr(capture.recording.os, "fsync", lambda file: (synced.append(file), done.wait(60)))
    with Recorder(tmp_path / "take") as recorder:
        for k in range(5):
            recorder.write(make_frame(k))
        assert len(list(events(tmp_path / "take"))) == 5
        done.set()
    assert len(synced) == 2


def test_a_disk_that_fails_to_sync_is_reported(tmp_path, monkeypatch):
    def fail(_):
        raise OSError(errno.EIO, "Input/output error")

    clock = itertools.count()
    monkeypatch.setattr(capture.recording.clock, "now", lambda: next(clock))
    monkeypatch.setattr(capture.recording.os, "fsync", fail)
    for tell in (Recorder.close, lambda recorder: [recorder.write(make_frame(k)) for k in range(10_000)]):
        recorder = Recorder(tmp_path / "take")
        with pytest.raises(OutputError, match="Input/output error"):
            tell(recorder)
        assert recorder._file.closed
        recorder.close()


def test_every_kind_of_event_reads_back_to_the_bit(tmp_path):
    written = list(performance(40))
    record(tmp_path / "take", written)
    assert_reads_back(tmp_path / "take", written)
    clips = read(tmp_path / "take", ReadOptions())
    frames = [event for event in written if isinstance(event, SkeletonFrame)]
    for clip, user in zip(clips, (1, 2), strict=True):
        assert_clip_is(clip, [frame for frame in frames if frame.user == user])


@given(
    positions=arrays(np.float64, (len(JOINTS), 3), elements=st.floats(-1000, 1000) | st.just(np.nan)),
    confidence=arrays(np.float32, len(JOINTS), elements=st.floats(0, 1, width=32)),
    time=st.floats(allow_nan=False, allow_infinity=False),
    user=st.integers(-(2**31), 2**31),
    channels=st.dictionaries(st.sampled_from(("smile", "voice", "index_1_left")), st.floats(0, 1)),
)
def test_as_recorded_is_the_frame_that_is_read_back_and_recorded_unchanged(
    tmp_path_factory, positions, confidence, time, user, channels
):
    frame = SkeletonFrame(time, user, positions, confidence, channels=channels)
    recorded = as_recorded(frame)
    assert same(as_recorded(recorded), recorded)
    assert encode(recorded) == encode(frame)
    path = tmp_path_factory.getbasetemp() / "one_frame"
    path.write_bytes(HEADER + encode(frame))
    assert_reads_back(path, [frame])


@pytest.mark.parametrize("wrong", [Cue(0.0, "x", {"n": float("nan")}), Cue(0.0, "x", {"n": b""}), Tick(float("inf"))])
def test_values_that_json_lacks_are_refused_before_writing(tmp_path, wrong):
    with Recorder(tmp_path / "take") as recorder:
        with pytest.raises((ValueError, TypeError)):
            recorder.write(wrong)
        recorder.write(Tick(1.0))
    assert (tmp_path / "take").read_bytes() == HEADER + encode(Tick(1.0))


def test_cut_off_at_any_byte_a_take_keeps_its_complete_lines_and_can_be_continued(tmp_path, monkeypatch):
    """The lines contain nested objects, so many cut-off lines end in a brace."""
    monkeypatch.setattr(capture.recording.os, "fsync", lambda _: None)  # thousands of calls take long
    written = list(performance(2))
    record(tmp_path / "whole", written)
    whole = (tmp_path / "whole").read_bytes()
    ends = [place + 1 for place, byte in enumerate(whole) if byte == ord("\n")]
    cut = tmp_path / "cut"
    # after each brace and line feed, by which readers know the end of a line, and every fifth byte
    sizes = [size for size in range(len(whole)) if size % 5 == 0 or whole[size - 1 : size] in (b"}", b"\n")]
    for size in sizes:
        cut.write_bytes(whole[:size])
        complete = sum(size >= end for end in ends[1:])
        assert_reads_back(cut, written[:complete])
        record(cut, [Tick(99.0)])
        assert_reads_back(cut, [*written[:complete], Tick(99.0)])
        assert cut.read_bytes().startswith(whole[:size])


CHILD = """
import sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from capture.recording import Recorder
from test_recording import make_frame
recorder = Recorder(Path(sys.argv[1]))
for k in range(1_000_000):
    recorder.write(make_frame(k))
    print(k, flush=True)
"""


def test_a_killed_process_loses_nothing_that_it_wrote(tmp_path):
    script = CHILD.format(tests=str(Path(__file__).parent))
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path / "take")], stdout=subprocess.PIPE, text=True
    ) as child:
        for _ in range(40):
            child.stdout.readline()
        child.kill()
        said = 40 + len(child.stdout.read().split())
    clip = read_one(tmp_path / "take")
    assert child.returncode == -signal.SIGKILL
    assert said <= len(clip.times) <= said + 1
    assert_clip_is(clip, [make_frame(k) for k in range(len(clip.times))])


@pytest.mark.parametrize("content", [b"60 0.1 0.2\n", b'{"frames": []}', HEADER.replace(b": 2,", b": 1,"), b"\n"])
def test_a_file_of_another_format_is_refused_and_left_unchanged(tmp_path, content):
    (tmp_path / "take").write_bytes(content)
    with pytest.raises(OutputError, match="not a take"):
        Recorder(tmp_path / "take")
    assert (tmp_path / "take").read_bytes() == content


def test_a_path_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(OutputError, match=re.escape("found a file that cannot be written (Is a directory)")):
        Recorder(tmp_path)


def test_a_full_disk_ends_the_take_which_can_be_continued(tmp_path):
    """A limit on the size of files simulates the full disk."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    whole = HEADER + b"".join(encode(make_frame(k)) for k in range(2))
    recorder = Recorder(tmp_path / "take")
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(whole) - 100, limits[1]))
        recorder.write(make_frame(0))
        with pytest.raises(OutputError, match="File too large"):
            recorder.write(make_frame(1))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    recorder.close()
    assert (tmp_path / "take").read_bytes() == whole[:-100]
    record(tmp_path / "take", [make_frame(2)])
    assert_clip_is(read_one(tmp_path / "take"), [make_frame(0), make_frame(2)])
