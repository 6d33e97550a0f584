import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.performance.exercise import random_poses
from engine_bridge.rigging.made_rig import made_rig, make_rig, with_handles
from engine_bridge.rigging.surface_distance import distances
from solver.skinning.weights import Weights, as_matrix


@pytest.fixture(scope="module")
def made(limbed_figure):
    return make_rig(limbed_figure)


@pytest.mark.parametrize("influences", [4, 8])
def test_every_vertex_has_weights_of_a_few_joints_whose_sum_is_one(made, limbed_figure, influences):
    rig = made if influences == 4 else make_rig(limbed_figure, influences=influences)
    assert rig.weights.weights.shape == (len(limbed_figure.mesh.vertices), influences)
    assert_allclose(rig.weights.weights.astype(np.float64).sum(axis=1), 1, atol=1e-6)
    assert rig.weights.bones.max() < len(rig.skeleton.joints)
    assert rig.rms <= made.rms


def test_weights_are_near_the_reduced_models_surface_in_other_poses(made, limbed_figure):
    """The poses of another seed were not used for the fit."""
    controls, motions = random_poses(limbed_figure, 40, seed=7)
    motions = with_handles(limbed_figure, controls, motions)
    of_bones = Weights(made.weights.weights, made.skeleton.bones[made.weights.bones].astype(np.uint16))
    rms, error = distances(limbed_figure, of_bones, limbed_figure.mesh.vertices, controls, motions)
    assert rms < 0.01
    assert error < 0.1
    assert rms == pytest.approx(made.rms, rel=0.3)
    shares = as_matrix(made.weights, len(made.skeleton.joints)).toarray()
    shoulder = shares[:, made.skeleton.names.index("leftShoulder")]
    assert shoulder[limbed_figure.mesh.vertices[:, 0] < 0].sum() < 0.2 * shoulder.sum()


def test_rigs_are_the_same_each_time_and_made_once_for_clips(made, limbed_figure):
    again = make_rig(limbed_figure)
    assert_array_equal(again.weights.weights, made.weights.weights)
    assert_array_equal(again.weights.bones, made.weights.bones)
    assert made_rig(limbed_figure) is made_rig(limbed_figure)


def test_in_a_t_pose_arms_are_level_legs_are_upright_and_the_rest_pose_comes_back(limbed_figure, made):
    straight = make_rig(limbed_figure, in_t_pose=True)
    aims = {joint.name: joint.tail - joint.head for joint in straight.skeleton.joints}
    for name, aim in {"leftUpperArm": [1, 0, 0], "rightLowerArm": [-1, 0, 0], "leftUpperLeg": [0, -1, 0]}.items():
        assert_allclose(aims[name] / np.linalg.norm(aims[name]), aim, atol=1e-9)
    assert straight.rms < 1.5 * made.rms
    placed = straight.bind.vertices(limbed_figure.mesh.vertices)
    shares = as_matrix(straight.weights, len(straight.skeleton.joints)).toarray()
    elbow = straight.skeleton.names.index("leftLowerArm")
    forearm = shares[:, elbow : elbow + 2].sum(axis=1) > 0.9
    assert forearm.sum() > 10
    around = placed[forearm] - straight.skeleton.joints[elbow].head
    assert np.abs(around[:, 1:]).max() < 0.1 * limbed_figure.mesh.diagonal  # the radius of the arm
    assert around[:, 0].min() > -0.1 * limbed_figure.mesh.diagonal
