"""Films that several processes draw: the same frames as by one process, errors instead of waiting, no process left."""

import pickle
import subprocess
import sys

import numpy as np
import psutil
import pytest

from engine_bridge.film import drawing_process
from engine_bridge.film.drawing import Canvas
from engine_bridge.film.drawing_process import MODULE, processes_beside
from engine_bridge.film.film import make_video
from engine_bridge.film.scene import load
from engine_bridge.film.video import VideoWriter
from engine_bridge.pictures.gpu_renderer import GpuRenderer
from puppetline.errors import PuppetlineError

from ...waiting import wait_until
from ..refusals import refused
from .conftest import quiet

pytest.importorskip("av", reason="the extra film is not installed")

SCENE = """
[film]
size = [64, 48]
fps = 20
fade_in = 0.2

[[character]]
name = "a"
puppet = "LIMBED"

[[take]]
character = "a"
file = "TAKE"

[[title]]
text = "a"
seconds = 1

[[bubble]]
character = "a"
text = "a"
at = 0.5

[[camera]]

[[camera]]
at = 1
shot = "follow"
fade = 0.5
"""


@pytest.fixture(autouse=True)
def _opengl(opengl):
    """All tests here draw."""


@pytest.fixture
def draw_with(monkeypatch):
    """Return a function that sets the number of processes that draw, whatever the machine and the size of the film."""

    def choose(count):
        monkeypatch.setattr(drawing_process, "MIN_PIXELS", 1)
        monkeypatch.setattr(drawing_process, "processor_count", lambda: count)
        monkeypatch.setattr(GpuRenderer, "in_software", True)

    return choose


def children():
    """Return the processes that this one has started and that run. One has no command line at first."""
    return [each for each in psutil.Process().children() if MODULE in each.cmdline()]


def test_several_processes_draw_the_same_frames_as_one(write_scene, tmp_path, draw_with, monkeypatch):
    path, add, frames = write_scene(SCENE), VideoWriter.add, {1: [], 3: []}
    for count, drawn in frames.items():

        def keep(writer, pixels, sound, drawn=drawn):
            drawn.append(pixels.copy())
            add(writer, pixels, sound)

        draw_with(count)
        monkeypatch.setattr(VideoWriter, "add", keep)
        make_video(path, tmp_path / f"{count}.mp4", 0, None, False, quiet)
    assert len(frames[1]) > 10
    np.testing.assert_array_equal(np.stack(frames[3])[..., :3], np.stack(frames[1])[..., :3])


def test_a_process_that_dies_ends_the_film_with_an_error_and_leaves_nothing(write_scene, tmp_path, draw_with):
    draw_with(2)
    killed = []

    def kill(step, _share):
        if step == "Filming" and not killed:
            killed.extend(wait_until(children))
            killed[0].kill()

    path = write_scene(SCENE)
    error = refused(PuppetlineError, make_video, path, tmp_path / "film.mp4", 0, None, False, kill)
    assert "ended while it drew" in error.found
    assert {each.name for each in tmp_path.iterdir()} == {"scene.toml"}
    assert not children()


def test_an_interrupt_leaves_no_process(write_scene, tmp_path, draw_with):
    draw_with(2)
    seen = []

    def stop(_step, _share):
        seen.extend(wait_until(children))
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_video(write_scene(SCENE), tmp_path / "film.mp4", 0, None, False, stop)
    assert len(seen) == 1
    assert not children()


@pytest.mark.parametrize("added", [0, 1])
def test_a_process_ends_when_the_pipes_of_its_film_are_closed(write_scene, added):
    """The system closes them when the film's process is killed, at any time."""
    path = write_scene(SCENE)
    command = [sys.executable, "-P", "-m", MODULE]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        for message in [(load(path), path, (64, 48), 1), *[(None, [])] * added]:
            pickle.dump(message, process.stdin)
        process.stdin.close()
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait() == 0


def test_small_films_and_those_of_a_graphics_card_are_drawn_by_one_process(write_scene, monkeypatch):
    monkeypatch.setattr(drawing_process, "processor_count", lambda: 2)
    path = write_scene(SCENE)
    for size, in_software, expected in (((640, 480), True, 1), ((640, 480), False, 0), ((320, 240), True, 0)):
        monkeypatch.setattr(GpuRenderer, "in_software", in_software)
        with Canvas(load(path), path, size, 1) as canvas:
            assert processes_beside(canvas) == expected
