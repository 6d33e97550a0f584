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


def log(tmp_path, *lines):
    path = tmp_path / "take"
    path.write_bytes(b"".join(lines))
    return path


def error_of(path):
    with pytest.raises(SkeletonLogError) as caught:
        read(path, ReadOptions())
    return caught.value


def test_a_take_of_any_version_is_recognised_by_its_first_line():
    assert matches(HEADER + line())
    assert matches(HEADER.replace(b": 2,", b": 27,"))
    assert not matches(b"")
    assert not matches(line())
    assert not matches(b'{"frames": [], "puppetline": "skeleton log"}')


def test_incomplete_lines_are_skipped_with_a_note(tmp_path):
    (clip,) = read(log(tmp_path, HEADER, line(0.0), line(1.0)[:40] + b"\n", line(2.0)), ReadOptions())
    np.testing.assert_array_equal(clip.times, [0.0, 2.0])
    assert clip.notes == ("Line 3 is incomplete and was skipped.",)
    (clip,) = read(log(tmp_path, HEADER, line(0.0), b"\0\0\0\n", line(2.0), line(3.0)[:-3]), ReadOptions())
    np.testing.assert_array_equal(clip.times, [0.0, 2.0])
    assert clip.notes == ("2 lines are incomplete and were skipped; the first is line 3.",)


def test_line_ends_of_another_system_are_fine(tmp_path):
    (clip,) = read(log(tmp_path, (HEADER + line(0.0) + line(1.0)).replace(b"\n", b"\r\n")), ReadOptions())
    np.testing.assert_array_equal(clip.times, [0.0, 1.0])
    assert clip.notes == ()


def test_times_of_a_performer_that_do_not_increase_are_skipped_with_a_note(tmp_path):
    lines = [line(1.0), line(0.5, user=2), line(1.0), line(0.9), line(0.6, user=2), line(1.1)]
    one, two = read(log(tmp_path, HEADER, *lines), ReadOptions())
    np.testing.assert_array_equal(one.times, [1.0, 1.1])
    np.testing.assert_array_equal(two.times, [0.5, 0.6])
    assert one.notes == ("Skipped 2 of 4 frames that repeat or precede an earlier time.",)
    assert two.notes == ()


@pytest.mark.parametrize(
    ("other", "field", "found"),
    [
        ({"t": "1"}, "t", "1"),
        ({"t": True}, "t", "True"),
        ({"t": 10**400}, "t", "1" + 56 * "0" + "…"),
        ({"t": float("nan")}, "t", "nan"),
        ({"user": 1.5}, "user", "1.5"),
        ({"user": None}, "user", "nothing"),
        ({"p": {}}, "p", "{}"),
        ({"p": [None] * 19}, "p", "a list of 19"),
        ({"c": [1.0] * 21}, "c", "a list of 21"),
        ({"c": [1.0] * 19 + [1.01]}, "c[19]", "1.01"),
        ({"c": [-0.5] + [1.0] * 19}, "c[0]", "-0.5"),
        ({"c": [None] * 20}, "c[0]", "nothing"),
        ({"c": [1.0, 0.0] + [1.0] * 18}, "p[1]", "[0.5, 1.0, 2.0]"),
        ({"p": [None] * 20}, "p[0]", "nothing"),
        ({"p": [[1.0, 2.0]] * 20}, "p[0]", "[1.0, 2.0]"),
        ({"p": [[1.0, 2.0, "3"]] * 20}, "p[0]", "[1.0, 2.0, '3']"),
        ({"p": [[1.0, 2.0, float("inf")]] * 20}, "p[0]", "[1.0, 2.0, inf]"),
        ({"channels": [0.5]}, "channels", "[0.5]"),
        ({"channels": {"voice": 1.5}}, "channels", "{'voice': 1.5}"),
    ],
)
def test_a_complete_line_that_is_wrong_is_an_error_with_line_and_field(tmp_path, other, field, found):
    path = log(tmp_path, HEADER, line(0.0), line(**other))
    error = error_of(path)
    assert error.where == f"{path}, line 3, {field}"
    assert error.found == found


@pytest.mark.parametrize("text", [b'{"t": }', b'{"\xff": 1}', b"hello}", b"[" * 100_000 + b"}", b"{}{}"])
def test_a_complete_line_that_is_not_json_is_an_error_with_its_line(tmp_path, text):
    path = log(tmp_path, HEADER, text + b"\n", line(0.0))
    error = error_of(path)
    assert error.where == f"{path}, line 2"
    assert error.found.startswith("a line that is not JSON")


