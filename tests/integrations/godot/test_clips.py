"""Clips in Godot, without a service: compared with the solver's vertices."""

import base64
import shutil

import numpy as np
import pytest

from engine_bridge.performance.clip import load_timeline, solve
from engine_bridge.performance.rig import load_rig
from engine_bridge.performance.settings import Settings
from engine_bridge.service.clip_export import write_clip
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units

FRAMES = (0, 7, 30, 57)


@pytest.fixture(scope="module")
def clip(take, blob_puppet, tmp_path_factory):
    path = tmp_path_factory.mktemp("clips") / "dance.clip"
    write_clip(take, blob_puppet, path, "dancer", Settings())
    return path


@pytest.fixture(scope="module")
def solved(take, blob_puppet):
    """The vertices of all frames, and the diagonal."""
    rig = load_rig(blob_puppet)
    timeline, _ = load_timeline(take, Settings())
    (frames,) = solve(rig, timeline, Settings(), 1000)
    binding = Binding(rig.model, rig.character.vertices, rig.mesh.of_render)
    vertices = [
        binding.vertices(to_file_units(R, rig.model)) + root for R, root in zip(frames.R, frames.root, strict=True)
    ]
    return np.array(vertices), rig.mesh.diagonal


def positions(told):
    return [np.frombuffer(base64.b64decode(each["positions"]), "<f4").reshape(-1, 3) for each in told]


def test_frames_are_those_of_the_solver_and_in_between_their_mean(run_godot, clip, solved):
    vertices, diagonal = solved
    half = (FRAMES[1] + 0.5) / 30
    head, *told = run_godot("play_clip.gd", clip, *(number / 30 for number in FRAMES), half)
    assert head == {"problem": "", "length": pytest.approx(57 / 30), "character": "dancer"}
    *shown, between = positions(told)
    for number, found in zip(FRAMES, shown, strict=True):
        assert np.abs(found - vertices[number]).max() <= 1e-5 * diagonal
    assert np.abs(between - vertices[[FRAMES[1], FRAMES[1] + 1]].mean(axis=0)).max() <= 1e-5 * diagonal


def test_seeking_twice_shows_the_same_bytes(run_godot, clip):
    _, first, _, again = run_godot("play_clip.gd", clip, 0.73, 1.5, 0.73)
    assert first["positions"] == again["positions"]


def test_an_animation_player_moves_it(run_godot, clip, solved):
    _, *plain = run_godot("play_clip.gd", clip, 0.5, 1.25)
    _, *animated = run_godot("play_clip.gd", clip, "animated", 0.5, 1.25)
    assert [each["at"] for each in animated] == pytest.approx([0.5, 1.25])
    np.testing.assert_allclose(positions(animated), positions(plain), rtol=0, atol=1e-5 * solved[1])


def test_it_plays_by_itself_and_begins_again(run_godot, clip):
    head, *told = run_godot("play_clip.gd", clip, "alone:200", timeout=120)
    places = [each["position"] for each in told]
    assert all(0 <= place < head["length"] for place in places)
    steps = np.diff(places)
    forward = steps[steps > 0]
    deltas = np.array([each["delta"] for each in told])
    assert len(forward) >= 190
    assert np.median(forward / deltas[1:][steps > 0]) == pytest.approx(1.0, abs=0.01)


def test_a_damaged_clip_is_a_warning(run_godot, clip, tmp_path):
    damaged = tmp_path / "damaged.clip"
    damaged.write_bytes(clip.read_bytes()[:-9])
    [head] = run_godot("play_clip.gd", damaged)
    assert head["problem"].startswith("damaged at byte")


@pytest.fixture
def imported_clip(run_editor, project, clip):
    """Import a clip into the project, as a user would with the plugin on."""
    shutil.copy(clip, project / "dance.clip")
    run_editor(120)
    return "res://dance.clip"


def test_an_exported_game_plays_an_imported_clip_without_a_service(start_godot, imported_clip, exported_game, solved):
    head, *told = start_godot("play_clip.gd", imported_clip, 1.0, game=exported_game).finish(120)
    assert head["problem"] == ""
    [found] = positions(told)
    assert np.abs(found - solved[0][30]).max() <= 1e-5 * solved[1]
