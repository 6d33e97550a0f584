import numpy as np
import pytest

from capture.formats import FARTHEST, FORMATS, read_log, recognize
from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from puppetline.errors import SkeletonLogError


def record(path, positions):
    with Recorder(path) as recorder:
        for index, pose in enumerate(positions):
            recorder.write(SkeletonFrame(index / 30, 1, pose, np.ones(20, np.float32)))
    return path


def test_a_log_is_found_by_content_and_not_by_its_name(tmp_path):
    poses = np.random.default_rng(0).normal(size=(3, 20, 3)).round(5)
    (clip,) = read_log(record(tmp_path / "take.bvh", poses))
    np.testing.assert_array_equal(clip.positions, poses)


def test_a_position_that_is_no_performers_is_refused_with_its_place(tmp_path):
    poses = np.zeros((3, 20, 3))
    poses[2, 3, 1] = 10 * FARTHEST
    with pytest.raises(SkeletonLogError) as error:
        read_log(record(tmp_path / "take.log", poses))
    assert error.value.where.endswith("frame 2 (second 0.0666667), head")
    assert error.value.found == "1e+04 m"


@pytest.mark.parametrize(("content", "found"), [(b"", "an empty file"), (bytes(range(256)) * 9, "no skeleton log")])
def test_what_is_no_log_is_refused_with_the_list_of_formats(tmp_path, content, found):
    (tmp_path / "take.log").write_bytes(content)
    with pytest.raises(SkeletonLogError) as error:
        read_log(tmp_path / "take.log")
    assert error.value.found.startswith(found)
    assert all(name in error.value.expected for name in FORMATS.values())


def test_every_real_log_is_one_of_the_formats(real_data):
    files = [path for kind in ("logs", "bvh") for path in (real_data / kind).rglob("*.*") if path.is_file()]
    strangers = [path.name for path in files if recognize(path) is None]
    assert len(files) > 150
    assert strangers == ["actionLabel.txt"] * strangers.count("actionLabel.txt")
