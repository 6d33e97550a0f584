import numpy as np
import pytest

from capture.formats import kinect_v2_csv
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

POSE = np.arange(1, 76).reshape(25, 3) / 16


def _line(ticks, states=2, end=","):
    values = np.column_stack([POSE, np.broadcast_to(states, 25)])
    return ",".join([str(ticks), *(f"{value:g}" for value in values.ravel())]) + end


def _write(tmp_path, *lines, end="\n"):
    log = tmp_path / "joints.csv"
    log.write_text("\n".join(lines) + end)
    return log


@pytest.mark.parametrize("comma", [",", ""])
def test_ticks_positions_and_states_are_read(tmp_path, comma):
    states = np.full(25, 2)
    states[[3, 20]] = 0, 1
    log = _write(tmp_path, _line(10_000_000, end=comma), _line(15_000_000, states, end=comma))
    assert kinect_v2_csv.matches(log.read_bytes())
    [clip] = kinect_v2_csv.read(log, ReadOptions())
    assert (clip.format, clip.user, clip.notes) == ("kinect_v2_csv", 0, ())
    assert clip.times.tolist() == [1.0, 1.5]
    assert np.array_equal(clip.positions[0], POSE[[0, 1, 20, *range(3, 20)]])
    assert clip.confidence[0].tolist() == [1.0] * 20
    assert clip.confidence[1].tolist() == [1.0, 1.0, 0.5, 0.0] + [1.0] * 16
    assert np.isnan(clip.positions[1, 3]).all()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (_line(2).replace(",2,", ",,", 1), "line 2: found '' in column 5"),
        (_line(2, 3), "line 2: found the joint state 3; expected a state from 0 to 2"),
    ],
)
def test_a_line_that_does_not_fit_is_refused(tmp_path, line, message):
    with pytest.raises(SkeletonLogError, match=message):
        kinect_v2_csv.read(_write(tmp_path, _line(1), line), ReadOptions())


@pytest.mark.parametrize(
    ("name", "frames", "gap"),
    [
        ("Ges01_wavehand.csv", 154, 0.067),
        ("Ges02_balancinghands.csv", 161, 0.067),
        ("Ges03_drawlines.csv", 213, 0.067),
        ("KinectReader_joints.csv", 371, 0.066),
    ],
)
def test_real_logs_have_their_frames(real_logs, name, frames, gap):
    [clip] = kinect_v2_csv.read(real_logs / "kinect_v2_laban_csv" / name, ReadOptions())
    assert clip.tracked_frames == len(clip.times) == frames
    assert np.diff(clip.times).max() == pytest.approx(gap, abs=1e-3)
    assert 1 / np.median(np.diff(clip.times)) == pytest.approx(30.3, abs=0.4)
    assert clip.notes == ()


def test_a_real_recording_has_the_numbers_of_its_file(real_logs):
    [clip] = kinect_v2_csv.read(real_logs / "kinect_v2_laban_csv" / "KinectReader_joints.csv", ReadOptions())
    assert clip.times[6] == 3186.9373727  # line 7
    assert clip.positions[6, JOINT_INDEX["head"]].tolist() == [0.00709107, 0.182194, 0.987473]
    assert clip.positions[6, JOINT_INDEX["hand_right"]].tolist() == [0.268829, -0.549694, 1.01212]
    assert clip.positions[6, JOINT_INDEX["shoulder_center"]].tolist() == [0.0100643, -0.0418049, 1.03005]
    assert [clip.confidence[6, JOINT_INDEX[name]] for name in ("head", "hand_right")] == [1.0, 0.5]
