import igl
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.character.character import load_character
from engine_bridge.export.normals import smooth_normals


@pytest.fixture(scope="module")
def mesh(variants):
    return load_character(variants["textured"].path).solver_mesh()


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
