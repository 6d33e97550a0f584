from dataclasses import replace

import numpy as np
import pytest

from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.scene import StreamedCharacter
from solver.motion.deformer import to_file_units
from solver.surface.tangents import tangents


@pytest.fixture
def dog(blob_rig):
    return StreamedCharacter("dog", blob_rig, 1)


@pytest.fixture
def frame(dog):
    model = dog.rig.model
    R = model.rest_controls + 0.01 * np.random.default_rng(2).normal(size=model.rest_controls.shape)
    return Frame(dog, 1, 0.0, 0, "waiting", None, R, np.array([1.0, 2, 3]), dog.rig.puppet.handle_positions)


def test_a_frame_is_made_of_the_solvers_transforms_moved_by_the_root(frame):
    expected = to_file_units(frame.R, frame.character.rig.model)
    expected[:, :, 3] += np.array([1, 2, 3], dtype=np.float32)
    np.testing.assert_array_equal(frame.controls, expected)


def test_everything_is_made_once(frame):
    assert frame.controls is frame.controls
    assert frame.vertices_and_normals is frame.vertices_and_normals


def test_vertices_are_the_bindings(frame):
    positions, normals = frame.character.binding.vertices_and_normals(frame.controls)
    np.testing.assert_array_equal(frame.vertices_and_normals, [positions, normals])
    assert frame.vertices_and_normals.flags.c_contiguous


def test_normals_are_rounded_as_clients_get_them_so_that_tangents_are_the_same_to_the_bit(dog):
    np.testing.assert_array_equal(dog.normals, dog.normals.astype(np.float32))
    np.testing.assert_array_equal(tangents(dog.normals), tangents(dog.normals.astype(np.float32).astype(np.float64)))


def test_prepared_means_that_nothing_is_left_to_wait_for(dog):
    dog.prepare()
    assert {"binding", "scene", "normals", "rest", "triangles"} <= set(vars(dog))
    assert not {"binding", "scene"} & set(vars(replace(dog, revision=2)))
