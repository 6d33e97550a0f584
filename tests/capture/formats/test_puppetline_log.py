import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from capture.events import Cue, Lost, Tick
from capture.formats.options import ReadOptions
from capture.formats.puppetline_log import events, has_old_state, matches, read
from capture.recording import HEADER
from capture.skeleton import JOINTS, SkeletonFrame
from capture.timeline import resample
from puppetline.errors import SkeletonLogError

from ...oracles import assert_is_error_of, assert_is_sound_clip


def line(time=0.0, user=1, **other):
    values = {"t": time, "user": user, "p": [[0.5, 1.0, 2.0]] * 20, "c": [1.0] * 20}
    return json.dumps(values | other).encode() + b"\n"


@pytest.fixture
def log(tmp_path):
    """Write a take of lines and return its path."""

    def written(*lines):
        path = tmp_path / "take"
        path.write_bytes(b"".join(lines))
        return path

    return written


def clips_of(path):
    return read(path, ReadOptions())


def place_of(path):
    """Return the place in a take that its error names."""
    with pytest.raises(SkeletonLogError) as caught:
        clips_of(path)
    return caught.value.where.removeprefix(str(path)).removeprefix(", ")


def test_a_take_of_any_version_is_recognised_by_its_first_line():
    assert matches(HEADER + line())
    assert matches(HEADER.replace(b": 2,", b": 27,"))
    assert not matches(b"")
    assert not matches(line())
    assert not matches(b'{"frames": [], "puppetline": "skeleton log"}')


@pytest.mark.parametrize("header", [HEADER, HEADER.replace(b": 2,", b": 1,")])
def test_incomplete_lines_are_skipped_with_a_note_in_takes_of_every_version(log, header):
    path = log(header, line(0.0), line(1.0)[:40] + b"\n", line(2.0))
    (clip,) = clips_of(path)
    assert clip.times.tolist() == [event.time for event in events(path)] == [0.0, 2.0]
    assert not has_old_state(path)
    (note,) = clip.notes
    assert "Line 3" in note
    (clip,) = clips_of(log(header, line(0.0), b"\0\0\0\n", line(2.0), line(3.0)[:-3]))
    assert clip.times.tolist() == [0.0, 2.0]
    (note,) = clip.notes
    assert note.startswith("2 lines")
    assert "line 3" in note


def test_line_ends_of_another_system_are_fine(log):
    (clip,) = clips_of(log((HEADER + line(0.0) + line(1.0)).replace(b"\n", b"\r\n")))
    assert (clip.times.tolist(), clip.notes) == ([0.0, 1.0], ())


def test_times_of_a_performer_that_do_not_increase_are_skipped_with_a_note(log):
    lines = [line(1.0), line(0.5, user=2), line(1.0), line(0.9), line(0.6, user=2), line(1.1)]
    one, two = clips_of(log(HEADER, *lines))
    assert (one.times.tolist(), two.times.tolist()) == ([1.0, 1.1], [0.5, 0.6])
    assert "2 of 4 frames" in one.notes[0]
    assert two.notes == ()


@pytest.mark.parametrize(
    ("other", "field"),
    [
        ({"t": "1"}, "t"),
        ({"t": True}, "t"),
        ({"t": 10**400}, "t"),
        ({"t": float("nan")}, "t"),
        ({"user": 1.5}, "user"),
        ({"user": None}, "user"),
        ({"p": {}}, "p"),
        ({"p": [None] * 19}, "p"),
        ({"c": [1.0] * 21}, "c"),
        ({"c": [1.0] * 19 + [1.01]}, "c[19]"),
        ({"c": [-0.5] + [1.0] * 19}, "c[0]"),
        ({"c": [None] * 20}, "c[0]"),
        ({"c": [1.0, 0.0] + [1.0] * 18}, "p[1]"),
        ({"c": [1e-60] + [1.0] * 19}, "p[0]"),  # which is 0 in single precision
        ({"p": [None] * 20}, "p[0]"),
        ({"p": [[1.0, 2.0]] * 20}, "p[0]"),
        ({"p": [[1.0, 2.0, "3"]] * 20}, "p[0]"),
        ({"p": [[1.0, 2.0, float("inf")]] * 20}, "p[0]"),
        ({"o": [[1.0, 0.0, 0.0]] * 20}, "o[0]"),
        ({"channels": [0.5]}, "channels"),
        ({"channels": {"voice": 1.5}}, "channels"),
        ({"lost": "1"}, "lost"),
        ({"lost": True}, "lost"),
        ({"do": 5, "arguments": {}}, "do"),
        ({"do": "mirror"}, "arguments"),
        ({"do": "mirror", "arguments": []}, "arguments"),
    ],
)
def test_a_complete_line_that_is_wrong_is_an_error_with_line_and_field(log, other, field):
    path = log(HEADER, line(0.0), line(**other))
    assert place_of(path) == f"line 3, {field}"
    with pytest.raises(SkeletonLogError):
        list(events(path))


