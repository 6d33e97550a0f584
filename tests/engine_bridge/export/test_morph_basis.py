import numpy as np
import pytest

from engine_bridge.export import morph_basis
from engine_bridge.export.convert import write
from engine_bridge.performance.settings import Settings
from solver.model.batch import BatchBinding

from .conftest import Raw, solved, solved_places


@pytest.fixture(scope="module")
def clip(blob_file, write_puppet, clip_of):
    return clip_of(write_puppet(blob_file.with_name("morph.toml"), blob_file.name, root=False))


@pytest.mark.parametrize("count", [2, 3, 5, 8])
def test_no_basis_of_that_size_is_closer(clip, tmp_path, count):
    """The bound of Eckart and Young has one direction fewer than targets, because the last target handles signs."""
    summary = write(clip, tmp_path / "a.glb", "clip", Settings(targets=count, tolerance=1e-9), lambda *_: None)
    assert summary.targets == count
    mesh, moved, made = clip.motion.prepared.mesh, solved(clip), Raw(tmp_path / "a.glb")
    weights, (primitive,) = made.weights(0), made.file.meshes[0].primitives
    assert (weights.min(), weights.max()) == (0, 1)
    targets = np.array([made.array(target["POSITION"]) for target in primitive.targets], dtype=np.float64)
    positions = made.array(primitive.attributes.POSITION) + np.tensordot(weights, targets, axes=1)
    order = np.unique(mesh.of_render, return_index=True)[1]
    least = np.linalg.svd((moved - mesh.vertices).reshape(len(moved), -1), compute_uv=False)[count - 1 :]
    assert np.linalg.norm(positions[:, order] - moved) == pytest.approx(np.linalg.norm(least), rel=0.01)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5])
def test_the_fewest_targets_within_the_tolerance_are_taken(clip, tmp_path, tolerance):
    def made(**settings):
        return write(clip, tmp_path / "a.glb", "clip", Settings(**settings), lambda *_: None)

    summary = made(tolerance=tolerance)
    assert summary.error <= tolerance
    assert made(targets=summary.targets - 1, tolerance=1e-9).error > tolerance


def test_the_spike_of_a_single_frame_and_vertex_is_not_missed(clip, monkeypatch):
    """The error is measured for all frames and vertices, not only for those of the estimate."""
    monkeypatch.setattr(morph_basis, "SAMPLE_SIZE", 3)
    prepared, frames = clip.motion.prepared, clip.motion.R[:].copy()
    binding = BatchBinding.of_solver_mesh(prepared.model, prepared.mesh)
    frames[17, 40:44] += 0.05
    basis = morph_basis.fit(prepared.model, binding, frames, tolerance=2e-4)
    targets = basis.targets(binding).astype(np.float64)
    played = prepared.mesh.vertices + np.tensordot(basis.weights.astype(np.float64), targets, axes=1)
    largest = np.linalg.norm(played - solved_places(prepared, frames), axis=-1).max()
    assert largest <= 2e-4 * prepared.mesh.diagonal
    assert basis.error == pytest.approx(largest, rel=1e-2)
