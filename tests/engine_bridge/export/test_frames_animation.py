from pathlib import Path

import numpy as np
import pytest

from engine_bridge.character.character import load_character
from engine_bridge.export import frames_animation
from engine_bridge.export.convert import convert
from engine_bridge.export.frames_animation import check_size
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError

from ..refusals import refused
from .conftest import between_keys, by_part, normal_angles

CACHED = ("textured", "node_transforms", "own_targets", "skinned", "with_lines")


@pytest.fixture(scope="module")
def caches(variants, take, write_puppet):
    """Some variants as vertex caches: the variant, the clip and the summary."""

    def make(name):
        variant = variants[name]
        puppet = write_puppet(variant.path.with_name(f"{name}_frames.toml"), variant.path.name)
        return variant, *convert(take, puppet, variant.path.with_name(f"{name}_frames.glb"), Settings(form="frames"))

    return {name: make(name) for name in CACHED}


@pytest.mark.parametrize("name", CACHED)
def test_three_plays_each_keyframe_as_solved_and_straight_lines_between(
    caches, play, solved, raw, assert_valid_gltf, name
):
    _, clip, summary = caches[name]
    assert_valid_gltf(Path(summary.output))
    expected = by_part(clip, between_keys(solved(clip)))
    for mesh, positions in zip(play(Path(summary.output), 39).meshes, expected, strict=True):
        assert np.abs(mesh.positions - positions).max() < 3e-6 * clip.rig.mesh.diagonal
    assert summary.targets == len(clip.frames) == 58
    if name == "own_targets":  # of one target after another
        weights = raw(summary.output).weights(0)
        np.testing.assert_array_equal(weights, np.column_stack([np.full(58, 0.25), np.zeros(58), np.eye(58)]))


def test_normals_at_a_keyframe_are_those_of_the_moved_surface(caches, play, solved):
    _, clip, summary = caches["textured"]
    (seen,) = play(Path(summary.output), 20).meshes
    assert np.percentile(normal_angles(seen.normals, solved(clip)[::3], clip.rig.mesh), 99) < 0.1


def test_a_cache_that_no_player_could_hold_is_refused_with_a_rate_that_fits(caches, blob_file, tmp_path, monkeypatch):
    output, character = tmp_path / "out.glb", load_character(blob_file)
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", 5_000_000)
    check_size(output, character, 100, 30)
    fix = refused(OutputError, check_size, output, character, 1000, 30).fix
    slower = float(fix.partition("--fps ")[2].partition(",")[0])
    check_size(output, character, int(1000 * slower / 30), slower)
    refused(OutputError, check_size, output, character, int(1000 * (slower + 0.3) / 30), slower + 0.3)

    _, clip, summary = caches["textured"]  # the size that is reckoned with is that of the file
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", int(summary.bytes * 1.1))
    check_size(output, clip.rig.character, len(clip.frames), 30)
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", int(summary.bytes * 0.9))
    refused(OutputError, check_size, output, clip.rig.character, len(clip.frames), 30)


def test_a_vertex_cache_that_is_refused_computes_no_frame(blob_puppet, take, tmp_path, monkeypatch):
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", 1_000_000)
    stages, output = [], tmp_path / "out.glb"
    refused(
        OutputError, convert, take, blob_puppet, output, Settings(form="frames"), lambda name, _: stages.append(name)
    )
    assert set(stages) == {"Preparing the character"}
    assert not output.exists()
