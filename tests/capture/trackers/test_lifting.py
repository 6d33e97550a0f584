"""Joints looked for in depth pictures that are drawn by hand: each on a patch of its own skin before a wall."""

import numpy as np
import pytest

from capture import body
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS, TRACKED
from capture.trackers import lifting
from capture.trackers.lifting import NEIGHBORS, SKIN_TO_JOINT, lift
from capture.trackers.picture import Lens
from capture.trackers.placing import rehearse

LENS = Lens(640, 480, 500.0)
SURE = np.full(20, TRACKED, np.float32)
ANKLE, KNEE, FOOT, WRIST, HAND = (JOINT_INDEX[f"{joint}_left"] for joint in ("ankle", "knee", "foot", "wrist", "hand"))
WALL = 4.5
PATCH = 12  # pixels from a joint's pixel to the edge of its skin


@pytest.fixture
def joints():
    """Somebody who stands in the plane z = 2.5 m with the arms held out: no two patches of skin meet."""
    directions = {"spine": (0, 1), "shoulder_center": (0, 1), "head": (0, 1), "shoulder": (1, -0.1), "elbow": (1, 0)}
    directions |= {"wrist": (1, 0), "hand": (1, 0.1), "hip": (1, -0.6), "knee": (0.2, -1), "ankle": (0, -1)}
    directions |= {"foot": (1, -1)}
    places = np.zeros((20, 3))
    places[0] = 0.05, 0.0, 2.5
    for joint, parent in PARENTS.items():
        x, y = directions[joint.removesuffix("_left").removesuffix("_right")]
        bone = np.array([-x if joint.endswith("_left") else x, y, 0.0])
        places[JOINT_INDEX[joint]] = places[JOINT_INDEX[parent]] + body.typical_bone_length(
            joint
        ) * bone / np.linalg.norm(bone)
    return places


def drawn(joints, skin=None):
    """Return a depth picture of patches around the joints' pixels; `skin` (20,) metres, the nearest on top."""
    skin = joints[:, 2] - SKIN_TO_JOINT if skin is None else skin
    depth = np.full((LENS.height, LENS.width), round(1000 * WALL), np.uint16)
    for joint in np.argsort(-skin):
        patch(depth, joints[joint], skin[joint])
    return depth


def patch(depth, joint, metres, beside=0):
    column, row = LENS.project(joint).astype(int)
    rows = slice(row - PATCH, row + PATCH + 1)
    depth[rows, column - PATCH + beside : column + PATCH + 1 + beside] = round(1000 * metres)


def lifted(depth, joints, guessed=None, confidence=SURE):
    """Return what is lifted of joints in their true pixels; `guessed` (20,) metres, as true if not said."""
    bones = np.zeros(20)
    bones[1:] = np.linalg.norm(joints[1:] - joints[NEIGHBORS[1:]], axis=1)
    guessed = joints[:, 2] if guessed is None else guessed
    return lift(depth, LENS.focal, LENS.project(joints), joints / joints[:, 2:], guessed, bones, confidence)


def test_each_joint_is_its_skin_and_half_its_thickness_away(joints):
    depths, known, scale = lifted(drawn(joints), joints)
    assert known.all()
    np.testing.assert_allclose(depths, joints[:, 2], atol=5e-4)
    assert scale == pytest.approx(1.0, abs=1e-3)


def test_the_scale_is_the_sensors_metre_for_the_trackers(joints):
    bones = np.zeros(20)
    bones[1:] = np.linalg.norm(joints[1:] - joints[NEIGHBORS[1:]], axis=1)
    rays = joints / joints[:, 2:]
    depths, known, scale = lift(
        drawn(joints), LENS.focal, LENS.project(joints), rays, joints[:, 2] / 1.25, bones / 1.25, SURE
    )
    assert known.all()
    assert scale == pytest.approx(1.25, abs=1e-3)
    np.testing.assert_allclose(depths, joints[:, 2], atol=5e-4)


@pytest.mark.parametrize("bent", [0.4, -0.4])
def test_a_limb_that_the_tracker_takes_for_bent_is_found_by_the_length_of_its_bones(joints, bent):
    guessed = joints[:, 2].copy()
    guessed[[ANKLE, FOOT]] += bent
    depths, known, _ = lifted(drawn(joints), joints, guessed)
    assert known.all()
    np.testing.assert_allclose(depths, joints[:, 2], atol=5e-4)


