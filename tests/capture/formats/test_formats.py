from importlib import import_module

import numpy as np
import pytest

from capture.formats import FORMATS, HEAD_BYTES, read_log
from capture.skeleton import MAX_DISTANCE_METRES, SkeletonFrame
from puppetline.errors import SkeletonLogError

from ...recordings import record

FORMAT_OF_FOLDER = {
    "bvh": "bvh",
    "kinect_own_recording": "utkinect",
    "kinect_v2_json": "kinect_v2_json",
    "kinect_v2_laban_csv": "kinect_v2_csv",
    "kinect_v2_sparse": "kinect_v2_sparse",
    "msr_action3d_screen": "msr_action3d",
    "msr_action3d_world": "msr_action3d",
    "msrc12": "msrc12",
    "utd_mhad_mat": "utd_mhad",
    "depth": "utd_mhad",
    "utkinect": "utkinect",
}


def recorded(path, positions):
    ones = np.ones(20, np.float32)
    return record(path, [SkeletonFrame(index / 30, 1, pose, ones) for index, pose in enumerate(positions)])


def test_a_log_is_found_by_content_and_not_by_its_name(tmp_path):
    poses = np.random.default_rng(0).normal(size=(3, 20, 3)).round(5)
    (clip,) = read_log(recorded(tmp_path / "take.bvh", poses))
    np.testing.assert_array_equal(clip.positions, poses)


def test_a_position_out_of_range_is_refused_with_its_place(tmp_path):
    poses = np.zeros((3, 20, 3))
    poses[2, 3, 1] = 10 * MAX_DISTANCE_METRES
    with pytest.raises(SkeletonLogError) as error:
        read_log(recorded(tmp_path / "take.log", poses))
    assert error.value.where.endswith("frame 2 (second 0.0666667), head")
    assert error.value.found == "1e+04 m"


@pytest.mark.parametrize(
    ("content", "found"), [(b"", "an empty file"), (bytes(range(256)) * 9, "an unknown file format")]
)
def test_an_unknown_format_is_refused_with_the_list_of_formats(tmp_path, content, found):
    (tmp_path / "take.log").write_bytes(content)
    with pytest.raises(SkeletonLogError) as error:
        read_log(tmp_path / "take.log")
    assert error.value.found.startswith(found)
    assert all(name in error.value.expected for name in FORMATS.values())


@pytest.mark.parametrize("name", FORMATS)
def test_a_format_matches_its_own_real_files_and_no_other_file(real_data, name):
    files = {path for folder in ("logs", "bvh", "video") for path in (real_data / folder).rglob("*") if path.is_file()}
    files.discard(real_data / "logs" / "utkinect" / "actionLabel.txt")
    own = {path for path in files if FORMAT_OF_FOLDER.get(path.relative_to(real_data).parts[-2]) == name}
    matches = import_module(f"capture.formats.{name}").matches
    assert len(files) > 150
    assert {path for path in files if matches(path.open("rb").read(HEAD_BYTES))} == own
