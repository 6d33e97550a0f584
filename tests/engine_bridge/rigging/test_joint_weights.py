import numpy as np
from numpy.testing import assert_allclose

from engine_bridge.rigging.joint_weights import joint_weights
from engine_bridge.rigging.joints import Joint
from solver.skinning.weights import Weights, as_matrix


def joint(name, bone, head, tail):
    return Joint(name, -1, bone, np.array(head, dtype=np.float64), np.array(tail, dtype=np.float64))


CHAIN = (
    joint("hips", 0, (0, 0, 0), (0, 1, 0)),
    joint("spine", 1, (0, 1, 0), (0, 2, 0)),
    joint("chest", 1, (0, 2, 0), (0, 3, 0)),
)


def weights(rows, bones):
    return Weights(np.array(rows, dtype=np.float32), np.array(bones, dtype=np.uint16))


def test_joints_of_one_bone_share_its_weight_by_nearness():
    points = np.array([[1, 0.5, 0], [1, 1.2, 0], [1, 2, 0], [1, 2.8, 0]], dtype=np.float64)
    found = as_matrix(joint_weights(weights([[1, 0, 0, 0]] * 4, [[1, 0, 0, 0]] * 4), CHAIN, points), 3).toarray()
    assert (found[:, 0] == 0).all()
    assert_allclose(found.sum(axis=1), 1, atol=1e-7)
    assert (np.diff(found[:, 2]) > 0).all()
    assert_allclose(found[2, 1:], [0.5, 0.5], atol=1e-7)
    away = (1 + 0.8**2) ** 2  # the fourth power of the distance of the second point from the chest
    assert_allclose(found[1, 1], away / (1 + away), atol=1e-6)


def test_the_sum_of_the_joints_of_a_bone_is_its_weight_however_few_are_kept():
    rng = np.random.default_rng(0)
    joints = tuple(joint(f"j{k}", k // 3, rng.normal(size=3), rng.normal(size=3)) for k in range(12))
    shares = np.sort(rng.dirichlet(np.ones(4), 200), axis=1)[:, ::-1]
    bones = np.array([rng.permutation(4) for _ in range(200)])
    found = joint_weights(weights(shares, bones), joints, rng.normal(size=(200, 3)))
    assert found.weights.shape == (200, 4)
    of_bones = as_matrix(found, 12).toarray().reshape(200, 4, 3).sum(axis=2)
    assert_allclose(of_bones, as_matrix(weights(shares, bones), 4).toarray(), atol=1e-6)
