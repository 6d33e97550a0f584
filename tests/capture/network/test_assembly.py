import pytest

from capture.network.assembly import PART_TIMEOUT_SECONDS, FrameAssembly
from capture.network.dialect import Part

SOON, LATER = 1.0 + PART_TIMEOUT_SECONDS / 2, 1.0 + 2 * PART_TIMEOUT_SECONDS
CASES = {
    "a frame is complete with the parts of the frame before in any order": [("cb", 2.0, None), ("a", 3.0, None, "cba")],
    "a repeated part ends the frame without the missing one": [("ab", 2.0, None), ("ab", 2.0, None, "ab", "ab")],
    "a part after its frame is skipped once and expected afterwards": [
        ("d", SOON, None),
        ("abc", 3.0, None),
        ("d", 3.0, None, "abcd"),
    ],
    "a new part after a pause begins a frame": [("d", LATER, None), ("abc", LATER, None, "dabc")],
    "a later time of the sender ends the frame": [("ab", 2.0, 1.0), ("b", 2.0, 2.0, "ab")],
    "a part with the same time of the sender is late": [
        ("abc", 2.0, 2.0, "abc"),
        ("d", 9.0, 2.0),
        ("d", 9.0, 3.0),
        ("a", 9.0, 4.0, "d"),
    ],
    "two frames can end at once": [("a", 2.0, 1.0), ("a", 2.0, 2.0, "a", "a")],
}


@pytest.mark.parametrize("steps", CASES.values(), ids=CASES)
def test_frames_end_as_their_parts_and_times_say(steps):
    """After a frame of three parts."""
    assembly = FrameAssembly()
    for names, time, stamp, *frames in [("abc", 1.0, None), *steps]:
        ended = [frame for name in names for frame in assembly.add(Part(1, name, (7.0,), stamp), time)]
        assert [frame.parts for frame in ended] == [dict.fromkeys(each, (7.0,)) for each in frames]
        if time == 1.0:
            assembly.end()


def test_an_announced_end_is_the_only_end():
    assembly = FrameAssembly()
    for names in ("abc", "abcd", "e"):
        assert not [each for name in names for each in assembly.add(Part(1, name, ()), 1.0, end_follows=True)]
        assert [list(frame.parts) for frame in assembly.end()] == [[*names]]
    assert assembly.end() == []
