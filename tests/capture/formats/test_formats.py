import numpy as np
import pytest

from capture.formats import read_log, recognize
from capture.skeleton import MAX_DISTANCE_METRES
from puppetline.errors import SkeletonLogError

from ...recordings import record, tracked_frame

FORMAT_OF_FOLDER = {
    "bvh": "bvh",
    "tfjs": "landmarks_json",
    "kinect_own_recording": "table",
    "kinect_v2_json": "kinect_v2_json",
    "kinect_v2_laban_csv": "table",
    "kinect_v2_sparse": "kinect_v2_sparse",
    "msr_action3d_screen": "msr_action3d",
    "msr_action3d_world": "msr_action3d",
    "msrc12": "table",
    "utd_mhad_mat": "arrays",
    "depth": "arrays",
    "utkinect": "table",
}


def recorded(path, poses):
    return record(path, [tracked_frame(index / 30, pose) for index, pose in enumerate(poses)])


def test_a_log_is_found_by_content_and_a_position_out_of_range_refused_with_its_place(tmp_path):
    poses = np.random.default_rng(0).normal(size=(3, 20, 3)).round(5)
    (clip,) = read_log(recorded(tmp_path / "take.bvh", poses))
    np.testing.assert_array_equal(clip.positions, poses)
    poses[2, 3, 1] = MAX_DISTANCE_METRES
    read_log(recorded(tmp_path / "far", poses))
    poses[2, 3, 1] *= -10
    with pytest.raises(SkeletonLogError) as error:
        read_log(recorded(tmp_path / "take.log", poses))
    assert error.value.where.endswith("frame 2 (second 0.0666667), head")
    assert error.value.found == "-1e+04 m"


def test_each_real_file_is_recognised(real_data):
    files = {path for folder in ("logs", "bvh", "video") for path in (real_data / folder).rglob("*") if path.is_file()}
    files.discard(real_data / "logs" / "utkinect" / "actionLabel.txt")
    assert len(files) > 150
    for path in files:
        module = recognize(path)
        own = FORMAT_OF_FOLDER.get(path.parent.name) if path.suffix not in (".mp4", ".jpg") else None
        assert (module and module.__name__) == (own and f"capture.formats.{own}"), path
