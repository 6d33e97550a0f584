from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from capture.formats import utd_mhad
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

from .conftest import assert_refused

ORDER = ("head", "shoulder_center", "spine", "hip_center", "shoulder_left", "elbow_left", "wrist_left", "hand_left",
         "shoulder_right", "elbow_right", "wrist_right", "hand_right", "hip_left", "knee_left", "ankle_left",
         "foot_left", "hip_right", "knee_right", "ankle_right", "foot_right")  # fmt: skip


def numbered(frames: int) -> np.ndarray:
    """x tells the joint, y the frame, z is 2."""
    joints = np.empty((20, 3, frames))
    joints[:, 0] = (np.arange(20) + 1)[:, None] / 100
    joints[:, 1] = np.arange(frames) / 10
    joints[:, 2] = 2
    return joints


def write(folder: Path, **variables: object) -> Path:
    path = folder / "take.mat"
    savemat(path, variables, do_compression=True)
    return path


@pytest.mark.parametrize("compressed", [True, False])
def test_joints_are_matched_by_name(tmp_path: Path, compressed: bool) -> None:
    path = tmp_path / "take.mat"
    savemat(path, {"d_skel": numbered(3)}, do_compression=compressed)
    assert utd_mhad.matches(path.read_bytes())
    (clip,) = utd_mhad.read(path, ReadOptions())
    assert clip.times.tolist() == [0, 1 / 30, 2 / 30]
    for index, name in enumerate(ORDER):
        expected = [[(index + 1) / 100, frame / 10, 2] for frame in range(3)]
        np.testing.assert_array_equal(clip.positions[:, JOINT_INDEX[name]], expected)
    assert (clip.confidence == 1).all()


def test_frame_rate_can_be_given(tmp_path: Path) -> None:
    (clip,) = utd_mhad.read(write(tmp_path, d_skel=numbered(3)), ReadOptions(fps=20))
    assert clip.times.tolist() == [0, 0.05, 0.1]


def with_value(value: float) -> np.ndarray:
    joints = numbered(5)
    joints[7, 1, 4] = value
    return joints


@pytest.mark.parametrize(
    ("variables", "place", "message"),
    [
        ({"d_depth": np.ones((24, 32, 4))}, "take.mat", "a depth recording (d_depth)"),
        ({"d_depth": np.ones((24, 32, 4))}, "take.mat", "_skeleton.mat"),
        ({"d_iner": np.ones((100, 6))}, "take.mat", "the variables ['d_iner']; expected d_skel"),
        ({"d_skel": np.ones((20, 4))}, "d_skel", "20 × 4 of other content; expected real numbers, 20 × 3 × frames"),
        ({"d_skel": np.ones((25, 3, 9))}, "d_skel", "25 × 3 × 9"),
        ({"d_skel": np.ones((20, 3, 2, 2))}, "d_skel", "20 × 3 × 2 × 2"),
        ({"d_skel": np.ones((20, 3, 0))}, "take.mat", "no tracked performer in any of 0 frames"),
        ({"d_skel": np.ones((20, 3, 2), complex)}, "d_skel", "20 × 3 × 2 of other content"),
        ({"d_skel": "text"}, "d_skel", "of other content"),
        ({"d_skel": with_value(np.nan)}, "d_skel(8,2,5)", "found nan"),
        ({"d_skel": with_value(np.inf)}, "d_skel(8,2,5)", "found inf"),
        ({"d_skel": np.zeros((20, 3, 4))}, "take.mat", "no tracked performer in any of 4 frames"),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(
    tmp_path: Path, variables: dict[str, object], place: str, message: str
) -> None:
    assert_refused(utd_mhad, write(tmp_path, **variables), place, message)


@pytest.mark.parametrize("kept", [0, 60, 128, 140, 200, 400])
def test_a_file_cut_anywhere_is_refused(tmp_path: Path, kept: int) -> None:
    path = write(tmp_path, d_skel=numbered(40))
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(SkeletonLogError, match="expected"):
        utd_mhad.read(path, ReadOptions())


def test_a_claimed_number_of_frames_allocates_nothing(tmp_path: Path) -> None:
    path = tmp_path / "take.mat"
    savemat(path, {"d_skel": numbered(7)}, do_compression=False)
    dimensions = np.array([20, 3, 7], "<i4").tobytes()
    path.write_bytes(path.read_bytes().replace(dimensions, np.array([20, 3, 30_000_000], "<i4").tobytes()))
    with pytest.raises(SkeletonLogError, match="20 × 3 × 30000000 is incomplete"):
        utd_mhad.read(path, ReadOptions())


def test_the_first_frame_of_a_real_file_equals_known_values(real_logs: Path) -> None:
    path = real_logs / "utd_mhad_mat" / "a1_s1_t1_skeleton.mat"
    (clip,) = utd_mhad.read(path, ReadOptions())
    assert clip.positions.shape == (48, 20, 3)
    head, hand_right = clip.positions[0, JOINT_INDEX["head"]], clip.positions[0, JOINT_INDEX["hand_right"]]
    np.testing.assert_allclose(head, [-0.04576265, 0.48398542, 2.83018947], atol=1e-8)
    np.testing.assert_allclose(hand_right, [0.21803801, -0.36832255, 2.80132985], atol=1e-8)


def test_all_real_takes(real_logs: Path) -> None:
    takes = sorted((real_logs / "utd_mhad_mat").glob("*.mat"))
    clips = [clip for take in takes for clip in utd_mhad.read(take, ReadOptions())]
    assert len(clips) == 54
    assert sum(len(clip.times) for clip in clips) == 3509
    assert all((clip.confidence == 1).all() for clip in clips)
    right, left = JOINT_INDEX["shoulder_right"], JOINT_INDEX["shoulder_left"]
    assert all(np.median(clip.positions[:, right, 0] - clip.positions[:, left, 0]) > 0.2 for clip in clips)


def test_real_depth_recordings_are_named_as_such(real_logs: Path) -> None:
    for path in (real_logs / "utd_mhad_mat" / "depth").glob("*.mat"):
        with pytest.raises(SkeletonLogError, match="depth recording"):
            utd_mhad.read(path, ReadOptions())


def test_recognises_no_other_version_of_matlab_files() -> None:
    assert not utd_mhad.matches(b"MATLAB 7.3 MAT-file".ljust(126) + b"IM")
