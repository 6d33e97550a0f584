import shutil

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES
from scipy.spatial.transform import Rotation

from capture.timeline import resample
from engine_bridge.character.character import load_character
from engine_bridge.character.document_reader import load_document
from engine_bridge.export import bake as module
from engine_bridge.export.bake import DEFAULT_TOLERANCE, bake
from engine_bridge.export.live_basis import LiveBasis
from engine_bridge.performance.clip import load_timeline, solve
from engine_bridge.performance.exercise import exercise
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from puppetline.errors import OutputError, PuppetError, SkeletonLogError

from ..refusals import refused
from .conftest import solved_places


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("baked")


@pytest.fixture(scope="module")
def of_take(take, blob_puppet, folder):
    """A file baked from a recording, with its summary and the reported progress."""
    stages = []
    summary = bake(blob_puppet, folder / "take.glb", (take,), progress=lambda *stage: stages.append(stage))
    return summary, folder / "take.glb", stages


def performed(prepared, timeline):
    """The solver's frames (F, 4m, 3) float32 of a timeline."""
    return solve(prepared, timeline, Settings()).R[:]


def recorded(log):
    return load_timeline(log, Settings())[0]


def places_from_weights(path, prepared, weights):
    """Positions (F, N, 3) of the vertices by the file's accessors, for weights of its last targets."""
    document, placed = load_document(path), []
    for part in load_character(path).parts:
        mesh = document.gltf["meshes"][document.gltf["nodes"][part.node]["mesh"]]
        targets = mesh["primitives"][part.primitive]["targets"][-weights.shape[1] :]
        moved = np.tensordot(weights, [document.array(target["POSITION"]) for target in targets], axes=1)
        placed.append(part.vertices + moved @ part.to_world[0, :3, :3].T)
    return np.concatenate(placed, axis=1)


def live_error(path, prepared, log):
    """The largest distance of vertices by live weights of a baked file from the solver's, over the diagonal."""
    return error_of(LiveBasis.load(path, prepared), path, prepared, performed(prepared, recorded(log)))


def error_of(basis, path, prepared, frames):
    there = places_from_weights(path, prepared, np.array([basis.project(R).weights for R in frames], float))
    away = there - solved_places(prepared, frames)[:, prepared.mesh.of_render]
    return np.linalg.norm(away, axis=-1).max() / prepared.mesh.diagonal


def test_live_weights_put_vertices_where_the_solver_does_within_the_error_that_was_said(
    of_take, take, prepared_blob, assert_valid_gltf
):
    """Frames are projected one by one, and evaluated with the rest positions and targets in the file."""
    summary, path, stages = of_take
    assert_valid_gltf(path)
    basis, frames = LiveBasis.load(path, prepared_blob), performed(prepared_blob, recorded(take))
    assert error_of(basis, path, prepared_blob, frames) == pytest.approx(summary.error, abs=1e-6)
    shown = [basis.project(R) for R in frames]
    weights = np.array([each.weights for each in shown])
    assert np.sqrt(np.mean([each.residual**2 for each in shown])) == pytest.approx(summary.rms, rel=1e-3)
    assert not any(each.limited for each in shown)
    assert 0 == weights.min() < weights.max() <= 1
    assert 0 < summary.rms < summary.error <= summary.tolerance == DEFAULT_TOLERANCE
    assert (summary.output, summary.bytes, summary.frames, summary.notes) == (str(path), path.stat().st_size, 58, ())
    assert list(basis.names) == [f"motion_{index}" for index in range(summary.targets)]
    assert dict(stages) == dict.fromkeys(["Preparing the character", "Performing", "Fitting morph targets"], 1)


def test_the_roots_motion_is_in_no_target(record, standing, write_puppet, blob_file, tmp_path):
    """A performer who only walks moves the root, which leaves no motion for targets."""
    there = 0.8 * np.sin(np.arange(60) / 15)[:, None, None] * np.array([1.0, 0.0, 0.5])
    log = record(tmp_path / "walk.log", standing + there)
    puppet = write_puppet(blob_file.with_name("walks.toml"), blob_file.name, root=True)
    refused(PuppetError, bake, puppet, tmp_path / "a.glb", (log,))
    assert not (tmp_path / "a.glb").exists()
    still = write_puppet(blob_file.with_name("stays.toml"), blob_file.name, root=False)
    assert bake(still, tmp_path / "a.glb", (log,)).targets > 0


