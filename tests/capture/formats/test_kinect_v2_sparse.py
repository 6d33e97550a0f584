import numpy as np
import pytest

from capture.formats import kinect_v2_sparse
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX, JOINTS
from puppetline.errors import SkeletonLogError

TAKE = """1000
Pos 3
3 0.25 0.5 2.0
20 0.125 0.25 2.5
22 9 9 9
Rot 3
3 0 0 0 1
20 0 0 0 1
22 0 0 0 0
1032
Pos 0
Rot 0
1064
Pos 1
11 -0.5 1 2
Rot 1
11 0 0 0 1
"""


def _write(tmp_path, text):
    log = tmp_path / "raw.txt"
    log.write_text(text)
    return log


def test_listed_joints_are_tracked_and_all_others_lost(tmp_path):
    log = _write(tmp_path, TAKE)
    assert kinect_v2_sparse.matches(log.read_bytes())
    [clip] = kinect_v2_sparse.read(log, ReadOptions())
    assert (clip.format, clip.user, clip.notes) == ("kinect_v2_sparse", 0, ())
    assert clip.times.tolist() == [1.0, 1.032, 1.064]
    known = [{JOINTS[j]: clip.positions[t, j].tolist() for j in np.flatnonzero(clip.confidence[t])} for t in range(3)]
    assert known == [
        {"head": [0.25, 0.5, 2.0], "shoulder_center": [0.125, 0.25, 2.5]},
        {},
        {"hand_right": [-0.5, 1.0, 2.0]},
    ]
    assert set(np.unique(clip.confidence)) == {0.0, 1.0}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("1032\n", "1032 5\n", r"line 10: found 2 columns; expected 1 columns \(milliseconds\)"),
        ("Pos 1\n", "Position 1\n", "line 14: found “Position 1”; expected “Pos n” and n lines"),
        ("Pos 1\n", "Pos 26\n", "line 14: found “Pos 26”; expected “Pos n” and n lines, n at most 25"),
        ("Rot 3\n", "Rot 2\n", "line 9: found 5 columns; expected 1 columns"),
        ("20 0.125 0.25 2.5\n", "", "line 5: found 2 columns; expected 4 columns"),
        ("0.125", "inf", "line 4: found 'inf' in column 2; expected a finite number"),
        ("22 9 9 9", "25 9 9 9", "line 5: found joint 25; expected joints from 0 to 24, each once"),
        ("22 9 9 9", "3 9 9 9", "line 5: found joint 3; expected joints from 0 to 24, each once"),
        ("22 9 9 9", "2.5 9 9 9", "line 5: found joint 2.5; expected joints"),
        ("22 0 0 0 0", "22 0 0 x 0", "line 9: found 'x' in column 4"),
    ],
)
def test_a_line_that_does_not_fit_is_refused(tmp_path, old, new, message):
    with pytest.raises(SkeletonLogError, match=message):
        kinect_v2_sparse.read(_write(tmp_path, TAKE.replace(old, new, 1)), ReadOptions())


def test_a_file_cut_off_anywhere_is_read_up_to_the_last_complete_frame(tmp_path):
    lines = {0: 1, TAKE.index("1032"): 10, TAKE.index("1064"): 13}  # where frames begin
    [whole] = kinect_v2_sparse.read(_write(tmp_path, TAKE), ReadOptions())
    ends = [*lines, len(TAKE)][1:]
    for length in range(1, len(TAKE) + 1):
        log = _write(tmp_path, TAKE[:length])
        frames = sum(length >= end - 1 for end in ends)  # of the last one, the newline may be missing
        begun = max(start for start in lines if start < length)
        is_whole = length in ends or length + 1 in ends
        if frames:
            [clip] = kinect_v2_sparse.read(log, ReadOptions())
            note = (
                f"The file ends in the middle of the frame that begins in line {lines[begun]}. This frame is omitted."
            )
            assert clip.notes == (() if is_whole else (note,)), length
            np.testing.assert_array_equal(clip.times, whole.times[:frames])
            np.testing.assert_array_equal(clip.positions, whole.positions[:frames])
        else:
            with pytest.raises(SkeletonLogError, match=r"The file seems incomplete. Delete .*, or record again\."):
                kinect_v2_sparse.read(log, ReadOptions())


def test_rotations_which_are_not_used_may_be_anything(tmp_path, assert_same_frames):
    [whole] = kinect_v2_sparse.read(_write(tmp_path, TAKE), ReadOptions())
    [clip] = kinect_v2_sparse.read(_write(tmp_path, TAKE.replace("22 0 0 0 0", "22 nan -inf 0 0")), ReadOptions())
    assert_same_frames(clip, whole)
    assert clip.notes == ()


def test_a_log_without_a_tracked_frame_is_refused(tmp_path):
    with pytest.raises(SkeletonLogError, match="no tracked performer in any of 2 frames"):
        kinect_v2_sparse.read(_write(tmp_path, "1\nPos 0\nRot 0\n2\nPos 0\nRot 0\n"), ReadOptions())


@pytest.mark.parametrize("text", ["", "1000\n", "Pos 3\n", "1000\nRot 3\n1", "x\n1000\nPos 3\n"])
def test_other_texts_do_not_match(text):
    assert not kinect_v2_sparse.matches(text.encode())


def test_windows_newlines_and_a_byte_order_mark_do_not_matter(tmp_path):
    log = tmp_path / "raw.txt"
    log.write_bytes(b"\xef\xbb\xbf" + TAKE.replace("\n", "\r\n").encode())
    assert kinect_v2_sparse.matches(log.read_bytes())
    [clip] = kinect_v2_sparse.read(log, ReadOptions())
    assert clip.times.tolist() == [1.0, 1.032, 1.064]


def test_a_real_recording_has_the_frames_and_numbers_of_its_file(real_logs):
    [clip] = kinect_v2_sparse.read(real_logs / "kinect_v2_sparse" / "rawtest.txt", ReadOptions())
    assert clip.tracked_frames == len(clip.times) == 219
    assert clip.times[[6, 199, 218]].tolist() == [3178.921, 3185.359, 3185.984]
    assert np.diff(clip.times).max() == pytest.approx(0.047)
    assert clip.positions[6, JOINT_INDEX["head"]].tolist() == [0.08147, 0.069205, 1.395525]
    lost = {JOINTS[j] for j in np.flatnonzero(clip.confidence[199] == 0)}
    limbs = {"shoulder", "wrist", "hand", "ankle", "foot"}
    assert lost == {"head", "knee_left"} | {f"{part}_{side}" for part in limbs for side in ("left", "right")}
    assert clip.positions[199, JOINT_INDEX["shoulder_center"]].tolist() == [0.024197, -0.171864, 0.756334]
