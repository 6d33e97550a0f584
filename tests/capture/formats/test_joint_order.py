"""Joints in an unknown order are told by the bones between them, or not at all."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from scipy.spatial.transform import Rotation

from capture.formats.joint_order import names_by_shape
from capture.skeleton import JOINT_INDEX, JOINTS, LIMBS

from .people import moving

TOLD = [joint for limb, joints in LIMBS.items() if limb != "trunk" for joint in joints]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("turn", [[0, 0, 0], [90, 0, 0], [10, 20, 160]])
def test_the_order_and_the_axes_of_joints_do_not_matter(seed, turn):
    rng = np.random.default_rng(seed)
    points = np.concatenate([moving(), moving()[:, :1]], axis=1) @ Rotation.from_euler("xyz", turn, True).as_matrix().T
    order = rng.permutation(points.shape[1])
    names = names_by_shape(1000 * points[:, order])
    told = {name: points[:, joint] for name, joint in zip(names, order, strict=True) if name}
    assert told.keys() == {*TOLD, "head"}
    for joint in told:
        assert_array_equal(told[joint], points[:, JOINT_INDEX[joint]])


def test_what_is_in_doubt_is_not_told():
    points = moving()
    assert names_by_shape(points[:5]) == []  # few frames
    assert names_by_shape(points[:1].repeat(40, axis=0)[:, [JOINT_INDEX[joint] for joint in JOINTS[:16]]]) == []
    assert names_by_shape(points + np.random.default_rng(0).normal(0, 0.1, points.shape)) == []
    assert names_by_shape(np.random.default_rng(0).normal(size=points.shape)) == []
    assert names_by_shape(np.ones((25, 21, 3))) == []
