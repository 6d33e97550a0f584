import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture import orientations, skeleton
from capture.skeleton import JOINT_INDEX

TURNS = Rotation.random(20, rng=5)
QUATERNIONS = TURNS.as_quat(scalar_first=True)
VECTORS = np.random.default_rng(5).normal(size=(20, 3))
TURN = Rotation.from_rotvec([0.3, -1.1, 0.4])


def rotation(quaternions):
    return Rotation.from_quat(quaternions, scalar_first=True)


@pytest.mark.parametrize(
    ("converted", "vectors", "expected"),
    [
        (orientations.mirrored, skeleton.mirrored(VECTORS), skeleton.mirrored(TURNS.apply(VECTORS))),
        (orientations.to_character_axes, VECTORS, skeleton.to_character_axes(TURNS.apply(VECTORS))),
        (lambda turns: orientations.rotated(turns, TURN.as_matrix()), VECTORS, TURN.apply(TURNS.apply(VECTORS))),
    ],
)
def test_converted_orientations_turn_bones_to_where_converted_joints_are(converted, vectors, expected):
    assert_allclose(rotation(converted(QUATERNIONS)).apply(vectors), expected, atol=1e-12)


def test_the_bone_that_begins_at_a_joint_ends_at_the_next_one_of_its_limb():
    found = orientations.move_to_bone_starts(QUATERNIONS)
    ends = {"elbow_left": "wrist_left", "shoulder_right": "elbow_right", "ankle_left": "foot_left"}
    for joint, end in (ends | {"hip_center": "spine"}).items():
        assert_array_equal(found[JOINT_INDEX[joint]], QUATERNIONS[JOINT_INDEX[end]])
    tips = [JOINT_INDEX[name] for name in ("head", "hand_left", "hand_right", "foot_left", "foot_right")]
    assert np.flatnonzero(np.isnan(found).all(axis=1)).tolist() == sorted(tips)


@pytest.mark.parametrize("bad", [[0, 0, 0, 0], [np.inf, 0, 0, 0], [np.nan, 0, 0, 1], [0.9, 0, 0, 0.1]])
def test_a_quaternion_of_another_length_is_unknown(bad):
    given = QUATERNIONS.copy()
    given[7] = bad
    found = orientations.unit_or_unknown(given)
    assert np.isnan(found[7]).all()
    assert_array_equal(np.delete(found, 7, axis=0), np.delete(QUATERNIONS, 7, axis=0))


def test_half_way_between_two_turns_is_half_the_turn_the_shorter_way_round():
    start, half, end = (Rotation.from_rotvec([[0, angle, 0]]).as_quat(scalar_first=True) for angle in (3.0, 3.2, 3.4))
    part = np.array([[0.5]])
    assert rotation(orientations.interpolated(start, -end, part)).approx_equal(rotation(half), 1e-9).all()
    assert_array_equal(orientations.interpolated(start, end, 0 * part), start)
    assert np.isnan(orientations.interpolated(start, np.full((1, 4), np.nan), part)).all()
