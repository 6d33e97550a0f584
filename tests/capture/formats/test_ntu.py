from pathlib import Path

import numpy as np
import pytest

from capture.formats import ntu
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

from .conftest import assert_refused

KINECT2_INDEX_OF = {"hip_center": 0, "spine": 1, "head": 3, "hand_left": 7, "hand_right": 11, "foot_right": 19}
NECK, SPINE_SHOULDER = 2, 20


def joint_row(joint: int, body: int, frame: int, state: int = 2) -> str:
    """x tells the joint, y the body, z the frame."""
    return f"{joint / 100} {body / 10} {frame + 1} 260.5 210.5 980.0 540.0 0.1 0.2 0.3 0.4 {state}"


def body_lines(user: int, frame: int, body: int = 1, states: dict[int, int] | None = None) -> list[str]:
    rows = [joint_row(joint, body, frame, (states or {}).get(joint, 2)) for joint in range(25)]
    return [f"{user} 0 1 1 1 1 0 0.02 -0.11 2", "25", *rows]


def take(*frames: list[list[str]]) -> list[str]:
    lines = [str(len(frames))]
    for bodies in frames:
        lines += [str(len(bodies)), *(line for body in bodies for line in body)]
    return lines


def write(folder: Path, lines: list[str]) -> Path:
    path = folder / "take.skeleton"
    path.write_text("\r\n".join(lines) + "\r\n")
    return path


def test_joints_are_matched_by_name(tmp_path: Path) -> None:
    (clip,) = ntu.read(write(tmp_path, take([body_lines(7, 0)])), ReadOptions())
    for name, index in KINECT2_INDEX_OF.items():
        assert clip.positions[0, JOINT_INDEX[name]].tolist() == [index / 100, 0.1, 1.0]
    assert clip.positions[0, JOINT_INDEX["shoulder_center"], 0] == SPINE_SHOULDER / 100
    assert NECK / 100 not in clip.positions[0, :, 0]


def test_each_body_id_is_a_clip_with_the_times_at_which_it_is_seen(tmp_path: Path) -> None:
    first, second = 72057594037931101, 72057594037931102  # not distinguishable as float64
    lines = take(
        [],
        [body_lines(first, 1, 1)],
        [body_lines(second, 2, 2), body_lines(first, 2, 1)],
        [],
        [body_lines(second, 4, 2)],
    )
    one, two = ntu.read(write(tmp_path, lines), ReadOptions())
    assert (one.user, two.user) == (first, second)
    np.testing.assert_array_equal(one.times, np.array([1, 2]) / 30)
    np.testing.assert_array_equal(two.times, np.array([2, 4]) / 30)
    assert (one.positions[..., 1] == 0.1).all()
    assert (two.positions[..., 1] == 0.2).all()
    np.testing.assert_array_equal(two.positions[:, 0, 2], [3, 5])


def test_states_become_confidence(tmp_path: Path) -> None:
    (clip,) = ntu.read(write(tmp_path, take([body_lines(7, 0, states={7: 0, 11: 1})])), ReadOptions())
    expected = np.ones(20, np.float32)
    expected[JOINT_INDEX["hand_left"]] = 0
    expected[JOINT_INDEX["hand_right"]] = 0.5
    np.testing.assert_array_equal(clip.confidence[0], expected)


def test_frame_rate_can_be_given(tmp_path: Path) -> None:
    path = write(tmp_path, take([body_lines(7, 0)], [body_lines(7, 1)]))
    assert ntu.read(path, ReadOptions(fps=10))[0].times.tolist() == [0, 0.1]
    assert "30 frames per second" in " ".join(ntu.read(path, ReadOptions())[0].notes)


def test_states_of_hands_become_channels_where_the_sensor_is_sure(tmp_path: Path) -> None:
    frames = [body_lines(7, frame) for frame in range(3)]
    for lines, hands in zip(frames, ("1 2 0 3", "1 3 1 4", "1 0 1 1"), strict=True):
        lines[0] = f"7 0 {hands} 0 0.02 -0.11 2"
    (clip,) = ntu.read(write(tmp_path, take(*([lines] for lines in frames))), ReadOptions())
    assert clip.channels is not None
    found = [clip.channels[f"{name}_{side}"] for side in ("left", "right") for name in ("hand_open", "point")]
    nan = np.nan
    np.testing.assert_array_equal(found, [[1, 0, nan], [0, 0, nan], [nan, 0.25, nan], [nan, 1, nan]])


