import numpy as np
import pytest
from scipy.io import savemat

from capture.formats import utd_mhad
from capture.formats.layouts import UTD_MHAD
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX


def numbered(frames, changed=None):
    """x tells the joint, y the frame, z is 2; the y of joint 7 in frame 4 may be another number."""
    joints = np.empty((20, 3, frames))
    joints[:, 0] = (np.arange(20) + 1)[:, None] / 100
    joints[:, 1] = np.arange(frames) / 10
    joints[:, 2] = 2
    if changed is not None:
        joints[7, 1, 4] = changed
    return joints


@pytest.fixture
def matlab(tmp_path):
    """Return the bytes of a MATLAB file with variables."""

    def written(compress=True, **variables):
        savemat(tmp_path / "take.mat", variables, do_compression=compress)
        return (tmp_path / "take.mat").read_bytes()

    return written


@pytest.mark.parametrize("compressed", [True, False])
def test_joints_are_matched_by_name(read, matlab, compressed):
    content = matlab(compressed, d_skel=numbered(3))
    assert utd_mhad.matches(content)
    [clip], [given] = read(utd_mhad, content), read(utd_mhad, content, fps=20)
    assert clip.times.tolist() == [0, 1 / 30, 2 / 30]
    assert given.times.tolist() == [0, 0.05, 0.1]
    order = [JOINT_INDEX[name] for name in UTD_MHAD]
    np.testing.assert_array_equal(clip.positions[:, order], numbered(3).transpose(2, 0, 1))
    assert (clip.confidence == 1).all()


@pytest.mark.parametrize(
    ("variables", "place"),
    [
        ({"d_depth": np.ones((24, 32, 4))}, ""),
        ({"d_iner": np.ones((100, 6))}, ""),
        ({"d_skel": np.ones((20, 4))}, "d_skel"),
        ({"d_skel": np.ones((25, 3, 9))}, "d_skel"),
        ({"d_skel": np.ones((20, 3, 2, 2))}, "d_skel"),
        ({"d_skel": np.ones((20, 3, 0))}, ""),
        ({"d_skel": np.ones((20, 3, 2), complex)}, "d_skel"),
        ({"d_skel": "text"}, "d_skel"),
        ({"d_skel": numbered(5, np.nan)}, "d_skel(8,2,5)"),
        ({"d_skel": numbered(5, np.inf)}, "d_skel(8,2,5)"),
        ({"d_skel": np.zeros((20, 3, 4))}, ""),
    ],
)
def test_violations_of_the_format_are_refused_with_their_place(refused_at, matlab, variables, place):
    assert refused_at(utd_mhad, matlab(**variables)) == place


@pytest.mark.parametrize("kept", [0, 60, 128, 140, 200, 400])
def test_a_file_cut_anywhere_is_refused(refused_at, matlab, kept):
    assert refused_at(utd_mhad, matlab(d_skel=numbered(40))[:kept]) == ""


def test_a_claimed_number_of_frames_allocates_nothing(refused_at, matlab):
    stated, claimed = (np.array([20, 3, frames], "<i4").tobytes() for frames in (7, 30_000_000))
    assert refused_at(utd_mhad, matlab(False, d_skel=numbered(7)).replace(stated, claimed)) == ""


def test_real_takes_have_the_numbers_of_their_files_and_the_right_side_at_positive_x(real_logs):
    clips = {}
    for take in (real_logs / "utd_mhad_mat").glob("*.mat"):
        [clips[take.name]] = utd_mhad.read(take, ReadOptions())
    assert (len(clips), sum(len(clip.times) for clip in clips.values())) == (54, 3509)
    right, left = JOINT_INDEX["shoulder_right"], JOINT_INDEX["shoulder_left"]
    for clip in clips.values():
        assert np.median(clip.positions[:, right, 0] - clip.positions[:, left, 0]) > 0.2
    known = clips["a1_s1_t1_skeleton.mat"].positions[0, [JOINT_INDEX["head"], JOINT_INDEX["hand_right"]]]
    expected = [[-0.04576265, 0.48398542, 2.83018947], [0.21803801, -0.36832255, 2.80132985]]
    np.testing.assert_allclose(known, expected, atol=1e-8)


def test_recognises_no_other_version_of_matlab_files():
    assert not utd_mhad.matches(b"MATLAB 7.3 MAT-file".ljust(126) + b"IM")
    assert not utd_mhad.matches(b"MATLAB 5.0 MAT-file".ljust(126) + b"XX")
