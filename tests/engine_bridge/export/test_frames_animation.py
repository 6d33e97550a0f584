import json
from pathlib import Path

import igl
import numpy as np
import pytest

from engine_bridge.character.character import load_character
from engine_bridge.export import frames_animation
from engine_bridge.export.convert import convert
from engine_bridge.export.frames_animation import check_size
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError

PER_STEP = 3


@pytest.fixture(scope="module")
def caches(variants, take, write_puppet):
    """Some variants as vertex caches: the variant, the clip and the summary."""

    def make(name):
        variant = variants[name]
        puppet = write_puppet(variant.path.with_name(f"{name}_frames.toml"), variant.path.name)
        return variant, *convert(take, puppet, variant.path.with_name(f"{name}_frames.glb"), Settings(form="frames"))

    return {name: make(name) for name in ("textured", "node_transforms", "own_targets", "skinned", "with_lines")}


def test_the_khronos_validator_has_nothing_against_any(caches, node):
    reports = json.loads(node("validate.mjs", *[summary.output for _, _, summary in caches.values()]))
    for path, report in reports.items():
        assert (report["errors"], report["warnings"]) == (0, 0), (path, report["messages"])


@pytest.mark.parametrize("name", ["textured", "node_transforms", "own_targets", "skinned"])
def test_three_plays_each_keyframe_as_solved_and_straight_lines_between(caches, play, solved, name):
    variant, clip, summary = caches[name]
    moved = solved(clip)
    expected = np.empty((39, *moved.shape[1:]))
    expected[::2], expected[1::2] = moved[::PER_STEP], (moved[1::PER_STEP] + moved[2::PER_STEP]) / 2
    counts = [len(part.vertices) for part in clip.rig.character.parts]
    follows = np.split(clip.rig.mesh.of_render, np.cumsum(counts)[:-1])
    for mesh, of, own in zip(play(Path(summary.output), 39).meshes, follows, variant.offset, strict=True):
        assert np.abs(mesh.positions - expected[:, of] - own).max() < 3e-6 * clip.rig.mesh.diagonal


def test_normals_at_a_keyframe_are_those_of_the_moved_surface(caches, play, solved):
    _, clip, summary = caches["textured"]
    mesh = clip.rig.mesh
    (seen,) = play(Path(summary.output), 20).meshes
    true = np.array([igl.per_vertex_normals(frame, mesh.faces)[mesh.of_render] for frame in solved(clip)[::PER_STEP]])
    angles = np.degrees(np.arccos(np.clip(np.einsum("fvc,fvc->fv", seen.normals, true), -1, 1)))
    assert np.percentile(angles, 99) < 0.1


def test_one_target_is_in_at_a_keyframe(caches, raw):
    _, clip, summary = caches["own_targets"]
    weights = raw(summary.output).weights(0)
    np.testing.assert_array_equal(weights, np.column_stack([np.full(58, 0.25), np.zeros(58), np.eye(58)]))
    assert summary.targets == len(clip.frames) == 58


def test_a_cache_that_no_player_could_hold_is_refused_with_a_rate_that_fits(blob_file, tmp_path, monkeypatch):
    character = load_character(blob_file)
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", 5_000_000)
    check_size(tmp_path / "out.glb", character, 100, 30)
    with pytest.raises(OutputError, match=r"Use --fps (\d+(\.\d)?), or use --as morph") as refused:
        check_size(tmp_path / "out.glb", character, 1000, 30)
    slower = float(str(refused.value).partition("--fps ")[2].partition(",")[0])
    check_size(tmp_path / "out.glb", character, int(1000 * slower / 30), slower)
    with pytest.raises(OutputError):
        check_size(tmp_path / "out.glb", character, int(1000 * (slower + 0.3) / 30), slower + 0.3)


def test_the_size_that_is_reckoned_with_is_that_of_the_file(caches, monkeypatch):
    _, clip, summary = caches["textured"]
    arguments = Path(summary.output), clip.rig.character, len(clip.frames), 30
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", int(summary.bytes * 1.1))
    check_size(*arguments)
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", int(summary.bytes * 0.9))
    with pytest.raises(OutputError):
        check_size(*arguments)


def test_a_vertex_cache_that_is_refused_computes_no_frame(blob_puppet, take, tmp_path, monkeypatch):
    monkeypatch.setattr(frames_animation, "MAX_CACHE_BYTES", 1_000_000)
    stages = []
    with pytest.raises(OutputError):
        convert(take, blob_puppet, tmp_path / "out.glb", Settings(form="frames"), lambda stage, _: stages.append(stage))
    assert set(stages) == {"Preparing the character"}
    assert not (tmp_path / "out.glb").exists()
