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


def expected(surface, model, mesh, frames):
    return np.stack([surface(model, mesh, R) for R in frames], axis=2)


def test_vertices_are_the_blend(binding, creature, creature_model, frames, surface):
    found = binding.vertices(frames)
    assert (found.shape, found.dtype) == ((len(creature.vertices), 3, 7), np.float32)
    true = expected(surface, creature_model, creature, frames)
    assert_allclose(found, true, rtol=0, atol=1e-6 * creature.diagonal)


def test_displacements_are_how_far_vertices_go(binding, creature, creature_model, frames, surface):
    differences = frames - creature_model.rest_controls
    true = expected(surface, creature_model, creature, frames) - creature.vertices[:, :, None]
    assert_allclose(binding.displacements(differences), true, rtol=0, atol=1e-6 * creature.diagonal)


def test_the_farthest_vertex_of_each_frame_is_found(binding, creature_model, frames):
    differences = frames - creature_model.rest_controls
    lengths = np.linalg.norm(binding.displacements(differences), axis=1)
    distance, vertex = binding.largest_displacements(differences)
    assert_array_equal(vertex, lengths.argmax(axis=0))
    assert_allclose(distance, lengths.max(axis=0), rtol=1e-6)


def test_vertices_of_another_mesh_follow_those_that_they_are_told_to(creature, creature_model, frames, surface):
    follows = np.random.default_rng(1).integers(0, len(creature.vertices), 400)
    found = BatchBinding(creature_model, creature.vertices[follows], follows).vertices(frames)
    true = expected(surface, creature_model, creature, frames)[follows]
    assert_allclose(found, true, rtol=0, atol=1e-6 * creature.diagonal)


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


def test_places_from_the_middle_are_precise_far_from_the_origin(creature, creature_model, creature_handles, frames):
    """Model units do not depend on the position of the mesh."""
    far = replace(creature_model, center=creature_model.center + 3000 * creature.diagonal)
    moved = BatchBinding(far, creature.vertices + 3000 * creature.diagonal, np.arange(len(creature.vertices)))
    here = BatchBinding.of_solver_mesh(creature_model, creature)
    assert_allclose(moved.displacements(frames), here.displacements(frames), atol=1e-6 * creature.diagonal)
