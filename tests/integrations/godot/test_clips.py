"""Clips in Godot, without a service: compared with the solver's vertices."""

import ast
import base64
import shutil

import numpy as np
import pytest

from engine_bridge.performance.settings import Settings
from engine_bridge.service.clip_export import write_clip

from ..clips import assert_near, clip_of, damaged
from ..stage import performed

FRAMES = (0, 7, 30, 57)


@pytest.fixture(scope="module")
def other(take, blob_puppet, tmp_path_factory):
    """The same motion with another calibration, which moves the character differently: a clip, and its vertices."""
    path, settings = tmp_path_factory.mktemp("clips") / "other.clip", Settings(rest_at=1.0)
    write_clip(take, blob_puppet, path, "dancer", settings)
    return path, np.array([frame.vertices_and_normals[0] for frame in performed(blob_puppet, take, settings)])


def positions(told):
    return [np.frombuffer(base64.b64decode(each["positions"]), "<f4").reshape(-1, 3) for each in told]


@pytest.fixture
def assert_shown(solved):
    return lambda told, *expected: assert_near(positions(told), expected, solved)


def test_frames_are_those_of_the_solver_and_in_between_their_mean(run_godot, clip, solved, assert_shown):
    head, *told = run_godot("play_clip.gd", clip, *(number / 30 for number in (*FRAMES, 7.5, 7)))
    assert head == {"problem": "", "length": pytest.approx(57 / 30), "character": "dancer"}
    assert_shown(told, *FRAMES, solved[0][[7, 8]].mean(axis=0), 7)
    assert told[1]["positions"] == told[-1]["positions"]


def test_it_plays_by_itself_and_begins_again(run_godot, clip):
    head, *told = run_godot("play_clip.gd", clip, "alone:200", timeout=120)
    places = [each["position"] for each in told]
    assert all(0 <= place < head["length"] for place in places)
    steps = np.diff(places)
    forward = steps[steps > 0]
    deltas = np.array([each["delta"] for each in told])
    assert len(forward) >= 190
    assert np.median(forward / deltas[1:][steps > 0]) == pytest.approx(1.0, abs=0.01)


def test_a_damaged_clip_is_a_warning(run_godot, danced, tmp_path):
    for what, content in damaged(danced).items():
        (tmp_path / "damaged.clip").write_bytes(content)
        [head] = run_godot("play_clip.gd", tmp_path / "damaged.clip")
        assert head["problem"] or what == "another scene", what  # known by its messages only


def test_a_game_goes_on_while_a_thread_loads_a_clip(run_godot, clip, other, assert_shown):
    """Before, the node shows what it has shown; the clock MANUAL waits for no thread."""
    other_clip, (second, *_) = other
    asked = (f"clip:{clip}", f"clip:{other_clip}", f"manual:{clip}", f"mixed:{other_clip}", f"clip:{clip}")
    nothing, *told = run_godot("load_clip.gd", *asked)
    assert [each["when"] for each in (nothing, *told)] == ["first", "loaded"] * 4 + ["first"]
    assert not any(each["looks_for_service"] for each in (nothing, *told))
    assert len(positions([nothing])[0]) == 0
    assert_shown(told, 0, 0, second, 0, 0, 0, second, second)


def test_an_animation_tree_or_player_shows_the_mean_of_two_clips_or_one(run_godot, clip, other, solved, assert_shown):
    (first, diagonal), (other_clip, second) = solved, other
    moments = [(0.5, 4), (0.25, 20), (0.0, 21), (1.0, 22), (0.5, 30)]
    means = [(1 - weight) * first[number] + weight * second[number] for weight, number in moments]
    asked = (f"{weight}:{number / 30!r}" for weight, number in moments)
    head, *told = run_godot("mix_clips.gd", clip, other_clip, "tree", *asked)
    assert head == {"shared": True, "animations": ["RESET", "clip_0", "clip_1"]}
    assert_shown(told, *means)
    for mean, each in zip(means, told, strict=True):
        assert np.abs(np.array(ast.literal_eval(each["surface"])) - mean[7]).max() <= 1e-4 * diagonal
    assert np.abs(first[4] - second[4]).max() > 0.01 * diagonal
    assert_shown(run_godot("mix_clips.gd", clip, other_clip, "player", f"0:{12 / 30!r}")[1:], 12)


def test_a_performer_is_mixed_with_a_clip(run_godot, stage, danced, solved, tmp_path):
    stage.is_playing, clip = True, tmp_path / "blob.clip"
    stage.listed["digest"] = stage.character.digest  # that of the clip's scene
    clip.write_bytes(clip_of(danced))
    *told, facts = run_godot("mix_live.gd", stage.port, clip, 0.0, 1.0, 0.5, 0.25)
    only_clip, only_live, half, quarter = positions(told)
    tolerance = 1e-5 * solved[1]
    assert np.abs(only_clip - solved[0][0]).max() <= tolerance
    assert np.abs(only_live - only_clip).max() > 100 * tolerance
    assert np.abs(half - (only_clip + only_live) / 2).max() <= tolerance
    assert np.abs(quarter - (0.75 * only_clip + 0.25 * only_live)).max() <= tolerance
    assert facts["warnings"] == []
    assert facts["state"]["connected"]


def assert_recorded(played, moments, stage, sequences):
    """Compare what a recording plays at some moments with the frames that were shown then."""
    for moment, sequence, found in zip(moments, sequences, positions(played), strict=True):
        away = np.abs(found - stage.sent[sequence].vertices_and_normals[0]).max()
        assert away <= 1e-5 * stage.diagonal, moment


def test_a_recording_plays_in_a_game_without_a_service(start_godot, project, stage, request):
    """The service ends before it does."""
    stage.is_playing, path = True, "res://dance.res"
    script = start_godot("record_clip.gd", stage.port, path)
    script.until(lambda told: told.get("seconds", 0) > 2)
    stage.close()
    results = script.end()
    shown = [told for told in results if "frame" in told]
    assert {"saved": path} in results
    assert (results[-1]["problem"], results[-1]["frames"]) == ("", len(shown))
    assert results[-1]["length"] > 2
    game, shown = request.getfixturevalue("exported_game"), shown[::10]
    moments = [told["seconds"] for told in shown]
    _, *told = start_godot("play_clip.gd", path, *moments, moments[0], game=game).finish(120)
    assert told[0]["positions"] == told.pop()["positions"]
    assert_recorded(told, moments, stage, [each["frame"] for each in shown])


def test_a_recording_survives_the_end_of_its_process(start_godot, project, stage):
    stage.is_playing = True
    script = start_godot("record_clip.gd", stage.port, "res://dance.res")
    script.until(lambda told: told.get("seconds", 0) > 0.5)
    script.kill()
    length = script.results[-1]["seconds"]
    [told] = start_godot("record_clip.gd", "recover", "res://dance.res").finish()
    assert told == {"recovered": ["res://dance.res"]}
    head = start_godot("play_clip.gd", "res://dance.res").finish()[0]
    assert head["problem"] == ""
    assert head["length"] == pytest.approx(length, abs=0.05)
    assert not list(project.glob("*.part"))


@pytest.fixture
def imported_clip(run_editor, project, clip):
    """Import a clip into the project, as a user would with the plugin on."""
    shutil.copy(clip, project / "dance.clip")
    run_editor(120)
    return "res://dance.clip"


def test_an_exported_game_plays_an_imported_clip_without_a_service(
    start_godot, imported_clip, exported_game, assert_shown
):
    head, *told = start_godot("play_clip.gd", imported_clip, 1.0, game=exported_game).finish(120)
    assert head["problem"] == ""
    assert_shown(told, 30)
