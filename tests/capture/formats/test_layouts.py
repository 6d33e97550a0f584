import numpy as np
import pytest

from capture.formats.layouts import K25, K32, MSR_ACTION3D, NITE15, synthesise_missing, to_kinect20
from capture.skeleton import JOINT_INDEX

SYNTHESISED = ["hip_center", "wrist_left", "wrist_right", "ankle_left", "ankle_right"]

# The foreign index of each of the 20 joints in Kinect v1 order, as each recorder's documentation numbers its joints.
FOREIGN = {
    "K25": (K25, [0, 1, 20, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]),
    "K21": (K25[:21], [0, 1, 20, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]),
    "K32": (K32, [0, 1, 3, 26, 5, 6, 7, 8, 12, 13, 14, 15, 18, 19, 20, 21, 22, 23, 24, 25]),
    "MSR": (MSR_ACTION3D, [6, 3, 2, 19, 0, 7, 9, 11, 1, 8, 10, 12, 4, 13, 15, 17, 5, 14, 16, 18]),
    "NiTE": (NITE15, [None, 8, 1, 0, 2, 4, None, 6, 3, 5, None, 7, 9, 11, None, 13, 10, 12, None, 14]),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_every_joint_is_read_from_its_documented_place_but_for_one_without_confidence(name):
    order, sources = FOREIGN[name]
    positions = np.arange(len(order))[None, :, None] * np.ones(3) + [0.0, 0.25, 0.5]
    sure, head = np.full((1, len(order)), 0.5, dtype=np.float32), order.index("head")
    sure[:, head] = 0
    ours, confidence = to_kinect20(order, positions, sure)
    expected = [[np.nan] * 3 if j in (None, head) else [j, j + 0.25, j + 0.5] for j in sources]
    assert np.array_equal(ours, [expected], equal_nan=True)
    assert np.array_equal(confidence, [[0.0 if j in (None, head) else 0.5 for j in sources]])
    assert confidence.dtype == np.float32


def _fifteen():
    """Return one frame of a skeleton with NiTE's joints, at positions that are easy to average."""
    at = {name: np.array([j, 2.0 * j, 10.0]) for j, name in enumerate(NITE15)}
    ours, confidence = to_kinect20(NITE15, np.array([at[name] for name in NITE15]), np.ones(15, dtype=np.float32))
    return at, ours, confidence


def test_missing_joints_are_between_their_neighbours():
    at, ours, confidence = _fifteen()
    filled, sure = synthesise_missing(ours, confidence)
    for name, expected in {
        "hip_center": (at["hip_left"] + at["hip_right"]) / 2,
        "wrist_left": at["elbow_left"] + 0.75 * (at["hand_left"] - at["elbow_left"]),
        "wrist_right": at["elbow_right"] + 0.75 * (at["hand_right"] - at["elbow_right"]),
        "ankle_left": at["knee_left"] + 0.85 * (at["foot_left"] - at["knee_left"]),
        "ankle_right": at["knee_right"] + 0.85 * (at["foot_right"] - at["knee_right"]),
    }.items():
        assert filled[JOINT_INDEX[name]] == pytest.approx(expected, abs=1e-12)
        assert sure[JOINT_INDEX[name]] == 0.5
    kept = [JOINT_INDEX[name] for name in NITE15]
    assert np.array_equal(filled[kept], ours[kept])
    assert np.array_equal(sure[kept], np.ones(15))


def test_a_lost_torso_is_placed_from_the_synthesised_hips():
    at, ours, confidence = _fifteen()
    spine = JOINT_INDEX["spine"]
    ours[spine], confidence[spine] = np.nan, 0.0
    filled, _ = synthesise_missing(ours, confidence)
    hips = (at["hip_left"] + at["hip_right"]) / 2
    assert filled[spine] == pytest.approx(hips + 0.17 * (at["shoulder_center"] - hips), abs=1e-12)


def test_a_missing_joint_is_lost_with_a_neighbour_and_has_the_lowest_confidence():
    _, ours, confidence = _fifteen()
    ours, confidence = np.stack([ours, ours]), np.stack([confidence, confidence])
    hand, elbow = JOINT_INDEX["hand_left"], JOINT_INDEX["elbow_right"]
    ours[1, hand], confidence[1, hand] = np.nan, 0.0
    confidence[1, elbow] = 0.25
    filled, sure = synthesise_missing(ours, confidence)
    left, right = JOINT_INDEX["wrist_left"], JOINT_INDEX["wrist_right"]
    assert sure[:, left].tolist() == [0.5, 0.0]
    assert np.isnan(filled[:, left]).all(axis=1).tolist() == [False, True]
    assert sure[:, right].tolist() == [0.5, 0.25]
