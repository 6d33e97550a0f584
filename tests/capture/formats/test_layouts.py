import numpy as np
import pytest

from capture.formats.layouts import K25, K32, MSR_ACTION3D, NITE15, synthesise_missing, to_kinect20
from capture.skeleton import JOINT_INDEX

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


def test_a_missing_joint_is_between_its_neighbours_and_as_sure_as_the_least_sure_of_them_and_at_most_inferred():
    at = {name: np.array([j, 2.0 * j, 10.0]) for j, name in enumerate(NITE15)}
    sure = dict.fromkeys(NITE15, 1.0) | {"spine": 0.0, "hand_left": 0.0, "elbow_right": 0.25}
    ours, confidence = to_kinect20(NITE15, np.array([*at.values()]), np.array([*sure.values()], dtype=np.float32))
    filled, surely = synthesise_missing(ours, confidence)

    def between(one, other, share):
        return at[one] + share * (at[other] - at[one])

    at["hip_center"] = between("hip_left", "hip_right", 0.5)
    for joint, place, level in (
        ("hip_center", at["hip_center"], 0.5),
        ("spine", between("hip_center", "shoulder_center", 0.17), 0.5),
        ("wrist_left", [np.nan] * 3, 0.0),
        ("wrist_right", between("elbow_right", "hand_right", 0.75), 0.25),
        ("ankle_left", between("knee_left", "foot_left", 0.85), 0.5),
        ("ankle_right", between("knee_right", "foot_right", 0.85), 0.5),
    ):
        assert filled[JOINT_INDEX[joint]] == pytest.approx(place, abs=1e-12, nan_ok=True)
        assert surely[JOINT_INDEX[joint]] == level
    kept = [JOINT_INDEX[name] for name in NITE15 if sure[name]]
    assert np.array_equal(filled[kept], ours[kept])
    assert surely[kept].tolist() == [level for level in sure.values() if level]