def test_a_newer_version_is_refused_by_its_number(tmp_path):
    path = log(tmp_path, HEADER.replace(b": 2,", b": 3,"), line())
    error = error_of(path)
    assert (error.where, error.found, error.expected) == (f"{path}, line 1, version", "3", "1 to 2")


def test_a_recording_of_version_1_reads_as_ever(tmp_path):
    path = log(tmp_path, HEADER.replace(b": 2,", b": 1,"), line(0.0), line(1.0)[:-9] + b"\n", line(2.0))
    (clip,) = read(path, ReadOptions())
    np.testing.assert_array_equal(clip.times, [0.0, 2.0])
    assert clip.notes == ("Line 3 is incomplete and was skipped.",)
    assert [event.time for event in events(path)] == [0.0, 2.0]
    assert not has_old_state(path)


def test_a_clip_has_only_frames_and_the_events_have_everything(tmp_path):
    others = (
        b'{"t": 0.5, "tick": true}\n{"t": 1, "lost": 1}\n{"t": 1, "lost": 2, "again": true}\n'
        b'{"t": 1.5, "do": "mirror", "arguments": {"character": "dog"}}\n'
    )
    path = log(tmp_path, HEADER, b'{"beginning": {"a": {"b": [0.1]}}}\n', line(0.0), others, line(2.0))
    (clip,) = read(path, ReadOptions())
    np.testing.assert_array_equal(clip.times, [0.0, 2.0])
    assert list(events(path))[1:-1] == [
        Tick(0.5),
        Lost(1.0, 1),
        Lost(1.0, 2, again=True),
        Cue(1.5, "mirror", {"character": "dog"}),
    ]
    assert has_old_state(path)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        (b'{"tick": true}', "t"),
        (b'{"t": NaN, "tick": true}', "t"),
        (b'{"t": 0, "lost": "1"}', "lost"),
        (b'{"t": 0, "lost": true}', "lost"),
        (b'{"t": 0, "do": 5, "arguments": {}}', "do"),
        (b'{"t": 0, "do": "mirror"}', "arguments"),
        (b'{"t": 0, "do": "mirror", "arguments": []}', "arguments"),
        (b'{"beginning": {}}', "t"),
    ],
)
def test_a_wrong_line_of_another_kind_is_an_error_with_line_and_field(tmp_path, text, field):
    path = log(tmp_path, HEADER, line(0.0), text + b"\n")
    assert error_of(path).where == f"{path}, line 3, {field}"
    with pytest.raises(SkeletonLogError):
        list(events(path))


def test_a_confidence_that_is_nothing_in_single_precision_is_lost(tmp_path):
    error = error_of(log(tmp_path, HEADER, line(c=[1e-60] + [1.0] * 19)))
    assert (error.where.rpartition(", ")[2], error.expected) == ("p[0]", "null, because its confidence is 0")


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


def test_other_joints_are_refused(tmp_path):
    joints = json.dumps({"puppetline": "skeleton log", "version": 2, "joints": JOINTS[::-1]}).encode() + b"\n"
    assert error_of(log(tmp_path, joints, line())).where.endswith("line 1, joints")


@pytest.mark.parametrize("content", [HEADER, HEADER[:50], HEADER + line(c=[0.0] * 20, p=[None] * 20)])
def test_a_recording_without_a_performer_is_refused(tmp_path, content):
    assert error_of(log(tmp_path, content)).found == "no frame with a tracked performer"


def test_a_missing_file_is_an_error_with_its_path(tmp_path):
    error = error_of(tmp_path / "none")
    assert (error.where, error.found) == (
        str(tmp_path / "none"),
        "a file that cannot be read (No such file or directory)",
    )


def test_what_a_reader_does_not_know_of_a_frame_is_ignored(tmp_path):
    """So a reader that is older than channels ignores them."""
    assert [event.user for event in events(log(tmp_path, HEADER, line(later={"x": [1]})))] == [1]


def test_channels_of_a_take_are_resampled_between_the_frames_that_have_them(tmp_path):
    lines = [line(0.0, channels={"smile": 0.25}), line(0.1), line(0.2, channels={"smile": 0.75})]
    (clip,) = read(log(tmp_path, HEADER, *lines), ReadOptions())
    np.testing.assert_array_equal(clip.channels["smile"], np.float32([0.25, np.nan, 0.75]))
    np.testing.assert_allclose(resample(clip, 10).channels["smile"], [0.25, 0.5, 0.75])
