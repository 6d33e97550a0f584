"""Depths of joints in constructed images: a patch of skin for each joint, in front of a wall."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.skeleton import JOINT_INDEX
from capture.trackers import joint_depth
from capture.trackers.joint_depth import PARENT_INDICES, SKIN_TO_JOINT_METRES
from capture.trackers.placing import warm_up

from ..bodies import body, table
from .skin import LENS, PATCH, TRACKED_ALL, drawn, patch

ANKLE, KNEE, FOOT, WRIST, HAND = (JOINT_INDEX[f"{joint}_left"] for joint in ("ankle", "knee", "foot", "wrist", "hand"))

WAYS = table("""
spine           0 1 0
shoulder_center 0 1 0
head            0 1 0
shoulder        1 -0.1 0
elbow           1 0 0
wrist           1 0 0
hand            1 0.1 0
hip             1 -0.6 0
knee            0.2 -1 0
ankle           0 -1 0
foot            1 -1 0
""")
BODY = body(WAYS, (0.05, 0.0, 2.5), typical=True)
"""A body in the plane z = 2.5 m with the arms held out, so that no two patches of skin overlap."""
ESTIMATE = BODY[:, 2]


def changed(array, change):
    """Return an array with changed elements: {index: change}."""
    array = array.copy()
    for index, value in change.items():
        array[index] += value
    return array


@pytest.fixture(scope="module", name="measured")
def _measured(interpreted):
    """Measure the depths of joints at their true pixels; the tracker's estimate (20,) and bones have another scale."""
    return partial(measure, interpreted("capture.trackers.joint_depth"))


def measure(module, depth, joints=BODY, estimated=ESTIMATE, confidence=TRACKED_ALL, scale=1.0):
    bones = np.zeros(20)
    bones[1:] = np.linalg.norm(joints[1:] - joints[PARENT_INDICES[1:]], axis=1)
    pixels, rays = LENS.project(joints), joints / joints[:, 2:]
    return module.measure_depths(depth, LENS.focal, pixels, rays, estimated / scale, bones / scale, confidence)


@pytest.mark.parametrize(
    ("estimated", "scale"),
    [(ESTIMATE, 1.0), (ESTIMATE, 1.25), *((changed(ESTIMATE, {ANKLE: bent, FOOT: bent}), 1.0) for bent in (0.4, -0.4))],
)
def test_a_joint_is_half_its_thickness_behind_the_skin_also_of_a_limb_that_is_wrongly_estimated_as_bent(
    measured, estimated, scale
):
    depths, known, found = measured(drawn(BODY), estimated=estimated, scale=scale)
    assert known.all()
    assert_allclose(depths, ESTIMATE, atol=5e-4)
    assert found == pytest.approx(scale, abs=1e-3)


@pytest.mark.parametrize(("length", "found"), [(1.38, True), (1.42, False)])
def test_no_joint_is_farther_from_its_parent_than_1_4_bone_lengths(measured, length, found):
    ray, knee = BODY[ANKLE] / BODY[ANKLE, 2], BODY[KNEE]
    shin = np.linalg.norm(BODY[ANKLE] - knee)
    _, z = sorted(np.roots([ray @ ray, -2 * ray @ knee, knee @ knee - (length * shin) ** 2]))
    far = changed(ESTIMATE, {ANKLE: z - ESTIMATE[ANKLE]})
    depths, known, _ = measured(drawn(BODY, far - SKIN_TO_JOINT_METRES), estimated=changed(far, {ANKLE: -0.2}))
    assert known[ANKLE] == found
    assert depths[ANKLE] == pytest.approx(z if found else z - 0.2, abs=1e-3)


@pytest.mark.parametrize(("metres", "beside"), [(1.0, PATCH), (2.3, PATCH + 4)])
def test_a_joint_is_behind_the_nearest_plausible_surface_in_a_quarter_of_the_window(measured, metres, beside):
    """Another hand in front of half of the wrist, or a column at the window's edge, near enough to be the wrist."""
    depth = drawn(BODY)
    patch(depth, BODY[WRIST], metres, beside)
    depths, known, _ = measured(depth)
    assert known[WRIST]
    assert depths[WRIST] == pytest.approx(BODY[WRIST, 2], abs=5e-4)


def test_a_joint_without_depth_keeps_its_estimated_offset_from_the_parent(measured):
    depth = drawn(BODY)
    patch(depth, BODY[HAND], 0.0)
    # the wrist is wrong, as depth tells, and the hand 7 cm before it
    depths, known, scale = measured(depth, estimated=changed(ESTIMATE, {WRIST: 0.2, HAND: 0.2 - 0.07}))
    assert_array_equal(np.flatnonzero(~known), [HAND])
    assert depths[HAND] == pytest.approx(depths[WRIST] - 0.07 * scale, abs=1e-9)


def test_hidden_joints_and_joints_outside_the_image_have_no_measured_depth(measured):
    assert not measured(drawn(BODY), confidence=changed(TRACKED_ALL, {WRIST: -0.51}))[1][WRIST]
    away = changed(BODY, {HAND: [-1.0, 0, 0]})
    assert LENS.project(away[HAND])[0] >= LENS.width
    assert_array_equal(np.flatnonzero(~measured(drawn(BODY), away)[1]), [HAND])


def test_too_few_joints_with_depth_give_no_result(measured):
    depth = np.zeros((LENS.height, LENS.width), np.float32)
    assert measured(depth) is None
    for joint in range(4):
        patch(depth, BODY[joint], BODY[joint, 2])
    assert measured(depth, confidence=TRACKED_ALL * (np.arange(20) < 4)) is None


@pytest.mark.usefixtures("camera")  # which needs the compiled function
def test_arrays_of_any_layout_give_the_same_without_compiling_again(measured):
    depth = drawn(BODY)
    warm_up()
    compiled, expected = list(joint_depth._measure.signatures), measured(depth)
    locked = depth.copy()
    locked.flags.writeable = False
    for same in (locked, np.asfortranarray(depth), np.repeat(depth, 2, axis=1)[:, ::2]):
        for one, other in zip(measure(joint_depth, same), expected, strict=True):
            assert_allclose(one, other, rtol=1e-12)
    assert joint_depth._measure.signatures == compiled
