import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from capture import orientations, skeleton
from capture.skeleton import JOINT_INDEX, OPPOSITE


def quaternion(rotation):
    return rotation.as_quat()[..., [3, 0, 1, 2]]


def rotation(quaternions):
    return Rotation.from_quat(quaternions[..., [1, 2, 3, 0]])


@pytest.fixture
def turns():
    return quaternion(Rotation.random(20, rng=5))


@pytest.fixture
def vectors():
    return np.random.default_rng(5).normal(size=(20, 3))


def test_a_mirrored_orientation_rotates_mirrored_bones(turns, vectors):
    there = skeleton.mirrored(rotation(turns).apply(vectors))
    np.testing.assert_allclose(
        rotation(orientations.mirrored(turns)).apply(skeleton.mirrored(vectors)), there, atol=1e-12
    )


def test_in_character_axes_a_bone_points_along_its_joints(turns, vectors):
    there = skeleton.to_character_axes(rotation(turns).apply(vectors))
    np.testing.assert_allclose(rotation(orientations.to_character_axes(turns)).apply(vectors), there, atol=1e-12)


def test_rotated_coordinates_rotate_orientations(turns, vectors):
    turn = Rotation.from_rotvec([0.3, -1.1, 0.4])
    found = rotation(orientations.rotated(turns, turn.as_matrix())).apply(vectors)
    np.testing.assert_allclose(found, turn.apply(rotation(turns).apply(vectors)), atol=1e-12)


def test_the_bone_that_begins_at_a_joint_ends_at_the_next_one_of_its_limb(turns):
    found = orientations.move_to_bone_starts(turns)
    for joint, end in (("elbow_left", "wrist_left"), ("shoulder_right", "elbow_right"), ("ankle_left", "foot_left")):
        np.testing.assert_array_equal(found[JOINT_INDEX[joint]], turns[JOINT_INDEX[end]])
    np.testing.assert_array_equal(found[JOINT_INDEX["hip_center"]], turns[JOINT_INDEX["spine"]])
    tips = [JOINT_INDEX[name] for name in ("head", "hand_left", "hand_right", "foot_left", "foot_right")]
    assert np.isnan(found[tips]).all()
    assert np.isfinite(np.delete(found, tips, axis=0)).all()


@pytest.mark.parametrize("bad", [[0, 0, 0, 0], [np.inf, 0, 0, 0], [np.nan, 0, 0, 1], [0.9, 0, 0, 0.1]])
def test_a_quaternion_of_another_length_is_unknown(turns, bad):
    given = turns.copy()
    given[7] = bad
    found = orientations.unit_or_unknown(given)
    assert np.isnan(found[7]).all()
    np.testing.assert_array_equal(np.delete(found, 7, axis=0), np.delete(turns, 7, axis=0))


def test_half_way_between_two_turns_is_half_the_turn_the_shorter_way_round():
    start, half, end = (quaternion(Rotation.from_rotvec([[0, angle, 0]])) for angle in (3.0, 3.2, 3.4))
    part = np.array([[0.5]])
    found = orientations.interpolated(start, -end, part)
    assert rotation(found).approx_equal(rotation(half), 1e-9).all()
    np.testing.assert_array_equal(orientations.interpolated(start, end, 0 * part), start)
    assert np.isnan(orientations.interpolated(start, np.full((1, 4), np.nan), part)).all()


def test_mirroring_twice_changes_nothing(turns):
    np.testing.assert_array_equal(orientations.mirrored(orientations.mirrored(turns)), turns)
    np.testing.assert_array_equal(orientations.mirrored(turns)[:, 0], turns[OPPOSITE, 0])
