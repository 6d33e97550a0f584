"""Depths of joints in constructed images: a patch of skin for each joint, in front of a wall."""

import numpy as np
import pytest

from capture import body
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS, TRACKED
from capture.trackers import joint_depth
from capture.trackers.joint_depth import PARENT_INDICES, SKIN_TO_JOINT_METRES, measure_depths
from capture.trackers.picture import Lens
from capture.trackers.placing import warm_up

LENS = Lens(640, 480, 500.0)
TRACKED_ALL = np.full(20, TRACKED, np.float32)
ANKLE, KNEE, FOOT, WRIST, HAND = (JOINT_INDEX[f"{joint}_left"] for joint in ("ankle", "knee", "foot", "wrist", "hand"))
WALL = 4.5
PATCH = 12  # pixels from a joint's pixel to the edge of its skin


@pytest.fixture
def joints():
    """A body in the plane z = 2.5 m with the arms held out, so that no two patches of skin overlap."""
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
    """Return a depth image of patches around the joints' pixels, the nearest on top; `skin` (20,) is in metres."""
    skin = joints[:, 2] - SKIN_TO_JOINT_METRES if skin is None else skin
    depth = np.full((LENS.height, LENS.width), WALL, np.float32)
    for joint in np.argsort(-skin):
        patch(depth, joints[joint], skin[joint])
    return depth


def patch(depth, joint, metres, beside=0):
    column, row = LENS.project(joint).astype(int)
    rows = slice(row - PATCH, row + PATCH + 1)
    depth[rows, column - PATCH + beside : column + PATCH + 1 + beside] = round(metres, 3)


def measured(depth, joints, estimated=None, confidence=TRACKED_ALL):
    """Measure the depths of joints at their true pixels; the estimate (20,), in metres, is exact by default."""
    bones = np.zeros(20)
    bones[1:] = np.linalg.norm(joints[1:] - joints[PARENT_INDICES[1:]], axis=1)
    estimated = joints[:, 2] if estimated is None else estimated
    return measure_depths(depth, LENS.focal, LENS.project(joints), joints / joints[:, 2:], estimated, bones, confidence)


def test_a_joint_is_half_its_thickness_behind_the_skin(joints):
    depths, known, scale = measured(drawn(joints), joints)
    assert known.all()
    np.testing.assert_allclose(depths, joints[:, 2], atol=5e-4)
    assert scale == pytest.approx(1.0, abs=1e-3)


def test_the_scale_is_metres_per_metre_of_the_tracker(joints):
    bones = np.zeros(20)
    bones[1:] = np.linalg.norm(joints[1:] - joints[PARENT_INDICES[1:]], axis=1)
    rays = joints / joints[:, 2:]
    depths, known, scale = measure_depths(
        drawn(joints), LENS.focal, LENS.project(joints), rays, joints[:, 2] / 1.25, bones / 1.25, TRACKED_ALL
    )
    assert known.all()
    assert scale == pytest.approx(1.25, abs=1e-3)
    np.testing.assert_allclose(depths, joints[:, 2], atol=5e-4)


@pytest.mark.parametrize("bent", [0.4, -0.4])
def test_a_limb_that_is_wrongly_estimated_as_bent_is_found_by_its_bone_lengths(joints, bent):
    estimated = joints[:, 2].copy()
    estimated[[ANKLE, FOOT]] += bent
    depths, known, _ = measured(drawn(joints), joints, estimated)
    assert known.all()
    np.testing.assert_allclose(depths, joints[:, 2], atol=5e-4)


@pytest.mark.parametrize(("length", "found"), [(1.38, True), (1.42, False)])
def test_no_joint_is_farther_from_its_parent_than_1_4_bone_lengths(joints, length, found):
    ray, knee = joints[ANKLE] / joints[ANKLE, 2], joints[KNEE]
    shin = np.linalg.norm(joints[ANKLE] - knee)
    _, z = sorted(np.roots([ray @ ray, -2 * ray @ knee, knee @ knee - (length * shin) ** 2]))
    skin, estimated = joints[:, 2] - SKIN_TO_JOINT_METRES, joints[:, 2].copy()
    skin[ANKLE], estimated[ANKLE] = z - SKIN_TO_JOINT_METRES[ANKLE], z - 0.2
    depths, known, _ = measured(drawn(joints, skin), joints, estimated)
    assert known[ANKLE] == found
    assert depths[ANKLE] == pytest.approx(z if found else z - 0.2, abs=1e-3)


def test_a_joint_is_behind_the_nearest_plausible_surface(joints):
    depth = drawn(joints)
    patch(depth, joints[WRIST], 1.0, beside=PATCH)  # another hand, in front of half of the wrist
    depths, known, _ = measured(depth, joints)
    assert known[WRIST]
    assert depths[WRIST] == pytest.approx(joints[WRIST, 2], abs=5e-4)


def test_a_surface_in_less_than_a_quarter_of_the_window_is_ignored(joints):
    depth = drawn(joints)
    patch(depth, joints[WRIST], 2.3, beside=PATCH + 4)  # a column at the window's edge, near enough to be the wrist
    depths, _, _ = measured(depth, joints)
    assert depths[WRIST] == pytest.approx(joints[WRIST, 2], abs=5e-4)


def test_a_joint_without_depth_keeps_its_estimated_offset_from_the_parent(joints):
    depth = drawn(joints)
    patch(depth, joints[HAND], 0.0)
    estimated = joints[:, 2].copy()
    estimated[WRIST] += 0.2  # wrong, as depth tells
    estimated[HAND] += 0.2 - 0.07  # 7 cm before that
    depths, known, scale = measured(depth, joints, estimated)
    np.testing.assert_array_equal(np.flatnonzero(~known), [HAND])
    assert depths[HAND] == pytest.approx(depths[WRIST] - 0.07 * scale, abs=1e-9)


def test_hidden_joints_and_joints_outside_the_image_have_no_measured_depth(joints):
    hidden = TRACKED_ALL.copy()
    hidden[WRIST] = 0.49
    assert not measured(drawn(joints), joints, confidence=hidden)[1][WRIST]
    away = joints.copy()
    away[HAND] += [-1.0, 0, 0]
    column, _ = LENS.project(away[HAND])
    assert column >= LENS.width
    _, known, _ = measured(drawn(joints), away)
    np.testing.assert_array_equal(np.flatnonzero(~known), [HAND])


def test_too_few_joints_with_depth_give_no_result(joints):
    depth = np.zeros((LENS.height, LENS.width), np.float32)
    assert measured(depth, joints) is None
    for joint in range(4):
        patch(depth, joints[joint], joints[joint, 2])
    sure = np.where(np.arange(20) < 4, TRACKED, 0).astype(np.float32)
    assert measured(depth, joints, confidence=sure) is None


def test_arrays_of_any_layout_give_the_same_without_compiling_again(joints):
    depth = drawn(joints)
    warm_up()
    compiled = list(joint_depth._measure.signatures)
    expected = measured(depth, joints)
    locked = depth.copy()
    locked.flags.writeable = False
    for same in (locked, np.asfortranarray(depth), np.repeat(depth, 2, axis=1)[:, ::2]):
        for one, other in zip(measured(same, joints), expected, strict=True):
            np.testing.assert_array_equal(one, other)
    assert joint_depth._measure.signatures == compiled


def test_parents_are_in_front_of_their_joints():
    assert [JOINTS[near] for near in PARENT_INDICES[1:]] == [PARENTS[joint] for joint in JOINTS[1:]]
    assert (np.arange(20) > PARENT_INDICES).all()
