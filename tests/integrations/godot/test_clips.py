"""Clips in Godot, without a service: compared with the solver's vertices."""

import ast
import base64
import shutil

import numpy as np
import pytest

from engine_bridge.performance.settings import Settings
from engine_bridge.service.clip_export import write_clip

from ..surface import vertices_of
from .test_modes import Listener, Reference

FRAMES = (0, 7, 30, 57)
OTHER = Settings(rest_at=1.0)


@pytest.fixture(scope="module")
def other_clip(take, blob_puppet, tmp_path_factory):
    """The same motion with another calibration, which moves the character differently."""
    path = tmp_path_factory.mktemp("clips") / "other.clip"
    write_clip(take, blob_puppet, path, "dancer", OTHER)
    return path


@pytest.fixture(scope="module")
def solved(take, blob_puppet):
    return vertices_of(take, blob_puppet, Settings())


@pytest.fixture(scope="module")
def other_solved(take, blob_puppet):
    return vertices_of(take, blob_puppet, OTHER)[0]


def positions(told):
    return [np.frombuffer(base64.b64decode(each["positions"]), "<f4").reshape(-1, 3) for each in told]


@pytest.fixture
def assert_shown(solved):
    """Compare shown positions with vertices of the solver, given by the number of a frame, or with others."""
    vertices, diagonal = solved

    def check(told, *expected):
        for found, wanted in zip(positions(told), expected, strict=True):
            wanted = vertices[wanted] if isinstance(wanted, int) else wanted
            assert np.abs(found - wanted).max() <= 1e-5 * diagonal

    return check


def test_frames_are_those_of_the_solver_and_in_between_their_mean(run_godot, clip, solved, assert_shown):
    head, *told = run_godot("play_clip.gd", clip, *(number / 30 for number in (*FRAMES, 7.5, 7)))
    assert head == {"problem": "", "length": pytest.approx(57 / 30), "character": "dancer"}
    assert_shown(told, *FRAMES, solved[0][[7, 8]].mean(axis=0), 7)
    assert told[1]["positions"] == told[-1]["positions"]


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


def test_a_game_goes_on_while_a_thread_loads_a_clip(run_godot, clip, other_clip, other_solved, assert_shown):
    """Before, the node shows what it has shown; the clock MANUAL waits for no thread."""
    asked = (f"clip:{clip}", f"clip:{other_clip}", f"manual:{clip}", f"mixed:{other_clip}", f"clip:{clip}")
    nothing, *told = run_godot("load_clip.gd", *asked)
    assert [each["when"] for each in (nothing, *told)] == ["first", "loaded"] * 4 + ["first"]
    assert not any(each["looks_for_service"] for each in (nothing, *told))
    assert len(positions([nothing])[0]) == 0
    other = other_solved[0]
    assert_shown(told, 0, 0, other, 0, 0, 0, other, other)


def test_an_animation_tree_or_player_shows_the_mean_of_two_clips_or_one(
    run_godot, clip, other_clip, solved, other_solved, assert_shown
):
    (first, diagonal), second = solved, other_solved
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


def test_a_performer_is_mixed_with_a_clip(run_godot, playing, solved, blob_puppet, take, tmp_path):
    service = playing(blob_puppet, take)
    clip = tmp_path / "blob.clip"
    write_clip(take, blob_puppet, clip, None, Settings())
    *told, facts = run_godot("mix_live.gd", service.port, clip, 0.0, 1.0, 0.5, 0.25)
    only_clip, only_live, half, quarter = positions(told)
    tolerance = 1e-5 * solved[1]
    assert np.abs(only_clip - solved[0][0]).max() <= tolerance
    assert np.abs(only_live - only_clip).max() > 100 * tolerance
    assert np.abs(half - (only_clip + only_live) / 2).max() <= tolerance
    assert np.abs(quarter - (0.75 * only_clip + 0.25 * only_live)).max() <= tolerance
    assert facts["warnings"] == []
    assert facts["state"]["connected"]


@pytest.fixture
def recorded(start_godot, project, playing, blob_puppet, take):
    """A recording of a service that was killed before its end: the result, and the vertices by moments."""
    path = "res://dance.res"
    service = playing(blob_puppet, take)
    reference = Reference(blob_puppet)
    with Listener(service, "blob", "controls") as (heard,):
        script = start_godot("record_clip.gd", service.port, path)
        script.until(lambda told: told.get("seconds", 0) > 5)
        service.process.kill()
        results = script.end()
    vertices = {
        told["seconds"]: reference.positions(heard[told["frame"]].body)
        for told in results
        if "frame" in told and told["frame"] in heard
    }
    return path, results, vertices, reference.diagonal


def test_a_recording_plays_in_a_game_without_a_service(start_godot, recorded, request):
    path, results, vertices, diagonal = recorded
    assert {"saved": path} in results
    assert results[-1]["problem"] == ""
    assert results[-1]["frames"] == sum("frame" in told for told in results)
    assert results[-1]["length"] > 5
    game = request.getfixturevalue("exported_game")
    moments = sorted(vertices)[::20]
    _, *told = start_godot("play_clip.gd", path, *moments, moments[0], game=game).finish(120)
    assert told[0]["positions"] == told[-1]["positions"]
    for moment, found in zip(moments, positions(told), strict=False):
        assert np.abs(found - vertices[moment]).max() <= 1e-5 * diagonal


def test_a_recording_survives_the_end_of_its_process(start_godot, project, playing, blob_puppet, take):
    service = playing(blob_puppet, take)
    script = start_godot("record_clip.gd", service.port, "res://dance.res")
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
