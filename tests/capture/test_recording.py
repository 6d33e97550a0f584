import itertools
import re
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import capture.recording
from capture.formats.options import ReadOptions
from capture.formats.puppetline_log import read
from capture.recording import HEADER, Recorder, encode
from capture.skeleton import LOST, SkeletonFrame
from puppetline.errors import OutputError, SkeletonLogError


def make_frame(k, user=1):
    """Frame k of a performance that every process makes alike; every third frame loses some joints."""
    rng = np.random.default_rng(k)
    confidence = rng.choice([1.0, 0.5, 0.7], size=20).astype(np.float32)
    if k % 3 == 0:
        confidence[rng.choice(20, size=4, replace=False)] = LOST
    positions = np.where(confidence[:, None] == LOST, np.nan, rng.normal(size=(20, 3)))
    return SkeletonFrame(k / 30, user, positions, confidence)


def record(path, frames):
    with Recorder(path) as recorder:
        for frame in frames:
            recorder.write(frame)


def assert_clip_is(clip, frames):
    np.testing.assert_array_equal(clip.times, [frame.time for frame in frames])
    np.testing.assert_array_equal(clip.positions, np.round([frame.positions for frame in frames], 5))
    np.testing.assert_array_equal(clip.confidence, [frame.confidence for frame in frames])


def read_one(path):
    (clip,) = read(path, ReadOptions())
    return clip


def test_what_is_read_is_what_was_recorded_to_a_hundredth_of_a_millimetre(tmp_path):
    frames = [make_frame(k) for k in range(50)]
    record(tmp_path / "take", frames)
    clip = read_one(tmp_path / "take")
    assert_clip_is(clip, frames)
    assert (clip.format, clip.user, clip.notes) == ("puppetline", 1, ())
    np.testing.assert_allclose(clip.positions, [frame.positions for frame in frames], rtol=0, atol=0.5e-5 + 1e-12)


def test_recording_what_was_read_gives_the_same_bytes(tmp_path):
    record(tmp_path / "take", [make_frame(k) for k in range(20)])
    clip = read_one(tmp_path / "take")
    frames = map(SkeletonFrame, clip.times, itertools.repeat(1), clip.positions, clip.confidence)
    record(tmp_path / "again", frames)
    assert (tmp_path / "again").read_bytes() == (tmp_path / "take").read_bytes()


def test_a_frame_is_one_line_of_json_with_null_for_what_is_lost():
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


def test_each_frame_is_one_write(tmp_path, monkeypatch):
    class Spy:
        def __init__(self, file):
            self.file, self.writes = file, []

        def write(self, data):
            self.writes.append(data)
            return self.file.write(data)

    with Recorder(tmp_path / "take") as recorder:
        spy = Spy(recorder._file)
        with monkeypatch.context() as patch:
            patch.setattr(recorder, "_file", spy)
            for k in range(5):
                recorder.write(make_frame(k))
    assert spy.writes == [encode(make_frame(k)) for k in range(5)]


def test_the_disk_is_synced_once_a_second_and_at_the_end(tmp_path, monkeypatch):
    clock, synced = iter([10.0, 10.4, 10.9, 11.0, 11.5, 12.1]), []
    monkeypatch.setattr(capture.recording.time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(capture.recording.os, "fsync", synced.append)
    counts = []
    with Recorder(tmp_path / "take") as recorder:
        for k in range(5):
            recorder.write(make_frame(k))
            counts.append(len(synced))
    assert counts == [0, 0, 1, 1, 2]
    assert len(synced) == 3


def test_cut_off_at_any_byte_all_complete_frames_are_there_and_recording_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(capture.recording.os, "fsync", lambda _: None)  # thousands of them take long
    frames = [make_frame(k) for k in range(3)]
    record(tmp_path / "whole", frames)
    whole = (tmp_path / "whole").read_bytes()
    ends = list(itertools.accumulate([len(HEADER), *(len(encode(frame)) for frame in frames)]))
    assert ends[-1] == len(whole)
    later, cut = make_frame(9), tmp_path / "cut"
    for size in range(len(whole)):
        cut.write_bytes(whole[:size])
        complete = sum(size >= end - 1 for end in ends[1:])  # the line's end is not part of the frame
        torn = size not in ends and size + 1 not in ends and size > 0
        line = 1 + sum(size >= end for end in ends)
        notes = (f"Line {line} was cut off in mid-write: left out.",) if torn else ()
        if complete:
            clip = read_one(cut)
            assert_clip_is(clip, frames[:complete])
            assert clip.notes == notes
        else:
            with pytest.raises(SkeletonLogError, match="no frame with a tracked performer"):
                read(cut, ReadOptions())

        record(cut, [later])
        clip = read_one(cut)
        assert_clip_is(clip, [*frames[:complete], later])
        assert clip.notes == (notes if size > len(HEADER) else ())
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
        time.sleep(0.05)
        child.kill()
        said = 40 + len(child.stdout.read().split())
    clip = read_one(tmp_path / "take")
    assert child.returncode != 0
    assert said <= len(clip.times) <= said + 1
    assert_clip_is(clip, [make_frame(k) for k in range(len(clip.times))])


def test_recording_into_a_finished_recording_continues_it(tmp_path):
    frames = [make_frame(k) for k in range(6)]
    record(tmp_path / "take", frames[:3])
    record(tmp_path / "take", frames[3:])
    assert_clip_is(read_one(tmp_path / "take"), frames)
    assert (tmp_path / "take").read_bytes().count(HEADER) == 1


@pytest.mark.parametrize("content", [b"60 0.1 0.2\n", b'{"frames": []}', HEADER.replace(b": 1,", b": 2,"), b"\n"])
def test_a_file_that_is_something_else_is_refused_and_left_alone(tmp_path, content):
    (tmp_path / "take").write_bytes(content)
    with pytest.raises(OutputError, match="not a recording"):
        Recorder(tmp_path / "take")
    assert (tmp_path / "take").read_bytes() == content


def test_a_place_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(OutputError, match=re.escape(f"{tmp_path}: found Is a directory")):
        Recorder(tmp_path)


def test_where_the_disk_takes_only_part_of_a_frame_the_recording_ends_and_can_be_continued(tmp_path):
    """A limit on the size of files stands for the full disk."""
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


def test_several_performers_are_several_clips(tmp_path):
    frames = [make_frame(k, user=(5, 2)[k % 2]) for k in range(10)]
    record(tmp_path / "take", frames)
    first, second = read(tmp_path / "take", ReadOptions())
    assert (first.user, second.user) == (5, 2)
    assert_clip_is(first, frames[::2])
    assert_clip_is(second, frames[1::2])
