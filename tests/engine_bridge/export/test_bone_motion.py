import numpy as np
import pytest
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from engine_bridge.export import bone_motion
from solver.skinning.weights import blend_lines

BONES = 5


@pytest.fixture
def skin():
    """A bar of 400 points with five overlapping bones; with `blend_lines` as W, controls are the bones' matrices."""
    rng = np.random.default_rng(2)
    rest = rng.uniform(-1, 1, (400, 3)) * [0.5, 0.1, 0.1]
    place = (rest[:, :1] + 0.5) * (BONES - 1)
    weights = np.maximum(0, 1.3 - np.abs(place - np.arange(BONES)))
    weights = csr_matrix(weights / weights.sum(axis=1, keepdims=True))
    return rest, weights, blend_lines(rest, weights)


def motions(count, angle, seed=4):
    """Rigid motions (F, B, 3, 4) that differ between bones."""
    rng = np.random.default_rng(seed)
    made = np.empty((count, BONES, 3, 4))
    made[..., :3] = Rotation.from_rotvec(rng.normal(0, angle, (count * BONES, 3))).as_matrix().reshape(-1, BONES, 3, 3)
    made[..., 3] = rng.normal(0, 0.1, (count, BONES, 3))
    return made


def controls(motion):
    """Controls (F, 4B, 3) with which `blend_lines` gives the positions of the skin."""
    return motion.transpose(0, 3, 1, 2).reshape(len(motion), -1, 3)


def assert_rigid(motion):
    turns = motion[..., :3]
    np.testing.assert_allclose(turns @ turns.swapaxes(-1, -2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-10)
    np.testing.assert_allclose(np.linalg.det(turns), 1, atol=1e-10)


def test_vertices_are_carried_by_the_weighted_mean_of_their_bones_matrices(skin):
    rest, weights, lines = skin
    motion = motions(3, 0.5)
    expected = np.einsum("nb,fbij,nj->nfi", weights.toarray(), motion[..., :3], rest)
    expected += np.einsum("nb,fbi->nfi", weights.toarray(), motion[..., 3])
    np.testing.assert_allclose(bone_motion.carried(lines, motion), expected, atol=1e-14)


def test_the_motion_of_a_skin_is_found_again(skin):
    rest, weights, lines = skin
    motion = motions(20, 0.3)
    found = bone_motion.solve(bone_motion.moments(rest, weights, lines), controls(motion))
    assert_rigid(found)
    off = bone_motion.carried(lines, found) - bone_motion.carried(lines, motion)
    moved = bone_motion.carried(lines, motion) - rest[:, None]
    # exactly, but for the pull of `AFFINITY_WEIGHT` on bones as far apart as these
    assert np.linalg.norm(off) < 0.03 * np.linalg.norm(moved)


def test_a_rigid_motion_is_reproduced_exactly_by_every_bone(skin):
    rest, weights, lines = skin
    motion = np.repeat(motions(10, 1.5)[:, :1], BONES, axis=1)
    found = bone_motion.solve(bone_motion.moments(rest, weights, lines), controls(motion))
    np.testing.assert_allclose(found, motion, atol=1e-9)


def test_a_frame_does_not_depend_on_the_others(skin):
    rest, weights, lines = skin
    sums = bone_motion.moments(rest, weights, lines)
    frames = controls(motions(6, 0.4))
    together = bone_motion.solve(sums, frames)
    alone = np.concatenate([bone_motion.solve(sums, frame[None]) for frame in frames])
    np.testing.assert_allclose(together, alone, atol=1e-10)


def test_close_poses_give_close_bone_motions(skin):
    rest, weights, lines = skin
    sums = bone_motion.moments(rest, weights, lines)
    frames = controls(motions(20, 0.3))
    nudge = 1e-5 * np.random.default_rng(9).normal(size=frames.shape)
    apart = np.abs(bone_motion.solve(sums, frames + nudge) - bone_motion.solve(sums, frames))
    assert apart.max() < 100 * np.abs(nudge).max()


def test_no_bone_can_be_moved_a_little_to_fit_better(skin):
    """A stationary point: up to `AFFINITY_WEIGHT`, turning or shifting a bone increases the sum of squares."""
    rest, weights, lines = skin
    wanted = bone_motion.carried(lines, motions(1, 0.2))
    wanted += np.random.default_rng(7).normal(0, 0.01, wanted.shape)
    frames = np.linalg.lstsq(lines.toarray(), wanted[:, 0], rcond=None)[0][None]
    found = bone_motion.solve(bone_motion.moments(rest, weights, lines), frames)
    there = lines @ frames[0]

    def cost(motion):
        return ((bone_motion.carried(lines, motion)[:, 0] - there) ** 2).sum()

    for bone in range(BONES):
        for axis in range(3):
            for sign in (-0.03, 0.03):
                turned, shifted = found.copy(), found.copy()
                turned[:, bone, :, :3] = (
                    Rotation.from_rotvec(sign * np.eye(3)[axis]).as_matrix() @ turned[:, bone, :, :3]
                )
                shifted[:, bone, axis, 3] += sign
                assert min(cost(turned), cost(shifted)) > cost(found)
