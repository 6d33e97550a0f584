"""Parameters of the SMPL body give the same motion in arrays, tables and documents; positions are no parameters."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture.formats import arrays, landmarks_json, smpl, table
from puppetline.errors import SkeletonLogError

from .test_arrays import npy, npz

COUNT = 30


def walk():
    """Return rotation vectors (T, 24, 3) of a walk, and translations (T, 3)."""
    phase = np.linspace(0, 6, COUNT)
    poses = np.random.default_rng(0).uniform(-0.05, 0.05, (COUNT, 24, 3))
    poses[:, 1:3, 0] += 0.5 * np.stack([np.sin(phase), -np.sin(phase)], axis=1)
    poses[:, 4:6, 0] += 0.4
    poses[:, 16:18, 2] += [-1.2, 1.2]
    poses[:, 22:] = 0
    return poses.round(6), np.stack([np.zeros(COUNT), np.ones(COUNT), phase / 3], axis=1).round(6)


POSES, WAY = walk()
FLAT = POSES.reshape(COUNT, -1)
STILL = np.zeros_like(WAY)
TURNS = Rotation.from_rotvec(POSES.reshape(-1, 3)).as_matrix().reshape(COUNT, 24, 3, 3)


def lines(rows, header=""):
    text = "\n".join(",".join(f"{value:g}" for value in row) for row in rows)
    return f"{header}\n{text}\n".lstrip().encode()


POSE_NAMES = ",".join(f"pose_{index}" for index in range(72))
NUMBERED = np.hstack([np.arange(COUNT)[:, None], FLAT])


@pytest.mark.parametrize(
    ("reader", "content", "way"),
    [
        (arrays, npy(FLAT), STILL),
        (arrays, npy(POSES), STILL),
        (arrays, npy(np.hstack([WAY, FLAT])), WAY),
        (table, lines(FLAT), STILL),
        (table, lines(np.hstack([FLAT, WAY])), WAY),
        (table, lines(np.hstack([WAY, FLAT])), WAY),
        (table, lines(NUMBERED), STILL),
        (table, lines(FLAT, POSE_NAMES), STILL),
        (table, lines(NUMBERED, f"frame,{POSE_NAMES}"), STILL),
        (landmarks_json, {"poses": FLAT, "trans": WAY}, WAY),
        (landmarks_json, {"result": {"smpl_params": {"global_orient": FLAT[:, :3], "body_pose": FLAT[:, 3:]}}}, STILL),
        (landmarks_json, {"1": {"pose": FLAT, "trans": WAY, "frame_ids": np.arange(COUNT)}}, WAY),
        (
            landmarks_json,
            [{"global_orient": a[:3], "body_pose": a[3:], "transl": b} for a, b in zip(FLAT, WAY, strict=True)],
            WAY,
        ),
        (arrays, npz(global_orient=TURNS[:, :1], body_pose=TURNS[:, 1:], transl=WAY), WAY),
        (
            landmarks_json,
            {"results": [{"smpl": {"global_orient": a[:1], "body_pose": a[1:]}, "camera": [1, 2]} for a in TURNS]},
            STILL,
        ),
        (landmarks_json, [{"frame": k, "smpl": {"pose": a[None]}} for k, a in enumerate(FLAT)], STILL),
    ],
)
def test_parameters_are_those_of_named_arrays(read, reader, content, way):
    if reader is landmarks_json:
        content = json.dumps(content, default=lambda array: array.tolist()).encode()
    assert reader.matches(content)
    [clip] = read(reader, content)
    [same] = read(arrays, npz(poses=FLAT, trans=way))
    assert_allclose(clip.positions, same.positions, atol=1e-5)
    assert "Parameters of the SMPL body; the bones are those of its mean shape." in clip.notes


def test_frames_without_rotations_are_lost(read):
    gaps, is_lost = FLAT.copy(), np.arange(COUNT) % 4 == 3
    gaps[is_lost, 20], gaps[::3, 70] = np.nan, np.inf  # of a knee, and of a hand, which does not count
    [clip], [whole] = (read(arrays, npz(poses=poses, trans=WAY)) for poses in (gaps, FLAT))
    assert np.isfinite(whole.positions).all()
    assert_array_equal(np.isnan(clip.positions), np.broadcast_to(is_lost[:, None, None], clip.positions.shape))
    assert_allclose(clip.positions[~is_lost], whole.positions[~is_lost], atol=1e-12)
    with pytest.raises(SkeletonLogError, match="none is known"), np.errstate(all="raise"):
        read(arrays, npz(poses=FLAT * np.nan, trans=WAY))


def test_people_of_a_document_are_performers(read):
    people = [{"id": 3, "poses": FLAT.tolist(), "trans": WAY.tolist()}, {"id": 5, "poses": FLAT[::-1].tolist()}]
    clips = read(landmarks_json, json.dumps(people).encode())
    assert [clip.user for clip in clips] == [0, 1]
    [same] = read(arrays, npz(poses=FLAT[::-1]))
    assert_allclose(clips[1].positions, same.positions, atol=1e-9)


@pytest.mark.parametrize("floor", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("count", [22, 24])
def test_positions_are_no_parameters(floor, count):
    for way in (STILL, WAY):
        positions = smpl.positions(POSES, way + np.array([0, floor, 0]))[1][:, :count]
        assert smpl.in_rows(positions) is None
        assert smpl.in_rows(positions.reshape(COUNT, -1)) is None
    assert smpl.in_rows(np.zeros((9, 3 * count))) is None


@pytest.mark.parametrize("count", [66, 72, 75, 156])
def test_other_numbers_are_no_parameters(count):
    random = np.random.default_rng(count)
    for rows in (
        random.normal(size=(200, count)),
        random.uniform(size=(200, count)),
        0.3 * random.uniform(size=(200, count)),
        np.cumsum(0.05 * random.normal(size=(200, count)), axis=0),
    ):
        assert smpl.in_rows(rows) is None