@pytest.mark.parametrize(("length", "found"), [(1.38, True), (1.42, False)])
def test_nothing_is_farther_from_its_neighbour_than_1_4_bones(joints, length, found):
    ray, knee = joints[ANKLE] / joints[ANKLE, 2], joints[KNEE]
    shin = np.linalg.norm(joints[ANKLE] - knee)
    _, z = sorted(np.roots([ray @ ray, -2 * ray @ knee, knee @ knee - (length * shin) ** 2]))
    skin, guessed = joints[:, 2] - SKIN_TO_JOINT, joints[:, 2].copy()
    skin[ANKLE], guessed[ANKLE] = z - SKIN_TO_JOINT[ANKLE], z - 0.2
    depths, known, _ = lifted(drawn(joints, skin), joints, guessed)
    assert known[ANKLE] == found
    assert depths[ANKLE] == pytest.approx(z if found else z - 0.2, abs=1e-3)


def test_the_nearest_surface_that_can_be_the_joint_is_the_joint(joints):
    depth = drawn(joints)
    patch(depth, joints[WRIST], 1.0, beside=PATCH)  # somebody else's hand, before half of the wrist
    depths, known, _ = lifted(depth, joints)
    assert known[WRIST]
    assert depths[WRIST] == pytest.approx(joints[WRIST, 2], abs=5e-4)


def test_a_surface_in_less_than_a_quarter_of_the_window_is_an_edge_of_something(joints):
    depth = drawn(joints)
    patch(depth, joints[WRIST], 2.3, beside=PATCH + 4)  # a column at the window's edge, near enough to be the wrist
    depths, _, _ = lifted(depth, joints)
    assert depths[WRIST] == pytest.approx(joints[WRIST, 2], abs=5e-4)


def test_what_depth_misses_is_before_or_behind_its_neighbour_as_the_tracker_guesses(joints):
    depth = drawn(joints)
    patch(depth, joints[HAND], 0.0)
    guessed = joints[:, 2].copy()
    guessed[WRIST] += 0.2  # wrong, as depth tells
    guessed[HAND] += 0.2 - 0.07  # 7 cm before that
    depths, known, scale = lifted(depth, joints, guessed)
    np.testing.assert_array_equal(np.flatnonzero(~known), [HAND])
    assert depths[HAND] == pytest.approx(depths[WRIST] - 0.07 * scale, abs=1e-9)


def test_a_joint_out_of_sight_or_beyond_the_picture_is_not_looked_for(joints):
    hidden = SURE.copy()
    hidden[WRIST] = 0.49
    assert not lifted(drawn(joints), joints, confidence=hidden)[1][WRIST]
    away = joints.copy()
    away[HAND] += [-1.0, 0, 0]
    column, _ = LENS.project(away[HAND])
    assert column >= LENS.width
    _, known, _ = lifted(drawn(joints), away)
    np.testing.assert_array_equal(np.flatnonzero(~known), [HAND])


def test_too_few_joints_with_depth_tell_nothing(joints):
    depth = np.zeros((LENS.height, LENS.width), np.uint16)
    assert lifted(depth, joints) is None
    for joint in range(4):
        patch(depth, joints[joint], joints[joint, 2])
    sure = np.where(np.arange(20) < 4, TRACKED, 0).astype(np.float32)
    assert lifted(depth, joints, confidence=sure) is None


def test_a_picture_that_may_not_be_written_or_is_turned_gives_the_same_with_nothing_compiled_for_it(joints):
    depth = drawn(joints)
    rehearse()
    compiled = list(lifting._lift.signatures)
    expected = lifted(depth, joints)
    locked = depth.copy()
    locked.flags.writeable = False
    for same in (locked, np.asfortranarray(depth), np.repeat(depth, 2, axis=1)[:, ::2]):
        for one, other in zip(lifted(same, joints), expected, strict=True):
            np.testing.assert_array_equal(one, other)
    assert lifting._lift.signatures == compiled


def test_neighbours_stand_before_their_joints():
    assert [JOINTS[near] for near in NEIGHBORS[1:]] == [PARENTS[joint] for joint in JOINTS[1:]]
    assert (np.arange(20) > NEIGHBORS).all()
