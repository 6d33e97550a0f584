import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import load_character
from engine_bridge.export.normals import TurningNormals, smooth_normals
from solver.model.reduced_model import build


@pytest.fixture(scope="module")
def character(variants):
    return load_character(variants["textured"].path)


@pytest.fixture(scope="module")
def mesh(character):
    return character.solver_mesh()


@pytest.fixture(scope="module")
def model(mesh):
    return build(mesh)


@pytest.fixture(scope="module")
def turning(character, mesh, model):
    return TurningNormals(character, mesh, model)


@pytest.mark.parametrize("size", [1, 1e-15, 1e15])
def test_smooth_normals_are_libigls_whatever_the_size(mesh, size):
    rng = np.random.default_rng(0)
    poses = [mesh.vertices + 0.02 * mesh.diagonal * rng.normal(size=mesh.vertices.shape) for _ in range(5)]
    positions = (size * np.stack(poses, axis=2)).astype(np.float32)
    found = smooth_normals(positions, mesh.faces.astype(np.int32), np.float32(1 / mesh.diagonal / size))
    for number, pose in enumerate(poses):
        true = igl.per_vertex_normals(pose.astype(np.float32).astype(np.float64), mesh.faces)
        assert_allclose(found[:, :, number], true, atol=2e-5)
    needle = np.float32([[0, 0, 0], [1, 0, 0], [2, 0, 0]])[:, :, None]
    assert_array_equal(smooth_normals(needle, np.int32([[0, 1, 2]]), np.float32(1)), 0)


def test_normals_turn_with_a_character_that_turns_as_a_whole(turning, character, mesh, model):
    assert_allclose(turning.displacements(model.rest_controls[None]), 0, atol=2e-6)
    turns = [Rotation.from_rotvec(axis).as_matrix() for axis in ([0.3, -0.9, 0.4], [0, 2.5, 0])]
    frames = np.array([np.tile(np.vstack([turn.T, np.zeros(3)]), (len(model.A) // 4, 1)) for turn in turns])
    moved = turning.displacements(frames)
    normals = np.concatenate([part.normals for part in character.parts])
    smooth = igl.per_vertex_normals(mesh.vertices, mesh.faces)[mesh.of_render]
    for number, turn in enumerate(turns):
        # the smallest turn of the surface's normal: the whole turn where the two normals are one
        same = np.einsum("nc,nc->n", normals, smooth) > 1 - 1e-9
        assert same.mean() > 0.3
        assert_allclose((normals + moved[:, :, number])[same], (normals @ turn.T)[same], atol=1e-4)
        assert_allclose(np.linalg.norm(normals + moved[:, :, number], axis=1), 1, atol=1e-5)
