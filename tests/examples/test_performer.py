from itertools import pairwise

import numpy as np
import pytest
from puppetline.examples.performer import REST, interpolated, posed

from capture.body import typical_bone_length
from capture.skeleton import JOINT_INDEX, OPPOSITE, PARENTS

MOVES = [(1.0, 1.5, (1.0, 0.0, -2.0)), (1.5, 2.0, (3.0, 0.0, -1.0)), (2.5, 3.0, (0.0, 0.0, -1.0))]
START, (ONE, TWO, THREE) = (0.0, 0.5, 0.0), (target for *_, target in MOVES)
KEYS = [*zip((0.0, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0), (START, START, ONE, TWO, TWO, THREE, THREE), strict=True)]
"""When a part is where: between two keys with the same value it is still."""

SWAY = {"hips": 0.04, "pelvis": 20, "trunk": 30, "head": 30, "hand": 0.25, "ankle": 0.03, "foot": 30}
"""How far each part may go from rest with the ankles in reach: metres, degrees."""


def parts(frames, **changed):
    """Return all parts at rest except the given ones."""
    return {part: np.tile(changed.get(part, rest), (frames, 1)) for part, rest in REST.items()}


def swaying(frames, seed=1):
    """Return each part near its rest value, the hips only below it because the knees are nearly straight."""
    rng = np.random.default_rng(seed)
    poses = {part: rest + rng.uniform(-1, 1, (frames, 3)) * SWAY[part.split("_")[0]] for part, rest in REST.items()}
    poses["hips"][:, 1] -= 0.12
    return poses


def mirrored(poses):
    """Return the mirrored parts: out stays out, but the hips' right and all turns change sign."""
    swapped, signs, found = {"left": "right", "right": "left"}, {"hips": [-1, 1, 1], "hand": 1, "ankle": 1}, {}
    for part, path in poses.items():
        kind, _, side = part.partition("_")
        found[f"{kind}_{swapped[side]}" if side else part] = path * signs.get(kind, [1, -1, -1])
    return found


def paths(positions):
    """Each joint's path by name."""
    return {name: positions[:, j] for name, j in JOINT_INDEX.items()}


def at(times):
    """Return the values of the part, whose times must not end before its moves."""
    return interpolated(MOVES, START, np.array([*times, 5.0]))[:-1]


def test_a_part_moves_from_key_to_key_without_overshoot_and_without_jumps_in_value_speed_or_acceleration():
    for (begin, start), (end, target) in pairwise(KEYS):
        values = at(np.linspace(begin, end, 51))
        np.testing.assert_allclose(values[[0, -1]], [start, target], rtol=0, atol=1e-12)
        assert np.all(values >= np.minimum(start, target) - 1e-12)
        assert np.all(values <= np.maximum(start, target) + 1e-12)
    step = 1e-4
    for key, _ in KEYS[1:-1]:
        values = at(key + step * np.arange(-3, 4))
        assert np.abs(np.diff(values, axis=0)).max() < 10.0 * step
        assert np.abs(np.diff(values, 2, axis=0)).max() < 0.5 * step**2  # none at a key, up to 69 in between


def test_stands_upright_on_the_floor_and_faces_the_sensor_with_the_right_side_at_positive_x():
    joint = {key: path[0] for key, path in paths(posed(parts(1), 2.5)).items()}
    for part in ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "foot"):
        right, left = joint[f"{part}_right"], joint[f"{part}_left"]
        assert right[0] > 0.05
        np.testing.assert_allclose(left, right * [-1, 1, 1], atol=1e-12)
    for side in ("left", "right"):
        assert joint[f"foot_{side}"][2] < joint[f"ankle_{side}"][2]
        assert -1.0 < joint[f"foot_{side}"][1] < -0.95
        assert 0.05 < abs(joint[f"hand_{side}"][0]) - abs(joint[f"hip_{side}"][0]) < 0.25
        assert joint[f"hand_{side}"][1] < joint["hip_center"][1]
    assert 1.55 < joint["head"][1] + 1.0 < 1.70
    assert joint["head"][0] == 0.0


def test_bones_keep_their_length_in_every_pose():
    joint = paths(posed(swaying(200), 2.5))
    for child, parent in PARENTS.items():
        lengths = np.linalg.norm(joint[child] - joint[parent], axis=1)
        np.testing.assert_allclose(lengths, typical_bone_length(child), rtol=0, atol=1e-9, err_msg=child)


def test_a_mirrored_pose_is_the_pose_in_a_mirror():
    poses = swaying(200)
    np.testing.assert_allclose(
        posed(mirrored(poses), 2.5), posed(poses, 2.5)[:, OPPOSITE] * [-1, 1, 1], rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("wish", [[0.1, 0.1, 0.3], [0.5, -0.5, 1.0]])
def test_a_hand_within_reach_is_placed_and_one_beyond_is_drawn_in_on_its_line(wish):
    joint = paths(posed(parts(1, hand_right=wish), 2.5))
    hand = (joint["hand_right"] - joint["shoulder_right"])[0] * [1, 1, -1]
    length, arm = np.linalg.norm(wish), sum(map(typical_bone_length, ("elbow", "wrist", "hand")))
    np.testing.assert_allclose(hand / np.linalg.norm(hand), wish / length, rtol=0, atol=1e-12)
    if length < 0.6 * arm:
        np.testing.assert_allclose(hand, wish, rtol=0, atol=1e-5)
    else:
        assert 0.99 * arm < np.linalg.norm(hand) < arm


def test_an_ankle_out_of_reach_is_refused():
    poses = parts(3)
    poses["ankle_left"][1] = [0.5, 0.0, 0.0]
    with pytest.raises(ValueError, match="in frame 1"):
        posed(poses, 2.5)
