import numpy as np
import pytest

from capture.formats import utkinect
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX


def _line(number, joints=None):
    joints = np.arange(1, 61).reshape(20, 3) / 16 if joints is None else joints
    return f"{number}   " + "  ".join(f"{value:.6f}" for value in np.ravel(joints))


def _write(tmp_path, *lines, end="\n"):
    log = tmp_path / "joints.txt"
    log.write_text("\n".join(lines) + end)
    return log


def test_joints_come_in_file_order_and_frame_numbers_are_thirtieths_of_a_second(tmp_path):
    log = _write(tmp_path, _line(60), _line(62), _line(120))
    assert utkinect.matches(log.read_bytes())
    [clip] = utkinect.read(log, ReadOptions())
    assert (clip.format, clip.user) == ("utkinect", 0)
    assert clip.times.tolist() == [2.0, 62 / 30, 4.0]
    assert np.array_equal(clip.positions, np.tile(np.arange(1, 61).reshape(20, 3) / 16, (3, 1, 1)))
    assert np.array_equal(clip.confidence, np.ones((3, 20)))
    assert clip.notes == ("The recording has no clock; 30 frames per second are assumed.",)


def test_the_options_set_the_rate(tmp_path):
    [clip] = utkinect.read(_write(tmp_path, _line(50), _line(75)), ReadOptions(fps=25.0))
    assert clip.times.tolist() == [2.0, 3.0]
    assert clip.notes == ()


def test_repeated_frames_are_skipped_and_a_joint_at_zero_is_lost(tmp_path):
    lost = np.ones((20, 3))
    lost[2] = 0.0
    log = _write(tmp_path, _line(1, np.full((20, 3), 1.0)), _line(1, np.full((20, 3), 2.0)), _line(2, lost))
    [clip] = utkinect.read(log, ReadOptions())
    assert clip.positions[0, 0].tolist() == [1.0, 1.0, 1.0]
    assert clip.confidence[1].tolist() == [1.0, 1.0, 0.0] + [1.0] * 17
    assert clip.notes[-1] == "Skipped 1 of 3 frames that repeat or precede an earlier time."


@pytest.mark.parametrize(
    ("name", "frames", "repeats"),
    [
        ("joints_s01_e01.txt", 545, 15),
        ("joints_s02_e01.txt", 587, 10),
        ("joints_s03_e01.txt", 742, 21),
        ("joints_s04_e02.txt", 1271, 89),
        ("joints_s09_e01.txt", 1244, 145),
    ],
)
def test_real_logs_have_their_frames_without_the_repeats(real_logs, name, frames, repeats):
    [clip] = utkinect.read(real_logs / "utkinect" / name, ReadOptions())
    assert clip.tracked_frames == len(clip.times) == frames
    assert clip.notes[1].startswith(f"Skipped {repeats} of {frames + repeats} frames")


def test_a_real_recording_has_the_numbers_of_its_file(real_logs):
    [clip] = utkinect.read(real_logs / "utkinect" / "joints_s09_e01.txt", ReadOptions())
    # Lines 1 to 7 have frames 32 34 34 38 40 42 44.
    assert clip.times[:6] * 30 == pytest.approx([32, 34, 38, 40, 42, 44])
    assert clip.positions[5, JOINT_INDEX["head"]].tolist() == [0.338894, 0.781109, 2.680387]
    assert np.diff(clip.times).max() == pytest.approx(298 / 30)


def test_a_real_recording_loses_the_joints_that_are_zero(real_logs):
    [clip] = utkinect.read(real_logs / "kinect_own_recording" / "joints_s01_e01.txt", ReadOptions())
    assert len(clip.times) == 3000
    lines = np.flatnonzero((clip.confidence == 0).any(axis=1))
    several = {2186: [2, 8], 2187: [2, 3, 8], 2188: [2, 3, 8]}
    shoulder_centre = {line: [2] for line in (*range(2669, 2675), 2676, 2678)}
    lost = {line + 1: np.flatnonzero(clip.confidence[line] == 0).tolist() for line in lines}
    assert lost == several | shoulder_centre
    assert np.diff(clip.times).max() == pytest.approx(59 / 30)