def broken(line: int, text: str | None) -> list[str]:
    """Return an empty frame and one with a body, with one line (from 1) replaced, or cut off before that line."""
    lines = take([], [body_lines(7, 1)])
    return lines[: line - 1] if text is None else [*lines[: line - 1], text, *lines[line:]]


@pytest.mark.parametrize(
    ("lines", "place", "message"),
    [
        (broken(1, "two"), "line 1", "'two'"),
        (broken(3, "999999999"), "line 30", "a body"),
        (broken(3, "0"), "line 4", "the number of bodies in frame 2, an integer"),
        (broken(4, "7 0 1 1 1 1 0 0.02 -0.11"), "line 4", "10 columns (body id"),
        (broken(4, "7.5 0 1 1 1 1 0 0.02 -0.11 2"), "line 4", "body id '7.5'"),
        (broken(5, "20"), "line 5", "expected 25"),
        (broken(8, joint_row(2, 1, 1, 3)), "line 8", "joint state 3"),
        (broken(8, "1 2 3"), "line 8", "3 columns; expected 12 columns"),
        (broken(20, None), "line 19", "joint 14 of 25"),
        (broken(2, None), "take.skeleton", "no frame with a tracked performer"),
        (take([], []), "take.skeleton", "no frame with a tracked performer"),
        (take([body_lines(7, 0, states=dict.fromkeys(range(25), 0))]), "take.skeleton", "no frame with a tracked"),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(
    tmp_path: Path, lines: list[str], place: str, message: str
) -> None:
    assert_refused(ntu, write(tmp_path, lines), place, message)


@pytest.mark.parametrize("stated", [0, 1, 3, 999_999_999])
def test_a_wrong_frame_count_is_noted_and_all_frames_are_read(tmp_path: Path, assert_same_frames, stated: int) -> None:
    lines = take([body_lines(7, 0)], [body_lines(7, 1)])
    (whole,) = ntu.read(write(tmp_path, lines), ReadOptions())
    (clip,) = ntu.read(write(tmp_path, [str(stated), *lines[1:]]), ReadOptions())
    assert_same_frames(clip, whole)
    note = f"The stated frame count is {stated} and the real one is 2. All complete frames are read."
    assert clip.notes == (*whole.notes, note)


def test_a_recording_cut_off_anywhere_is_read_up_to_the_last_complete_frame(tmp_path: Path, assert_same_frames) -> None:
    begun = take([body_lines(7, 0)], [body_lines(7, 1), body_lines(8, 1)])
    first = "\n".join(take([body_lines(7, 0)])) + "\n"
    text = "\n".join(begun) + "\n"
    path = tmp_path / "take.skeleton"
    path.write_text(first)
    (expected,) = ntu.read(path, ReadOptions())
    cut = "The file ends in the middle of the frame that begins in line 30. This frame is omitted."
    count = "The stated frame count is 2 and the real one is 1. All complete frames are read."
    for length in range(len(first) + 1, len(text) - 1, 7):
        path.write_text(text[:length])
        (clip,) = ntu.read(path, ReadOptions())
        assert_same_frames(clip, expected)
        assert clip.notes == (*expected.notes, cut, count), length
    for length in (len(text) - 1, len(text)):
        path.write_text(text[:length])
        assert [len(clip.times) for clip in ntu.read(path, ReadOptions())] == [2, 1]


def test_a_recording_cut_off_within_its_first_body_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "take.skeleton"
    path.write_text("\n".join(take([], [body_lines(7, 1)]))[:-20])
    with pytest.raises(SkeletonLogError, match="line 30: found the end of the file after"):
        ntu.read(path, ReadOptions())


def test_unused_values_may_be_infinite(tmp_path: Path, assert_same_frames) -> None:
    lines = take([body_lines(7, 0)])
    (whole,) = ntu.read(write(tmp_path, lines), ReadOptions())
    odd = [line.replace("260.5 210.5", "-Infinity nan").replace("0.02 -0.11", "nan nan") for line in lines]
    assert odd != lines
    (clip,) = ntu.read(write(tmp_path, odd), ReadOptions())
    assert_same_frames(clip, whole)
    assert clip.notes == whole.notes


def test_recognises_a_body_after_the_counts_and_nothing_else() -> None:
    assert ntu.matches("\r\n".join(take([], [], [body_lines(7, 2)])).encode())
    assert not ntu.matches(b"")
    assert not ntu.matches(b"3\n1\n")
