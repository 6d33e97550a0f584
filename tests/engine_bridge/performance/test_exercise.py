from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from engine_bridge.performance.character_motion import make_deformer
from engine_bridge.performance.exercise import exercise
from engine_bridge.performance.retargeting import fit_sizes
from engine_bridge.puppet.puppet import RetargetTable


def handles_of(prepared, rest):
    """Displacements (F, h, 3) of the handles in each frame of the exercise, mesh units."""
    R = np.concatenate(list(exercise(prepared, rest, 64))).astype(np.float64)
    deformer = make_deformer(prepared)
    rows = prepared.model.rows(prepared.mesh, deformer.handles)
    return np.einsum("hj,fjx->fhx", rows, R - prepared.model.rest_controls) * prepared.mesh.diagonal


def test_an_exercise_does_not_depend_on_the_number_of_frames_at_a_time(prepared_blob, standing):
    all_at_once = np.concatenate(list(exercise(prepared_blob, standing, 10_000)))
    np.testing.assert_array_equal(np.concatenate(list(exercise(prepared_blob, standing, 7))), all_at_once)


def test_each_handle_goes_alone_and_with_all_nearly_to_the_end_of_its_reach_and_never_beyond(prepared_blob, standing):
    """With an automatic scale, handles have a reach."""
    free = prepared_blob.puppet.model_copy(update={"retarget": RetargetTable()})
    free_rig = replace(prepared_blob, puppet=free)
    fit = fit_sizes(free_rig.puppet, make_deformer(free_rig), free_rig.mesh, standing)
    moved, diagonal = handles_of(free_rig, standing), free_rig.mesh.diagonal
    own = moved / free_rig.puppet.mapping.gain[:, None]
    share = (own / np.where(own < 0, fit.reach[..., 0], fit.reach[..., 1]))[:, :3]
    assert np.linalg.norm(share, axis=-1).max() < 1.02  # handles are pulled, not nailed
    for handle, axes in enumerate(([0, 1, 2], [0, 1, 2], [0, 2])):  # both hands, and the head along x and z only
        for axis in axes:
            for side in (own[:, handle, axis] < 0, own[:, handle, axis] > 0):
                assert np.abs(share[side, handle, axis]).max() > 0.9
    goes = np.linalg.norm(own[:, :3], axis=-1) > 1e-3 * diagonal
    alone = {tuple(row) for row in np.eye(3, dtype=bool).tolist()}
    assert {tuple(row) for row in goes.tolist()} >= alone | {(True, True, True)}
    for still in (own[:, 3:], own[:, 2, 1]):  # feet, which no joint moves, and the head's third axis
        assert np.abs(still).max() < 0.002 * diagonal


@pytest.mark.parametrize("tall", [1.0, 1.5])
def test_with_a_scale_given_handles_go_as_far_as_the_performers_limbs_are_long(prepared_blob, standing, tall):
    """The scale is 1.3 units per metre, and the arm of 0.6 m is not limited by a reach."""
    moved = handles_of(prepared_blob, tall * standing)
    assert np.linalg.norm(moved[:, 0], axis=-1).max() == pytest.approx(1.3 * tall * (0.26 + 0.25 + 0.08), rel=0.05)


def test_bones_are_turned_alone_and_all_at_once(limbed_figure, standing):
    R = np.concatenate(list(exercise(limbed_figure, standing, 64)))
    bones = make_deformer(limbed_figure).bones
    tips = bones.tails[[3, 5]] * 0.98 + bones.heads[[3, 5]] * 0.02  # of the forearms, within the surface
    rows = limbed_figure.model.rows(limbed_figure.mesh, tips)
    moved = np.linalg.norm(np.einsum("hj,fjx->fhx", rows, R - limbed_figure.model.rest_controls), axis=2)
    assert {tuple(row) for row in (moved > 0.02).tolist()} == set(product([False, True], repeat=2))
    assert moved.max() > 0.2
