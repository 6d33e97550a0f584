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
22 nan -inf 0 0
1032
Pos 0
Rot 0
1064
Pos 1
11 -0.5 1 2
Rot 1
11 0 0 0 1
"""


@pytest.mark.parametrize("text", [TAKE, "\ufeff" + TAKE.replace("\n", "\r\n")])
def test_listed_joints_are_tracked_and_all_others_lost(read, text):
    assert kinect_v2_sparse.matches(text.encode())
    [clip] = read(kinect_v2_sparse, text)
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
    ("old", "new", "place"),
    [
        ("1032\n", "1032 5\n", "line 10"),
        ("Pos 1\n", "Position 1\n", "line 14"),
        ("Pos 1\n", "Pos 26\n", "line 14"),
        ("Rot 3\n", "Rot 2\n", "line 9"),
        ("20 0.125 0.25 2.5\n", "", "line 5"),
        ("0.125", "inf", "line 4"),
        ("22 9 9 9", "25 9 9 9", "line 5"),
        ("22 9 9 9", "3 9 9 9", "line 5"),
        ("22 9 9 9", "2.5 9 9 9", "line 5"),
        ("22 nan -inf 0 0", "22 0 0 x 0", "line 9"),
        (TAKE, "1\nPos 0\nRot 0\n2\nPos 0\nRot 0\n", ""),
    ],
)
def test_a_line_that_does_not_fit_is_refused(refused_at, old, new, place):
    assert refused_at(kinect_v2_sparse, TAKE.replace(old, new, 1)) == place


def test_a_file_cut_off_anywhere_is_read_up_to_the_last_complete_frame(read, assert_same_frames):
    ends = {TAKE.index("1032"): 1, TAKE.index("1064"): 10, len(TAKE): 13}  # of frames, which begin in these lines
    wholes = [read(kinect_v2_sparse, TAKE[:end])[0] for end in ends]
    for length in range(1, len(TAKE) + 1):
        frames = sum(length >= end - 1 for end in ends)  # of the last one, the newline may be missing
        if not frames:
            with pytest.raises(SkeletonLogError):
                read(kinect_v2_sparse, TAKE[:length])
            continue
        [clip] = read(kinect_v2_sparse, TAKE[:length])
        assert_same_frames(clip, wholes[frames - 1])
        begun = next(line for end, line in ends.items() if length <= end)
        is_whole = length in ends or length + 1 in ends
        assert [f"line {begun}." in note for note in clip.notes] == [True] * (not is_whole), length


@pytest.mark.parametrize("text", ["", "1000\n", "Pos 3\n", "1000\nRot 3\n1", "x\n1000\nPos 3\n"])
def test_other_texts_do_not_match(text):
    assert not kinect_v2_sparse.matches(text.encode())


def test_a_real_recording_has_the_frames_and_numbers_of_its_file(real_logs):
    [clip] = kinect_v2_sparse.read(real_logs / "kinect_v2_sparse" / "rawtest.txt", ReadOptions())
    assert clip.tracked_frames == len(clip.times) == 219
    assert clip.times[[6, 199, 218]].tolist() == [3178.921, 3185.359, 3185.984]
    assert clip.positions[6, JOINT_INDEX["head"]].tolist() == [0.08147, 0.069205, 1.395525]
    lost = {JOINTS[j] for j in np.flatnonzero(clip.confidence[199] == 0)}
    limbs = {"shoulder", "wrist", "hand", "ankle", "foot"}
    assert lost == {"head", "knee_left"} | {f"{part}_{side}" for part in limbs for side in ("left", "right")}
