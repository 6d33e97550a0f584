import numpy as np
import pytest

from engine_bridge.export import morph_basis
from engine_bridge.export.convert import write
from engine_bridge.performance.clip import load_timeline, perform
from engine_bridge.performance.rig import load_rig
from engine_bridge.performance.settings import Settings
from solver.model.batch import BatchBinding
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units


@pytest.fixture(scope="module")
def clip(blob_file, take, write_puppet):
    rig = load_rig(write_puppet(blob_file.with_name("morph.toml"), blob_file.name, root=False))
    timeline, notes = load_timeline(take, Settings())
    return perform(rig, timeline, Settings(), notes, lambda _stage, _share: None)


@pytest.fixture(scope="module")
def moved(clip, solved):
    return solved(clip)


@pytest.fixture(scope="module")
def binding(clip):
    return BatchBinding.of_solver_mesh(clip.rig.model, clip.rig.mesh)


@pytest.fixture(scope="module")
def with_targets(clip, raw, tmp_path_factory):
    """Write the clip with K targets, and return the summary and the float64 positions in the file."""
    folder = tmp_path_factory.mktemp("targets")
    done = {}

    def make(count, tolerance=1e-9):
        if (count, tolerance) not in done:
            path = folder / f"{count}_{tolerance}.glb"
            settings = Settings(targets=count, tolerance=tolerance)
            summary = write(clip, path, "clip", settings, lambda _stage, _share: None)
            made = raw(path)
            primitive = made.file.meshes[0].primitives[0]
            targets = np.array([made.array(target["POSITION"]) for target in primitive.targets], dtype=np.float64)
            rest = made.array(primitive.attributes.POSITION).astype(np.float64)
            done[count, tolerance] = summary, rest + np.tensordot(made.weights(0), targets, axes=1)
        return done[count, tolerance]

    return make


@pytest.mark.parametrize("count", [2, 3, 5, 8])
def test_no_basis_of_that_size_is_closer_and_the_error_is_the_one_that_follows(with_targets, moved, clip, count):
    """The bound of Eckart and Young has one direction fewer than targets, because the last target handles signs."""
    displacements = (moved - clip.rig.mesh.vertices).reshape(len(moved), -1)
    least = np.sqrt((np.linalg.svd(displacements, compute_uv=False)[count - 1 :] ** 2).sum())
    summary, positions = with_targets(count)
    off = positions - moved[:, clip.rig.mesh.of_render]
    order = np.unique(clip.rig.mesh.of_render, return_index=True)[1]
    assert 0.99 * least <= np.linalg.norm(off[:, order]) <= 1.01 * least
    assert summary.targets == count
    assert np.linalg.norm(off, axis=-1).max() / clip.rig.mesh.diagonal == pytest.approx(summary.error, abs=3e-7)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-4, 1e-5])
def test_the_fewest_targets_within_the_tolerance_are_taken(with_targets, tolerance):
    summary, _ = with_targets(None, tolerance)
    assert summary.error <= tolerance
    assert with_targets(summary.targets - 1)[0].error > tolerance


def test_the_spike_of_a_single_frame_and_vertex_is_not_missed(clip, binding, monkeypatch):
    """The error is measured for all frames and vertices, not only for those of the estimate."""
    monkeypatch.setattr(morph_basis, "SAMPLE_SIZE", 3)
    frames = clip.frames[:].copy()
    frames[17, 40:44] += 0.05
    basis = morph_basis.fit(clip.rig.model, binding, frames, tolerance=2e-4)
    targets = basis.targets(binding).astype(np.float64)
    played = clip.rig.mesh.vertices + np.tensordot(basis.weights.astype(np.float64), targets, axes=1)
    one = Binding.of_solver_mesh(clip.rig.model, clip.rig.mesh)
    there = np.array([one.vertices(to_file_units(frame, clip.rig.model)) for frame in frames])
    largest = np.linalg.norm(played - there, axis=-1).max()
    assert largest <= 2e-4 * clip.rig.mesh.diagonal
    assert basis.error == pytest.approx(largest, rel=1e-2)