@pytest.mark.parametrize(
    ("content", "where"),
    [
        *(
            (HEADER + text + b"\n" + line(0.0), "line 2")
            for text in (b'{"t": }', b'{"\xff": 1}', b"hello}", b"[" * 100_000 + b"}", b"{}{}")
        ),
        (HEADER + b'{"tick": true}\n', "line 2, t"),
        (HEADER + line() + b'{"beginning": {}}\n', "line 3, t"),
        (HEADER.replace(b": 2,", b": 3,") + line(), "line 1, version"),
        (HEADER.replace(b": 2,", b": 0,") + line(), "line 1, version"),
        (HEADER.replace(JOINTS[0].encode(), b"hip") + line(), "line 1, joints"),
        (HEADER, ""),
        (HEADER[:50], ""),
        (HEADER + line(c=[0.0] * 20, p=[None] * 20), ""),
    ],
)
def test_other_damage_is_an_error_with_its_place(log, content, where):
    assert place_of(log(content)) == where


def test_a_missing_file_is_an_error_with_its_path(tmp_path):
    assert place_of(tmp_path / "none") == ""


def test_a_clip_has_only_frames_and_the_events_have_everything(log):
    others = (
        b'{"t": 0.5, "tick": true}\n{"t": 1, "lost": 1}\n{"t": 1, "lost": 2, "again": true}\n'
        b'{"t": 1.5, "do": "mirror", "arguments": {"character": "dog"}}\n'
    )
    path = log(HEADER, b'{"beginning": {"a": {"b": [0.1]}}}\n', line(0.0), others, line(2.0, later={"x": [1]}))
    (clip,) = clips_of(path)
    assert clip.times.tolist() == [0.0, 2.0]
    cue = Cue(1.5, "mirror", {"character": "dog"})
    assert clip.cues == (cue,)
    first, *between, last = events(path)
    assert between == [Tick(0.5), Lost(1.0, 1), Lost(1.0, 2, again=True), cue]
    assert (first.user, last.user) == (1, 1)  # what a reader does not know of a frame is ignored
    assert has_old_state(path)


@given(
    st.lists(st.binary(max_size=80) | st.sampled_from([line(0.5), line(1.0)[:-5], b"}\n", b'{"t": 1, "tick": 1}\n']))
)
def test_any_bytes_after_the_header_are_read_or_refused(tmp_path_factory, chunks):
    path = tmp_path_factory.getbasetemp() / "any"
    path.write_bytes(HEADER + b"".join(chunks))
    try:
        for clip in read(path, ReadOptions()):
            assert_is_sound_clip(clip)
    except SkeletonLogError as error:
        assert_is_error_of(error, SkeletonLogError, path)
    came = []
    try:
        came.extend(events(path))
    except SkeletonLogError as error:
        assert_is_error_of(error, SkeletonLogError, f"{path}, line ")
    assert all(math.isfinite(event.time) for event in came)
    for event in came:
        if isinstance(event, SkeletonFrame):
            assert np.isfinite(event.positions[event.confidence > 0]).all()
            assert np.isnan(event.positions[event.confidence == 0]).all()
    try:
        assert has_old_state(path) in (True, False)
    except SkeletonLogError as error:
        assert_is_error_of(error, SkeletonLogError, path)


def test_channels_of_a_take_are_resampled_between_the_frames_that_have_them(log):
    lines = [line(0.0, channels={"smile": 0.25}), line(0.1), line(0.2, channels={"smile": 0.75})]
    (clip,) = clips_of(log(HEADER, *lines))
    np.testing.assert_array_equal(clip.channels["smile"], np.float32([0.25, np.nan, 0.75]))
    np.testing.assert_allclose(resample(clip, 10).channels["smile"], [0.25, 0.5, 0.75])
