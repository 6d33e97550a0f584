import pytest

from capture.network.assembly import PART_TIMEOUT_SECONDS, FrameAssembly
from capture.network.dialect import Part


def _names(frames):
    return ["".join(frame.parts) for frame in frames]


def _feed(assembly, names, time, stamp=None, **kwargs):
    """Add parts, and return the names of those in the frames that are complete."""
    return _names([frame for name in names for frame in assembly.add(Part(1, name, (0.0,), stamp), time, **kwargs)])


@pytest.fixture
def assembly():
    """An assembly that has just completed a frame of three parts."""
    new = FrameAssembly()
    assert _feed(new, "abc", 1.0) == []
    assert _names(new.end()) == ["abc"]
    return new


def test_a_frame_is_complete_with_the_parts_of_the_frame_before_in_any_order(assembly):
    assert _feed(assembly, "cb", 2.0) == []
    [whole] = assembly.add(Part(1, "a", (7.0,), None), 2.001)
    assert (whole.parts, whole.time) == ({"c": (0.0,), "b": (0.0,), "a": (7.0,)}, 2.001)
    assert assembly.end() == []


def test_a_repeated_part_ends_the_frame_without_the_missing_one(assembly):
    assert _feed(assembly, "ab", 2.0) == []
    [whole] = assembly.add(Part(1, "a", (0.0,), None), 2.033)
    assert (_names([whole]), whole.time) == (["ab"], 2.0)
    assert _feed(assembly, "b", 2.034) == ["ab"]


def test_a_part_with_a_later_time_of_the_sender_ends_the_frame_and_one_with_the_same_is_late():
    assembly = FrameAssembly()
    assert _feed(assembly, "ab", 1.0, stamp=1.0) == []
    assert _feed(assembly, "b", 1.01, stamp=2.0) == ["ab"]
    assert _names(assembly.end()) == ["b"]
    assert _feed(assembly, "c", 2.5, stamp=2.0) == []
    assert not assembly.parts
    assert _feed(assembly, "c", 2.5001, stamp=3.0) == []
    assert list(assembly.parts) == ["c"]


def test_a_part_after_its_frame_is_skipped_once_and_expected_afterwards(assembly):
    assert _feed(assembly, "abc", 2.0) == ["abc"]
    assert _feed(assembly, "d", 2.0 + PART_TIMEOUT_SECONDS / 2) == []
    assert not assembly.parts
    assert _feed(assembly, "abc", 3.0) == []
    assert _feed(assembly, "d", 3.0) == ["abcd"]


def test_a_new_part_after_a_pause_begins_a_frame(assembly):
    assert _feed(assembly, "d", 1.0 + 2 * PART_TIMEOUT_SECONDS) == []
    assert _feed(assembly, "abc", 1.0 + 2 * PART_TIMEOUT_SECONDS) == ["dabc"]


def test_an_announced_end_is_the_only_end(assembly):
    for names in ("abcd", "e"):
        assert _feed(assembly, names, 1.001, end_follows=True) == []
        assert _names(assembly.end()) == [names]


def test_two_frames_can_end_at_once():
    assembly = FrameAssembly()
    _feed(assembly, "a", 1.0, stamp=1.0)
    assembly.end()
    _feed(assembly, "b", 1.1, stamp=1.5)
    assert _feed(assembly, "b", 1.2, stamp=2.0) == ["b", "b"]
