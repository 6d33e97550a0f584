import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.formats import mvnx, read_log
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from puppetline.errors import SkeletonLogError

PLACES = dict(
    zip(
        mvnx.SEGMENTS,
        [
            *((0, 0, z) for z in (0.95, 1.04, 1.14, 1.23, 1.32, 1.45, 1.56)),
            *((0, s * y, z) for s in (-1, 1) for y, z in ((0.03, 1.4), (0.18, 1.4), (0.18, 1.12), (0.18, 0.87))),
            *((x, s * 0.08, z) for s in (-1, 1) for x, z in ((0, 0.95), (0, 0.53), (0, 0.1), (0.15, 0.02))),
        ],
        strict=True,
    )
)


def write(path, frames=4, labels=True, before=""):
    turns = " ".join(["1 0 0 0"] * 23)
    rows = []
    for number in range(-1, frames):
        places = " ".join(f"{x + 0.01 * max(number, 0)} {y} {z}" for x, y, z in PLACES.values())
        kind = "normal" if number >= 0 else "npose"
        rows.append(
            f'<frame time="{10 * number}" type="{kind}"><orientation>{turns}</orientation>'
            f"<position>{places}</position></frame>"
        )
    names = "".join(f'<segment label="{name}" id="1"/>' for name in PLACES)
    segments = f"<segments>{names}</segments>" if labels else ""
    path.write_text(
        f'<?xml version="1.0"?>{before}<mvnx><subject frameRate="100">{segments}<frames>{"".join(rows)}'
        "</frames></subject></mvnx>"
    )
    return path


@pytest.mark.parametrize("labels", [True, False])
def test_segments_become_joints_with_y_up(tmp_path, labels):
    (clip,) = read_log(write(tmp_path / "a.mvnx", labels=labels))
    assert_allclose(clip.times, [0, 0.01, 0.02, 0.03])
    assert_allclose(clip.positions[:, 0], [[0, 0, 2.5 - 0.01 * k] for k in range(4)], atol=1e-9)
    for joint, segment in (("knee_left", "LeftLowerLeg"), ("wrist_right", "RightHand"), ("foot_left", "LeftToe")):
        x, y, z = np.subtract(PLACES[segment], PLACES["Pelvis"])
        assert_allclose(clip.positions[0, JOINT_INDEX[joint]], [-y, z, 2.5 - x], atol=1e-9)
    assert clip.positions[0, JOINT_INDEX["head"], 1] > 1.56 - 0.95


def test_a_file_with_a_document_type_or_cut_off_is_refused(tmp_path):
    bomb = '<!DOCTYPE a [<!ENTITY b "c">]>'
    with pytest.raises(SkeletonLogError, match="document type"):
        mvnx.read(write(tmp_path / "a.mvnx", before=bomb), ReadOptions())
    whole = write(tmp_path / "b.mvnx").read_text()
    (tmp_path / "b.mvnx").write_text(whole[: len(whole) // 2])
    with pytest.raises(SkeletonLogError, match="line 1"):
        mvnx.read(tmp_path / "b.mvnx", ReadOptions())
