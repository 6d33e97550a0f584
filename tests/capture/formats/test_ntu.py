import numpy as np
import pytest
from numpy.testing import assert_array_equal

from capture.formats import ntu
from capture.formats.layouts import K25
from capture.skeleton import JOINT_INDEX

CENTRE = K25.index("shoulder_center")


def body(user, frame, number=1, states=None, hands="1 1 1 1"):
    """Lines of a body: x of a joint tells the joint, y the body, z the frame."""
    states = {} if states is None else states
    unused = "260.5 -Infinity nan 540.0 0.1 0.2 0.3 0.4"
    rows = [f"{j / 100} {number / 10} {frame + 1} {unused} {states.get(j, 2)}" for j in range(25)]
    return [f"{user} 0 {hands} 0 nan -0.11 2", "25", *rows]


def take(*frames):
    lines = [str(len(frames))]
    for bodies in frames:
        lines += [str(len(bodies)), *(line for each in bodies for line in each)]
    return lines


def test_joints_are_matched_by_name_and_states_become_confidence(read):
    lines = take([body(7, 0, states={7: 0, 11: 1})])
    [clip] = read(ntu, "\r\n".join(lines) + "\r\n")
    for joint, name in enumerate(K25):
        if name:
            confidence = {7: 0, 11: 0.5}.get(joint, 1)
            assert clip.confidence[0, JOINT_INDEX[name]] == confidence
            place = [joint / 100, 0.1, 1.0] if confidence else [np.nan] * 3
            assert_array_equal(clip.positions[0, JOINT_INDEX[name]], place)


def test_each_body_id_is_a_clip_with_the_times_at_which_it_is_seen(read):
    first, second = 72057594037931101, 72057594037931102  # not distinguishable as float64
    both = [body(second, 2, 2), body(first, 2)]
    lines = take([], [body(first, 1)], both, [], [body(second, 4, 2)])
    for rate, options in ((30, {}), (10, {"fps": 10})):
        one, two = read(ntu, lines, **options)
        assert (one.user, two.user, len(one.notes)) == (first, second, rate == 30)
        assert_array_equal(one.times, np.array([1, 2]) / rate)
        assert_array_equal(two.times, np.array([2, 4]) / rate)
    assert (one.positions[..., 1] == 0.1).all()
    assert (two.positions[..., 1] == 0.2).all()
    assert_array_equal(two.positions[:, 0, 2], [3, 5])


def test_states_of_hands_become_channels_where_the_sensor_is_sure(read):
    [clip] = read(ntu, take(*([body(7, 0, hands=hands)] for hands in ("1 2 0 3", "1 3 1 4", "1 0 1 1"))))
    found = [clip.channels[f"{name}_{side}"] for side in ("left", "right") for name in ("hand_open", "point")]
    nan = np.nan
    assert_array_equal(found, [[1, 0, nan], [0, 0, nan], [nan, 0.25, nan], [nan, 1, nan]])


GOOD = take([], [body(7, 1)])


def broken(line, text):
    """Return an empty frame and one with a body, with one line (from 1) replaced."""
    return [*GOOD[: line - 1], text, *GOOD[line:]]


@pytest.mark.parametrize(
    ("lines", "place"),
    [
        (broken(1, "two"), "line 1"),
        (broken(1, "1" * 10), "line 1"),
        (broken(3, "999999999"), "line 30"),
        (broken(3, "0"), "line 4"),
        (broken(4, "7 0 1 1 1 1 0 0.02 -0.11"), "line 4"),
        (broken(4, "7.5 0 1 1 1 1 0 0.02 -0.11 2"), "line 4"),
        (broken(5, "20"), "line 5"),
        (broken(8, f"{GOOD[7][:-1]}3"), "line 8"),
        (broken(8, "1 2 3"), "line 8"),
        (GOOD[:19], "line 19"),
        ("\n".join(GOOD)[:-20], "line 30"),
        (GOOD[:1], ""),
        (take([], []), ""),
        (take([body(7, 0, states=dict.fromkeys(range(25), 0))]), ""),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(refused_at, lines, place):
    assert refused_at(ntu, lines) == place


def test_a_recording_cut_off_or_of_another_length_than_stated_is_read_up_to_the_last_complete_frame(
    read, assert_same_frames
):
    first = take([body(7, 0)])
    [expected] = read(ntu, first)
    for stated in (0, 2, 999_999_999):
        [clip] = read(ntu, [str(stated), *first[1:]])
        assert_same_frames(clip, expected)
        assert len(clip.notes) == len(expected.notes) + 1
    whole = take([body(7, 0)], [body(7, 1), body(8, 1)])
    text, begun = "\n".join(whole) + "\n", len("\n".join(first)) + 1
    for length in [*range(begun + 1, begun + 40), *range(begun + 40, len(text) - 1, 211)]:
        [clip] = read(ntu, text[:length])
        assert_same_frames(clip, expected)
        assert ["line 30" in note for note in clip.notes] == [False, True, False], length
    for length in (len(text) - 1, len(text)):
        assert [len(clip.times) for clip in read(ntu, text[:length])] == [2, 1]


def test_recognises_a_body_after_the_counts_and_nothing_else():
    text = "\r\n".join(take([], [], [body(7, 2)]))
    assert ntu.matches(text.encode())
    for other in (
        "",
        "3\n1\n",
        text.replace("\r\n25\r\n", "\r\n20\r\n"),
        text.partition("\n")[2].partition("0\r\n0")[0],
    ):
        assert not ntu.matches(other.encode())
