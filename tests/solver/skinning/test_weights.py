import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from solver.model.bones import Bones
from solver.model.reduced_model import ModelParameters, build
from solver.skinning import weights as module
from solver.skinning.weights import as_matrix, fit, packed
from solver.surface.mesh import weld

from ..shapes import box, joined, points, tube

POSES = 40


@pytest.fixture(scope="module")
def bar():
    """A bar along y with two bones, and its reduced model."""
    vertices, faces = tube(np.linspace(0, 4, 33), 0.4, 12, closed=True)
    mesh = weld(vertices[:, [1, 0, 2]], faces, "bar")
    bones = Bones(points("0 0.1 0, 0 2 0"), points("0 2 0, 0 3.9 0"), np.array([-1, 0]), np.array([0, 0]))
    return mesh, build(mesh, ModelParameters(fields=4, isolines=6), bones)


def bent(bones, seed=0):
    """Random motions (F, b, 4, 3) of a chain."""
    rng = np.random.default_rng(seed)
    motions = np.empty((POSES, len(bones), 4, 3))
    for frame in motions:
        for bone, parent in enumerate(bones.parents):
            turn = Rotation.from_rotvec(rng.uniform(-1, 1, 3)).as_matrix()
            above = np.eye(4, 3) if parent < 0 else frame[parent]
            turn = above[:3] @ turn
            place = bones.heads[bone] @ above[:3] + above[3]
            frame[bone, :3], frame[bone, 3] = turn, place - bones.heads[bone] @ turn
    return motions


def moved(model, motions, shares):
    """Controls (F, 4m, 3) that move each isoline by a mean of the motions."""
    transforms = motions.copy()
    transforms[:, :, 3] += np.einsum("i,fbij->fbj", model.center, motions[:, :, :3]) - model.center
    transforms[:, :, 3] /= float(model.diagonal)
    return np.einsum("mb,fbij->fmij", shares, transforms).reshape(len(motions), -1, 3)


def weights_of(model, mesh, controls, motions, **more):
    """Weights (n, b) of all bones."""
    return as_matrix(fit(model, mesh, controls, motions, **more), motions.shape[1]).toarray()


@pytest.fixture(scope="module")
def blended(bar):
    """Motions of the bar's bones, the means of them by which isolines move, the controls, and the weights found."""
    mesh, model = bar
    motions, share = bent(model.bones), np.linspace(0, 1, len(model.rest_controls) // 4)
    means = np.column_stack([share, 1 - share])
    controls = moved(model, motions, means)
    return motions, means, controls, weights_of(model, mesh, controls, motions)


def test_a_surface_that_is_a_blend_of_bones_has_the_weights_of_the_blend(bar, blended):
    """Isolines move by known means of two motions, so the surface is a known linear blend skin."""
    (mesh, model), (_, means, _, found) = bar, blended
    expected = model.position_matrix(mesh.vertices)[:, 3::4] @ means
    away = np.linalg.norm(mesh.vertices - model.bones.heads[1], axis=1) > 0.5  # at the joint both motions are equal
    assert_allclose(found[away], expected[away], atol=1e-3)


def test_at_most_the_allowed_number_of_bones_moves_a_vertex(bar):
    """Nine bones move alike but for noise, so that all of them have a share."""
    mesh, model = bar
    rng = np.random.default_rng(2)
    turns = Rotation.from_rotvec(rng.normal(0, 0.3, (POSES * 9, 3))).as_matrix().reshape(POSES, 9, 3, 3)
    motions = np.concatenate([turns, rng.normal(0, 0.1, (POSES, 9, 1, 3))], axis=2)
    count = len(model.rest_controls) // 4
    controls = moved(model, motions, np.full((count, 9), 1 / 9))
    for allowed in (1, 4, 8):
        found = fit(model, mesh, controls, motions, influences=allowed)
        assert found.weights.shape[1] == allowed
        assert ((found.weights > 0).sum(axis=1) == allowed).all()
        assert (np.diff(found.weights, axis=1) <= 0).all()
        assert_allclose(found.weights.astype(np.float64).sum(axis=1), 1, atol=1e-6)


def test_a_rigid_motion_of_all_poses_and_a_permutation_of_bones_change_no_weight(bar, blended):
    (mesh, model), (motions, means, controls, first) = bar, blended
    turn, shift = Rotation.from_rotvec([0.3, 1.0, -0.5]).as_matrix(), np.array([1.0, -2.0, 0.5])
    carried = motions @ turn
    carried[:, :, 3] += shift
    also = moved(model, carried, means)
    assert_allclose(weights_of(model, mesh, also, carried), first, atol=1e-5)
    swapped = weights_of(model, mesh, controls, motions[:, ::-1])
    assert_allclose(swapped[:, ::-1], first, atol=1e-6)


def test_weights_of_other_rest_positions_move_these(bar, blended):
    """The rest positions are turned, and the motions begin with the turn back."""
    (mesh, model), (motions, _, controls, first) = bar, blended
    turn = Rotation.from_rotvec([0.0, 0.0, 1.2]).as_matrix()
    after = motions.copy()
    after[:, :, :3] = turn @ motions[:, :, :3]
    again = weights_of(model, mesh, controls, after, rest=mesh.vertices @ turn.T)
    assert_allclose(again, first, atol=1e-5)


def test_a_part_that_one_bone_holds_moves_with_it_alone():
    mesh = weld(*joined(box("-0.5 0 -0.5, 0.5 2 0.5"), box("-0.5 2.05 -0.5, 0.5 4.05 0.5")))
    bones = Bones(points("0 0.1 0, 0 2.1 0"), points("0 2 0, 0 3.9 0"), np.array([-1, 0]), np.array([-1, 0]))
    model = build(mesh, ModelParameters(fields=3, isolines=4), bones)
    assert model.regions.held.all()
    motions = bent(model.bones)
    controls = moved(model, motions, np.tile([0.5, 0.5], (len(model.rest_controls) // 4, 1)))
    found = fit(model, mesh, controls, motions)
    assert_array_equal(found.weights, np.tile([1, 0, 0, 0], (len(mesh.vertices), 1)))
    assert_array_equal(found.bones[:, 0], model.regions.owner)


def test_packed_weights_are_sorted_and_bones_without_weight_are_zero():
    found = packed(np.array([[0.25, 0.0, 0.75]]), np.array([[7, 5, 3]]))
    assert_array_equal(found.weights, np.array([[0.75, 0.25, 0]], dtype=np.float32))
    assert_array_equal(found.bones, [[3, 7, 0]])


def test_a_bone_without_motion_can_hold_vertices(bar):
    mesh, model = bar
    motions = np.concatenate([np.tile(np.eye(4, 3), (POSES, 1, 1, 1)), bent(model.bones)], axis=1)
    controls = np.tile(model.rest_controls, (POSES, 1, 1))
    still = weights_of(model, mesh, controls, motions)[:, 0]
    assert still.min() > 1 - 10 * module.NEGLIGIBLE_WEIGHT
