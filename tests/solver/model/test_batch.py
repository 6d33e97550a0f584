from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from solver.model import batch
from solver.model.batch import BatchBinding


@pytest.fixture(scope="module")
def frames(creature_model):
    """Control variables of seven random poses, neither smooth nor small."""
    return creature_model.rest_controls + np.random.default_rng(0).normal(
        scale=0.2, size=(7, *creature_model.rest_controls.shape)
    )


@pytest.fixture(scope="module")
def binding(creature, creature_model):
    return BatchBinding.of_solver_mesh(creature_model, creature)


def test_vertices_are_the_blend_of_those_that_they_follow_and_displacements_how_far_they_go(
    creature, creature_model, frames, surface
):
    follows = np.random.default_rng(1).integers(0, len(creature.vertices), 400)
    binding, close = BatchBinding(creature_model, creature.vertices[follows], follows), 1e-6 * creature.diagonal
    true = np.stack([surface(creature_model, creature, R)[follows] for R in frames], axis=2)
    found = binding.vertices(frames)
    assert (found.shape, found.dtype) == ((400, 3, 7), np.float32)
    assert_allclose(found, true, rtol=0, atol=close)
    moved = binding.displacements(frames - creature_model.rest_controls)
    assert_allclose(moved, true - creature.vertices[follows][:, :, None], rtol=0, atol=close)


def test_the_farthest_vertex_of_each_frame_is_found(binding, creature_model, frames):
    differences = frames - creature_model.rest_controls
    lengths = np.linalg.norm(binding.displacements(differences), axis=1)
    distance, vertex = binding.largest_displacements(differences)
    assert_array_equal(vertex, lengths.argmax(axis=0))
    assert_allclose(distance, lengths.max(axis=0), rtol=1e-6)


def test_some_of_the_vertices_move_as_all_do(binding, frames):
    chosen = np.array([7, 3, 200, 3])
    assert len(binding.only(chosen)) == 4
    assert binding.only(chosen[:0]).vertices(frames).shape == (0, 3, 7)
    assert_allclose(binding.only(chosen).vertices(frames), binding.vertices(frames)[chosen], atol=1e-6)


def test_fewer_frames_at_a_time_where_there_are_many_vertices(binding, monkeypatch):
    assert binding.batch_frames == batch.MAX_BATCH_FRAMES
    monkeypatch.setattr(batch, "MAX_BATCH_NUMBERS", 3 * len(binding) * 20)
    assert binding.batch_frames == 20
    monkeypatch.setattr(batch, "MAX_BATCH_NUMBERS", 3 * len(binding))
    assert binding.batch_frames == batch.MIN_BATCH_FRAMES


def test_places_from_the_middle_are_precise_far_from_the_origin(creature, creature_model, binding, frames):
    """Model units do not depend on the position of the mesh."""
    far = replace(creature_model, center=creature_model.center + 3000 * creature.diagonal)
    moved = BatchBinding(far, creature.vertices + 3000 * creature.diagonal, np.arange(len(creature.vertices)))
    assert_allclose(moved.displacements(frames), binding.displacements(frames), atol=1e-6 * creature.diagonal)