def test_two_logs_are_both_in_it_and_the_same_input_gives_the_same_bytes(
    take, record, dance, blob_puppet, prepared_blob, tmp_path
):
    logs = take, record(tmp_path / "backwards.log", dance()[::-1] * [1, 1, 1.02])
    for name in ("a.glb", "b.glb"):
        summary = bake(blob_puppet, tmp_path / name, logs, tolerance=5e-4)
    assert summary.frames == 2 * 58
    for log in logs:
        assert live_error(tmp_path / "a.glb", prepared_blob, log) <= summary.error + 1e-6 <= 5e-4 + 1e-6
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


def test_it_covers_a_performer_who_turns_round_though_none_of_the_recordings_does(
    take, limbed_puppet, limbed_figure, dance, record, tmp_path
):
    """The dance of the recording, in which the performer turns once about the hips."""
    positions = dance()
    turns = Rotation.from_rotvec(np.linspace(0, 2 * np.pi, len(positions))[:, None] * [0, 1, 0]).as_matrix()
    hips = positions[:, :1]
    turning = record(tmp_path / "turning.log", (positions - hips) @ turns.transpose(0, 2, 1) + hips)
    bake(limbed_puppet, tmp_path / "a.glb", (take,))
    assert live_error(tmp_path / "a.glb", limbed_figure, turning) < 0.01


def test_without_logs_it_covers_performances_and_handles(blob_puppet, prepared_blob, folder, assert_valid_gltf):
    path = folder / "nothing.glb"
    summary = bake(blob_puppet, path)
    assert_valid_gltf(path)
    timelines = [resample(make(), 30.0, 0.4) for make in PERFORMANCES.values()]
    motions = [performed(prepared_blob, timeline) for timeline in timelines]
    exercised = sum(map(len, exercise(prepared_blob, timelines[0].positions[0], 64)))
    assert summary.frames == sum(map(len, motions)) + exercised
    basis = LiveBasis.load(path, prepared_blob)
    for frames in motions:
        assert error_of(basis, path, prepared_blob, frames[::5]) <= summary.error + 1e-6


def test_only_the_beginning_of_a_long_motion_is_an_animation(record, dance, blob_puppet, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "SHOWN_SECONDS", 1.0)
    log = record(tmp_path / "long.log", dance(100))
    assert bake(blob_puppet, tmp_path / "a.glb", (log,)).frames == 100
    made = load_document(tmp_path / "a.glb")
    (animation,) = made.gltf["animations"]
    assert animation["name"] == "long"
    for sampler in animation["samplers"]:
        np.testing.assert_allclose(made.array(sampler["input"]), np.arange(31) / 30, rtol=1e-6)


@pytest.mark.parametrize("name", ["node_transforms", "several_primitives", "own_targets"])
def test_all_parts_take_the_same_weights_after_the_targets_that_they_have(
    name, variants, take, write_puppet, assert_valid_gltf, tmp_path
):
    puppet, output = write_puppet(tmp_path / "parts.toml", variants[name].path), tmp_path / "a.glb"
    summary = bake(puppet, output, (take,))
    assert_valid_gltf(output)
    assert live_error(output, load_prepared(puppet), take) == pytest.approx(summary.error, abs=2e-6)


def test_a_file_that_was_baked_can_be_baked_again_with_a_limit_to_its_targets(of_take, take, write_puppet, tmp_path):
    """Its extras then describe the new targets, which are the last ones."""
    shutil.copy(of_take[1], tmp_path / "again.glb")
    puppet = write_puppet(tmp_path / "again.toml", "again.glb")
    summary = bake(puppet, tmp_path / "twice.glb", (take,), targets=4)
    prepared = load_prepared(puppet)
    assert summary.targets == len(LiveBasis.load(tmp_path / "twice.glb", prepared).names) == 4
    assert live_error(tmp_path / "twice.glb", prepared, take) == pytest.approx(summary.error, abs=2e-6)
    assert summary.error > DEFAULT_TOLERANCE


def test_an_input_file_is_not_overwritten_and_a_log_that_is_none_is_named(blob_puppet, blob_file, take, tmp_path):
    content = blob_file.read_bytes()
    refused(OutputError, bake, blob_puppet, blob_file, (take,))
    assert blob_file.read_bytes() == content
    (tmp_path / "a.log").write_text("nothing of the kind\n")
    assert "a.log" in refused(SkeletonLogError, bake, blob_puppet, tmp_path / "a.glb", (tmp_path / "a.log",)).where
    assert list(tmp_path.glob("*.glb")) == []
