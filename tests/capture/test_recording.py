import errno
import os
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from capture.events import Cue, Lost, Tick
from capture.formats.puppetline_log import events
from capture.recording import HEADER, Recorder, as_recorded, encode
from capture.skeleton import JOINTS, LOST, SkeletonFrame
from puppetline.errors import OutputError

from ..recordings import key, keys, random_frame, record


def make_frame(k, user=1):
    """Return a frame of random positions; every third one has no channels."""
    return random_frame(k / 30, user, {"smile": 0.1 * k, "voice": 0.0} if k % 3 else None)


def performance():
    """Return frames of two performers, and all other events between them."""
    state = {"dog": {"rest": [[0.1, 1 / 3, -0.0], None], "mirror": True, "since": 1e-320}}  # floats of every kind
    yield Cue(0.0, "stage", {"characters": state, "level": {}})
    for k in range(2):
        yield make_frame(k, user=1 + k)
        yield Tick(k / 30)
        if k:
            yield Lost(k / 30, user=2)
            yield Lost(k / 30, user=2, again=True)
            yield Cue(k / 30, "mirror", {"character": "dog", "rest": {"of": [k / 7, None, {"é": "}"}]}})


def assert_reads_back(path, written):
    """All written events are read back bit for bit, frames as returned by `as_recorded`."""
    assert list(map(key, events(path))) == keys(written)


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


def test_the_disk_is_synced_once_a_second_and_at_the_end(tmp_path, monkeypatch, given_clock):
    synced, counts = [], []
    monkeypatch.setattr(os, "fsync", synced.append)
    with Recorder(tmp_path / "take") as recorder:
        for step in (0.0, 0.75, 0.25, 0.5, 0.75):
            given_clock.advance(step)
            recorder.write(Tick(0.0))
            if recorder._syncing is not None:
                recorder._syncing.result()
            counts.append(len(synced))
    assert counts == [0, 0, 1, 1, 2]
    assert len(synced) == 3


def test_no_frame_waits_for_the_disk(tmp_path, monkeypatch, given_clock):
    """The disk is busy until the take is closed. All events are written, and nothing is synchronised twice."""
    done, synced = threading.Event(), []
    monkeypatch.setattr(os, "fsync", lambda file: (synced.append(file), done.wait(60)))
    with Recorder(tmp_path / "take") as recorder:
        for k in range(5):
            given_clock.advance(1)
            recorder.write(make_frame(k))
        assert len(list(events(tmp_path / "take"))) == 5
        done.set()
    assert len(synced) == 2


@pytest.mark.parametrize("seconds", [0, 1])
def test_a_disk_that_fails_to_sync_is_reported_at_the_next_frame_or_the_end(
    tmp_path, monkeypatch, given_clock, seconds
):
    def fail(_):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(os, "fsync", fail)
    recorder = Recorder(tmp_path / "take")
    with pytest.raises(OutputError):  # noqa: PT012
        for _ in range(2 * seconds):
            given_clock.advance(seconds)
            recorder.write(Tick(0.0))
            recorder._syncing.exception()
        assert not seconds
        recorder.close()
    assert recorder._file.closed
    recorder.close()


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
    assert key(as_recorded(recorded)) == key(recorded)
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


def test_cut_off_at_any_byte_a_take_keeps_its_complete_lines_and_can_be_continued(tmp_path):
    """The lines contain nested objects, so many cut-off lines end in a brace."""
    written, cut = list(performance()), tmp_path / "cut"
    whole = record(tmp_path / "whole", written).read_bytes()
    # after each brace and line feed, by which readers know the end of a line, and every fifth byte
    sizes = [size for size in range(len(whole) + 1) if size % 5 == 0 or whole[size - 1 : size] in (b"}", b"\n")]
    for size in sizes:
        cut.write_bytes(whole[:size])
        complete = written[: max(0, whole[:size].count(b"\n") - 1)]
        assert_reads_back(cut, complete)
        assert_reads_back(record(cut, [Tick(99.0)]), [*complete, Tick(99.0)])
        assert cut.read_bytes().startswith(whole[:size])


CHILD = """
import sys
from pathlib import Path
from capture.events import Tick
from capture.recording import Recorder
recorder = Recorder(Path(sys.argv[1]))
for k in range(1_000_000):
    recorder.write(Tick(k))
    print(k, flush=True)
"""


def test_a_killed_process_loses_nothing_that_it_wrote(tmp_path):
    command = [sys.executable, "-c", CHILD, tmp_path / "take"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        for _ in range(40):
            child.stdout.readline()
        child.kill()
        said = 40 + len(child.stdout.read().split())
    assert child.returncode == -signal.SIGKILL
    read = list(events(tmp_path / "take"))
    assert said <= len(read) <= said + 1
    assert read == [Tick(k) for k in range(len(read))]


@pytest.mark.parametrize("content", [b"60 0.1 0.2\n", b'{"frames": []}', HEADER.replace(b": 2,", b": 1,"), b"\n"])
def test_a_file_of_another_format_is_refused_and_left_unchanged(tmp_path, content):
    (tmp_path / "take").write_bytes(content)
    for path in (tmp_path / "take", tmp_path):
        with pytest.raises(OutputError):
            Recorder(path)
    assert (tmp_path / "take").read_bytes() == content


def test_a_full_disk_ends_the_take_which_can_be_continued(tmp_path):
    """A limit on the size of files simulates the full disk."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    first, second = make_frame(0), make_frame(1)
    rest = (HEADER + encode(first) + encode(second))[:-100]
    recorder = Recorder(tmp_path / "take")
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(rest), limits[1]))
        recorder.write(first)
        with pytest.raises(OutputError):
            recorder.write(second)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    recorder.close()
    assert (tmp_path / "take").read_bytes() == rest
    assert_reads_back(record(tmp_path / "take", [second]), [first, second])
