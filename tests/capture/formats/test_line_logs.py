"""What holds for the readers of line and column logs together, on every real recording."""

import importlib

import numpy as np
import pytest

from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX

FOLDERS = {
    "utkinect": ["utkinect", "kinect_own_recording"],
    "msrc12": ["msrc12"],
    "msr_action3d": ["msr_action3d_world", "msr_action3d_screen"],
    "kinect_v2_csv": ["kinect_v2_laban_csv"],
    "kinect_v2_sparse": ["kinect_v2_sparse"],
    "cad60": [],
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


def _module(name):
    return importlib.import_module(f"capture.formats.{name}")


def _logs(folder):
    return {log for log in folder.iterdir() if log.name != "actionLabel.txt"}


@pytest.mark.parametrize("name", FOLDERS)
def test_a_format_matches_its_own_real_logs_and_no_other_file(real_data, name):
    files = [path for part in ("logs", "bvh") for path in (real_data / part).rglob("*") if path.is_file()]
    matched = {path for path in files if _module(name).matches(path.read_bytes()[: 64 * 1024])}
    assert matched == {log for folder in FOLDERS[name] for log in _logs(real_data / "logs" / folder)}


@pytest.mark.parametrize(
    ("name", "folder"), [(name, folder) for name, folders in FOLDERS.items() for folder in folders]
)
def test_real_performers_have_human_bones_and_their_right_side_at_positive_x(real_logs, name, folder):
    for log in _logs(real_logs / folder):
        [clip] = _module(name).read(log, ReadOptions())
        for (start, end), (shortest, longest) in METRES.items():
            bone = clip.positions[:, JOINT_INDEX[end]] - clip.positions[:, JOINT_INDEX[start]]
            assert shortest < np.nanmedian(np.linalg.norm(bone, axis=1)) < longest, (log.name, start, end)
        for part in ("shoulder", "hip"):
            right, left = JOINT_INDEX[f"{part}_right"], JOINT_INDEX[f"{part}_left"]
            assert np.nanmedian(clip.positions[:, right, 0] - clip.positions[:, left, 0]) > 0, (log.name, part)
        height = clip.positions[:, JOINT_INDEX["head"], 1] - clip.positions[:, JOINT_INDEX["hip_center"], 1]
        assert 0.3 < np.nanmedian(height) < 1.0, log.name
