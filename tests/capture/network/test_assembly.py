import pytest

from capture.network.assembly import PART_TIMEOUT_SECONDS, FrameAssembly
from capture.network.dialect import Part


def _part(name, value=0.0, stamp=None):
    return Part(1, name, (value,), stamp)


def _names(frames):
    return ["".join(frame.parts) for frame in frames]


def _feed(assembly, names, time, **kwargs):
    return _names([frame for name in names for frame in assembly.add(_part(name), time, **kwargs)])


@pytest.fixture
def assembly():
    """An assembly that has just completed a frame of three parts."""
    new = FrameAssembly()
    assert _feed(new, "abc", 1.0) == []
    assert _names(new.end()) == ["abc"]
    return new


def test_a_frame_is_complete_with_the_parts_of_the_frame_before_in_any_order(assembly):
    assert _feed(assembly, "cb", 2.0) == []
    [whole] = assembly.add(_part("a", 7.0), 2.001)
    assert whole.parts == {"c": (0.0,), "b": (0.0,), "a": (7.0,)}
    assert whole.time == 2.001
    assert assembly.end() == []


def test_a_repeated_part_ends_the_frame_without_the_missing_one(assembly):
    assert _feed(assembly, "ab", 2.0) == []
    [whole] = assembly.add(_part("a"), 2.033)
    assert "".join(whole.parts) == "ab"
    assert whole.time == 2.0
    assert _feed(assembly, "b", 2.034) == ["ab"]


def test_a_part_with_a_later_time_of_the_sender_ends_the_frame():
    assembly = FrameAssembly()
    for name in "ab":
        assert assembly.add(_part(name, stamp=1.0), 1.0) == []
    assert _names(assembly.add(_part("c", stamp=2.0), 1.01)) == ["ab"]
    assert list(assembly.parts) == ["c"]


def test_a_part_after_its_frame_is_skipped_once_and_expected_afterwards(assembly):
    assert _feed(assembly, "abc", 2.0) == ["abc"]
    assert _feed(assembly, "d", 2.0 + PART_TIMEOUT_SECONDS / 2) == []
    assert not assembly.parts
    assert _feed(assembly, "abc", 3.0) == []
    assert _feed(assembly, "d", 3.0) == ["abcd"]


def test_the_senders_time_determines_which_parts_are_late():
    assembly = FrameAssembly()
    for stamp in (1.0, 2.0):
        frames = [frame for name in "ab" for frame in assembly.add(_part(name, stamp=stamp), stamp)]
        frames += assembly.end()
        assert _names(frames) == ["ab"]
    assert assembly.add(_part("c", stamp=2.0), 2.5) == []
    assert not assembly.parts
    assert assembly.add(_part("c", stamp=3.0), 2.5001) == []
    assert list(assembly.parts) == ["c"]


def test_a_new_part_after_a_pause_begins_a_frame(assembly):
    assert _feed(assembly, "d", 1.0 + 2 * PART_TIMEOUT_SECONDS) == []
    assert list(assembly.parts) == ["d"]
    assert _feed(assembly, "abc", 1.0 + 2 * PART_TIMEOUT_SECONDS) == ["dabc"]


def test_an_announced_end_is_the_only_end(assembly):
    assert _feed(assembly, "abcd", 1.001, end_follows=True) == []
    assert _names(assembly.end()) == ["abcd"]
    assert _feed(assembly, "e", 1.002, end_follows=True) == []
    assert _names(assembly.end()) == ["e"]


def test_two_frames_can_end_at_once():
    assembly = FrameAssembly()
    assembly.add(_part("a"), 1.0)
    assembly.end()
    assembly.add(_part("b"), 2.0)
    assert _names(assembly.add(_part("a"), 2.0)) == ["ba"]
    one = FrameAssembly()
    one.add(_part("a", stamp=1.0), 1.0)
    one.end()
    one.add(_part("b", stamp=1.5), 1.1)
    assert _names(one.add(_part("b", stamp=2.0), 1.2)) == ["b", "b"]
