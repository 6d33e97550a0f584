"""The clocks of a Puppet3D: the engine's, with movies, pauses and slow motion, and a manual one."""

import hashlib
import json

import numpy as np
import pytest

from .resident import Godot

IMAGES = 45


def write_movie(screen, godot, project, folder, stage, slowness):
    """Write a movie; return what each image shows, and the hashes of the images."""
    folder.mkdir()
    stage.is_playing = True
    movie = ["--write-movie", folder / "image.png", "--fixed-fps", 30, "--resolution", "160x120"]
    renderer = ["--rendering-driver", "opengl3", "--audio-driver", "Dummy", "-s", "res://tests/movie.gd"]
    process = Godot(*screen("640x480"), godot, "--path", project, *movie, *renderer, "--", stage.port, IMAGES, slowness)
    try:
        process.finish(300)
    finally:
        process.kill()
    told = [json.loads(line.removeprefix("RESULT ")) for line in process.lines if line.startswith("RESULT ")]
    images = sorted(folder.glob("*.png"))[:IMAGES]
    return told, [hashlib.sha256(image.read_bytes()).hexdigest() for image in images]


@pytest.mark.slow
def test_a_movie_has_every_frame_once_however_long_an_image_takes(
    screen, godot, imported_project, new_stage, danced, tmp_path
):
    quick, images = write_movie(screen, godot, imported_project, tmp_path / "quick", new_stage(danced), 0)
    slow, same = write_movie(screen, godot, imported_project, tmp_path / "slow", new_stage(danced), 100)
    for told in quick, slow:
        played = [(1 - each["share"]) * each["sequence"] + each["share"] * each["next_sequence"] for each in told]
        assert played == pytest.approx(list(range(1, IMAGES + 1)), abs=1e-3)
    assert images == same
    assert len(set(images)) == IMAGES


@pytest.fixture
def play_clock(start_godot, stage):
    """Return the frames played, the clock and the engine's time in each phase."""

    def play(name):
        stage.is_playing, phases = True, {}
        for each in start_godot("clock.gd", stage.port, name).finish():
            phases.setdefault(each["phase"], []).append([each["played"], each["time"], each["passed"]])
        return {name: np.array(values) for name, values in phases.items()}

    return play


def test_the_engines_clock_is_scaled_and_paused(play_clock):
    phases = play_clock("engine")
    for name in ("full", "half"):
        played, _, passed = phases[name][10:-1].T
        assert (played[-1] - played[0]) / 30 == pytest.approx(passed[-1] - passed[0], rel=0.06)  # it catches up by 5 %
    assert np.ptp(phases["paused"][2:, 0]) == 0.0
    assert phases["again"][3, 0] - phases["paused"][-1, 0] < 5.0  # it goes on where it was
    assert (np.diff(np.concatenate([phases[name][:, 0] for name in phases])) >= 0.0).all()


def test_a_manual_clock_moves_by_what_it_is_advanced(play_clock):
    played, time, _ = play_clock("manual")["manual"].T
    assert played == pytest.approx(1 + 30 * time, abs=1e-3)
