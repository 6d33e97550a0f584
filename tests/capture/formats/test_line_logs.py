"""Common properties of the readers of text recordings: incomplete files, invalid lines, and all real recordings."""

import importlib

import numpy as np
import pytest

from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

FOLDERS = {
    "utkinect": ["utkinect", "kinect_own_recording"],
    "msrc12": ["msrc12"],
    "msr_action3d": ["msr_action3d_world", "msr_action3d_screen"],
    "kinect_v2_csv": ["kinect_v2_laban_csv"],
    "kinect_v2_sparse": ["kinect_v2_sparse"],
}
METRES = {
    ("shoulder_left", "shoulder_right"): (0.25, 0.45),
    ("shoulder_center", "head"): (0.12, 0.3),
    ("shoulder_left", "elbow_left"): (0.18, 0.36),
    ("shoulder_right", "elbow_right"): (0.18, 0.36),
    ("elbow_left", "wrist_left"): (0.18, 0.34),
    ("elbow_right", "wrist_right"): (0.18, 0.34),
    ("hip_left", "knee_left"): (0.27, 0.65),
    ("hip_right", "knee_right"): (0.27, 0.65),
    ("knee_right", "ankle_right"): (0.25, 0.5),
}

FRAMES = {
    "cad60": (",", (["0.5"] * 10 + ["250", "500", "2000", "1"]) * 11 + ["250", "500", "2000", "1"] * 4, "frame number"),
    "kinect_v2_csv": (",", ["0.25", "0.5", "2", "2"] * 25, "100 ns ticks"),
    "msrc12": (" ", ["0.25", "0.5", "2", "1"] * 20, "microseconds"),
    "utkinect": (" ", ["0.25", "0.5", "2"] * 20, "frame number"),
}
"""For each format with one frame per line: the separator, the columns after the time, and the meaning of the time."""


def _module(name):
    return importlib.import_module(f"capture.formats.{name}")


@pytest.fixture(params=FRAMES)
def line_log(request, tmp_path):
    """Functions that return a line of a format with one frame per line, and that write lines to a file and read it."""
    separator, columns, _ = FRAMES[request.param]

    def line(time, columns=columns):
        return separator.join([str(time), *columns])

    def read_lines(*lines, end="\n"):
        log = tmp_path / "log"
        log.write_text("\n".join(lines) + end)
        return _module(request.param).read(log, ReadOptions())

    return line, read_lines


@pytest.mark.parametrize("torn", [slice(70), slice(0)])
def test_a_recording_cut_off_within_a_line_is_read_up_to_the_last_complete_line(line_log, assert_same_frames, torn):
    line, read = line_log
    [whole] = read(line(1), line(4))
    [clip] = read(line(1), line(4), line(2)[torn] or "-", end="")
    note = "The file ends in the middle of line 3. This frame is omitted."
    assert [text for text in clip.notes if text not in whole.notes] == [note]
    assert_same_frames(clip, whole)


def test_a_short_line_before_the_end_is_refused(line_log):
    line, read = line_log
    for lines, end in (([line(2)[:70]], "\n"), ([line(2)[:70], line(3)], "")):
        with pytest.raises(SkeletonLogError, match=r"line 2: found \d+ columns"):
            read(line(1), *lines, end=end)


def test_a_recording_cut_off_within_its_only_line_is_refused(line_log):
    line, read = line_log
    with pytest.raises(SkeletonLogError, match=r"line 1: found the end of the file after \d+ columns"):
        read(line(1)[:70], end="")


@pytest.mark.parametrize("name", FRAMES)
def test_a_file_matches_by_the_separator_and_number_of_columns(name):
    separator, columns, _ = FRAMES[name]
    matches, other = _module(name).matches, " " if separator == "," else ","
    assert matches(separator.join(["1", *columns]).encode())
    for texts in ([], ["1", *columns[1:]], ["1", "1", *columns], ["x", *columns]):
        assert not matches(separator.join(texts).encode())
    assert not matches(other.join(["1", *columns]).encode())


@pytest.mark.parametrize("time", ["nan", "inf"])
def test_a_time_that_is_not_finite_is_refused(line_log, time):
    line, read = line_log
    with pytest.raises(SkeletonLogError, match=f"line 2: found '{time}' in column 1; expected a finite number"):
        read(line(1), line(time))


@pytest.mark.parametrize("name", FRAMES)
def test_a_line_with_another_number_of_columns_is_refused_with_their_meaning(name, tmp_path):
    separator, columns, meaning = FRAMES[name]
    count = len(columns) + 1
    (tmp_path / "log").write_text(separator.join(["1", *columns, "1"]) + "\n")
    message = rf"line 1: found {count + 1} columns; expected {count} columns \({meaning}"
    with pytest.raises(SkeletonLogError, match=message):
        _module(name).read(tmp_path / "log", ReadOptions())


def test_a_recording_without_a_tracked_frame_is_refused(line_log):
    line, read = line_log
    columns = ["0"] * (len(line(1).replace(",", " ").split()) - 1)
    with pytest.raises(SkeletonLogError, match="no tracked performer in any of 2 frames"):
        read(line(1, columns), line(2, columns))


@pytest.mark.parametrize(
    ("name", "folder"), [(name, folder) for name, folders in FOLDERS.items() for folder in folders]
)
def test_real_performers_have_human_bones_and_their_right_side_at_positive_x(real_logs, name, folder):
    for log in set((real_logs / folder).iterdir()) - {real_logs / "utkinect" / "actionLabel.txt"}:
        [clip] = _module(name).read(log, ReadOptions())
        for (start, end), (shortest, longest) in METRES.items():
            bone = clip.positions[:, JOINT_INDEX[end]] - clip.positions[:, JOINT_INDEX[start]]
            assert shortest < np.nanmedian(np.linalg.norm(bone, axis=1)) < longest, (log.name, start, end)
        for part in ("shoulder", "hip"):
            right, left = JOINT_INDEX[f"{part}_right"], JOINT_INDEX[f"{part}_left"]
            assert np.nanmedian(clip.positions[:, right, 0] - clip.positions[:, left, 0]) > 0, (log.name, part)
        height = clip.positions[:, JOINT_INDEX["head"], 1] - clip.positions[:, JOINT_INDEX["hip_center"], 1]
        assert 0.3 < np.nanmedian(height) < 1.0, log.name
