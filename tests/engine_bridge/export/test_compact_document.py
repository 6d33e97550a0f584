"""Compact files of every kind of character, played by three.js and compared with the solver."""

import numpy as np
import pytest

from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings


@pytest.fixture
def distances(take, write_puppet, play, solved, assert_valid_gltf, tmp_path):
    """Convert a variant; return the summary, and the largest distance of each mesh from the solver in three.js."""

    def measure(variant, **choices):
        if choices.get("meshopt"):
            pytest.importorskip("meshoptimizer")
        puppet = write_puppet(tmp_path / "a.toml", variant.path)
        clip, summary = convert(take, puppet, tmp_path / "a.glb", Settings(**choices))
        assert_valid_gltf(tmp_path / "a.glb")
        played = play(tmp_path / "a.glb", len(clip.frames)).meshes
        follows = np.split(clip.rig.mesh.of_render, np.cumsum([len(part) for part in variant.shown])[:-1])
        expected = solved(clip)
        return summary, [
            np.linalg.norm(mesh.positions - (expected[:, of] + own), axis=-1).max() / clip.rig.mesh.diagonal
            for mesh, of, own in zip(played, follows, variant.offset, strict=True)
        ]

    return measure


def test_the_printed_error_is_that_of_the_file_in_three(variant, distances):
    summary, found = distances(variant, compact=True, meshopt=True)
    assert 0.9 * summary.error < max(found) <= summary.error + 1e-6
    assert summary.error <= summary.tolerance == 0.0005


@pytest.mark.parametrize("name", ["textured", "own_targets", "skinned"])
@pytest.mark.parametrize("form", ["morph", "frames"])
def test_integers_alone_have_the_printed_error(variants, distances, name, form):
    summary, found = distances(variants[name], compact=True, form=form)
    assert 0.9 * summary.error < max(found) <= summary.error + 1e-6
    assert summary.error <= summary.tolerance == 0.0005


@pytest.mark.parametrize("name", ["textured", "skinned"])
def test_compressed_floats_are_the_same_as_others(variants, distances, name):
    plain, shown = distances(variants[name])
    packed, same = distances(variants[name], meshopt=True)
    assert same == shown
    assert packed.bytes < plain.bytes
