"""Scenes that threads load, and that are kept in files of the user's folder, so that they are not transmitted again."""

import json

import pytest

from .resident import Godot


@pytest.fixture
def show(project, start_godot, stage, tmp_path, monkeypatch):
    """Show the stand-in's character in a new process of one user; return the number of scenes that were requested."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "user"))

    def run():
        stage.is_playing, before = True, stage.scenes
        orders = tmp_path / "orders"
        script = start_godot("watch_puppet.gd", json.dumps([{"port": stage.port}]), orders)
        script.until(lambda told: told.get("visible") == [True])
        script.end()
        return stage.scenes - before

    return run


def kept(folder):
    return {path.name: path.read_bytes() for path in folder.rglob("user/**/scenes/*")}


def test_a_scene_is_requested_once_by_all_processes_of_a_user(show, stage, tmp_path):
    stage.listed["digest"] = stage.character.digest
    assert show() == 1
    assert list(kept(tmp_path)) == [f"{stage.character.digest}.scene"]
    assert show() == 0


def test_a_damaged_file_is_replaced(show, stage, tmp_path):
    stage.listed["digest"] = stage.character.digest
    show()
    whole = kept(tmp_path)
    [path] = tmp_path.rglob("user/**/scenes/*")
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert show() == 1
    assert kept(tmp_path) == whole


def test_a_service_that_announces_no_digest_is_asked_each_time(show):
    assert [show(), show()] == [1, 1]


@pytest.mark.parametrize("digest", ["../" * 20 + "etc/passwd", "0" * 63, "g" * 64, 7, None])
def test_a_digest_that_is_none_is_no_path(show, stage, tmp_path, digest):
    stage.listed["digest"] = digest
    assert show() == 1
    assert list(kept(tmp_path)) == [f"{stage.character.digest}.scene"]


def test_the_end_of_the_program_waits_for_a_thread_that_loads(godot, project):
    game = Godot(godot, "--headless", "--path", project, "-s", "res://tests/quit_while_loading.gd")
    game.finish()
    assert "loaded" in game.lines
