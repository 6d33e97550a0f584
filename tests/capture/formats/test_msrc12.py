import numpy as np
import pytest

from capture.formats import msrc12
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

POSE = np.arange(1, 61).reshape(20, 3) / 16


def _line(microseconds, joints=POSE, flags=1):
    values = np.column_stack([joints, np.broadcast_to(flags, 20)])
    return f"{microseconds} " + " ".join(f"{value:.6f}" for value in values.ravel())


def _write(tmp_path, *lines, end="\n"):
    log = tmp_path / "P1_1_1_p01.csv"
    log.write_text("\n".join(lines) + end)
    return log


def test_microseconds_positions_and_flags_are_read(tmp_path):
    flags = np.ones(20)
    flags[11] = 0.0
    log = _write(tmp_path, _line(0, 0 * POSE, 0), _line(1_500_000), _line(2_000_000, flags=flags))
    assert msrc12.matches(log.read_bytes())
    [clip] = msrc12.read(log, ReadOptions())
    assert (clip.format, clip.user, clip.notes) == ("msrc12", 0, ())
    assert clip.times.tolist() == [0.0, 1.5, 2.0]
    assert np.isnan(clip.positions[0]).all()
    assert np.array_equal(clip.positions[1:], [POSE, POSE])
    assert clip.confidence.tolist() == [[0.0] * 20, [1.0] * 20, [1.0] * 11 + [0.5] + [1.0] * 8]


def test_an_unknown_flag_is_refused(tmp_path):
    with pytest.raises(SkeletonLogError, match="line 2: found the joint state 7; expected a state from 0 to 1"):
        msrc12.read(_write(tmp_path, _line(1), _line(2, flags=7)), ReadOptions())


@pytest.mark.parametrize(
    ("name", "frames", "gap"), [("P1_1_1_p06.csv", 1027, 2.033563), ("P1_1_1_p19.csv", 1320, 0.077)]
)
def test_real_logs_have_their_frames_and_gaps(real_logs, name, frames, gap):
    [clip] = msrc12.read(real_logs / "msrc12" / name, ReadOptions())
    assert (len(clip.times), clip.tracked_frames) == (frames, frames - 20)
    assert np.diff(clip.times).max() == pytest.approx(gap, abs=5e-4)
    assert 1 / np.median(np.diff(clip.times)) == pytest.approx(30.2, abs=0.1)


def test_a_real_recording_has_the_numbers_of_its_file(real_logs):
    [clip] = msrc12.read(real_logs / "msrc12" / "P1_1_1_p06.csv", ReadOptions())
    assert clip.times[26] == 643.809794  # line 27
    assert clip.positions[26, JOINT_INDEX["head"]].tolist() == [0.06953, 0.725342, 2.678191]
    assert clip.positions[26, JOINT_INDEX["hand_right"]].tolist() == [0.254431, -0.085197, 2.680496]
    assert np.flatnonzero((clip.confidence == 0).all(axis=1)).tolist() == list(range(20))
