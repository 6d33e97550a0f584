"""A family's film as one story in a browser: two characters, one performer who speaks, two takes, a cut, the film."""

import json
import shutil
import tomllib

import numpy as np
import pytest

from engine_bridge.film import scene as scenes
from engine_bridge.film.film import make_video
from engine_bridge.film.production import produce

from ..film.conftest import quiet
from .page_driver import TIMEOUT_SECONDS, running

pytestmark = pytest.mark.slow

SIZE = (320, 180)

SCENE = f"""
[film]
size = {list(SIZE)}  # small
[floor]
show = false
[background]
color = "black"
[[character]]
name = "first"
puppet = "characters/first/live.toml"
position = [-1.3, 0.0]
height = 1.5
[[character]]
name = "second"
puppet = "characters/second/live.toml"
position = [1.3, 0.0]
height = 1.5
"""


@pytest.fixture(scope="module")
def studio(limbed_puppet, tmp_path_factory):
    """A studio with two figures, a webcam, and a small film without takes."""
    folder, characters = tmp_path_factory.mktemp("studio"), []
    for name in ("first", "second"):
        own = folder / "characters" / name
        own.mkdir(parents=True)
        mesh = tomllib.loads(limbed_puppet.read_text())["character"]["mesh"]
        shutil.copy(limbed_puppet.parent / mesh, own / mesh)
        for file in (f"{name}.toml", "live.toml"):
            shutil.copy(limbed_puppet, own / file)
        characters.append({"name": name, "title": name, "saved_file": str(own / f"{name}.toml")})
    source = {"kind": "live", "name": "camera:0"}
    (folder / "session.json").write_text(json.dumps({"source": source, "characters": characters}))
    (folder / "film.toml").write_text(SCENE)
    with running(folder) as running_studio:
        yield running_studio


@pytest.fixture(scope="module")
def window(studio, browser):
    opened = studio.open(browser, face="film")
    opened.until("state.server?.characters.length === 2 && studio.viewer.shown('first')?.moment")
    yield opened
    opened.close()


@pytest.fixture(scope="module")
def film(studio, window, tmp_path_factory):
    """Play the story; return the path of the film, which the page has shown and saved."""
    window.button("Microphone").click()
    window.until("state.server.microphone")
    window.idle()
    window.page.locator(".card", has_text="First").click()
    take(window)
    window.button("Second").click()
    window.page.locator(".overlay").focus()
    window.page.keyboard.press("r")
    playing = window.until("state.server.recording && !state.count && state.server.timeline?.takes")
    assert [each["character"] for each in playing] == ["first"]
    window.until("document.querySelector('.recording-frame')?.checkVisibility()")
    width = "document.querySelector('.growing').getBoundingClientRect().width"
    first = window.page.evaluate(width)
    window.frames(75)
    assert window.page.evaluate(width) > first
    window.page.keyboard.press("r")
    window.until("state.film.present.takes.length === 2 && state.server.takes.every(({ wave }) => wave !== '')")
    window.idle()

    edge = window.page.locator(".clip").nth(1).locator(".edge.end").bounding_box()
    start = edge["x"] + edge["width"] / 2, edge["y"] + edge["height"] / 2
    stop = window.state("film.present.takes")[1]["stop"]
    window.drag(start, (start[0] - 40, start[1]))
    window.until(f"state.film.present.takes[1].stop < {stop} - 0.2")
    window.idle()
    window.page.locator(".overlay").focus()
    window.page.keyboard.press("Space")
    window.until("state.server.timeline?.takes.length === 2")

    window.button("Make the film").click()
    video = window.page.locator("video")
    video.wait_for(timeout=1000 * TIMEOUT_SECONDS)
    window.until("document.querySelector('video').currentTime > 0.3")
    assert video.evaluate("each => [each.videoWidth, each.videoHeight]") == list(SIZE)
    saved = window.save(window.button("Save the film").click, tmp_path_factory.mktemp("saved") / "film.mp4")
    assert "# small" in (studio.folder / "film.toml").read_text()
    return saved


def test_characters_stand_in_the_view_as_in_the_film(window):
    window.until("Object.keys(state.portraits).length === 2")
    for name, side in (("first", -1.3), ("second", 1.3)):
        low, high = ([corner[axis] for axis in "xyz"] for corner in window.page.evaluate("studio.viewer.boxes()")[name])
        np.testing.assert_allclose([low[1], high[1], (low[0] + high[0]) / 2], [0, 1.5, side], atol=0.05)


def take(window):
    """Record a take of the character that is shown."""
    window.until("state.server.characters.find(({ name }) => name === state.character).state === 'performing'")
    count = len(window.state("film.present.takes"))
    window.button("Record").click()
    window.until("state.server.recording && !state.count")
    window.frames(90)
    window.button("Stop recording").click()
    window.until(f"state.film.present.takes.length === {count + 1}")
    window.idle()


def test_the_film_is_that_of_the_scene_file_with_both_takes_and_their_sounds(studio, film, tmp_path):
    path = studio.folder / "film.toml"
    production = produce(path, scenes.load(path), quiet)
    assert [actor.end > 0 for actor in production.actors] == [True, True]
    assert len(production.sounds) == 2
    make_video(path, tmp_path / "own.mp4", 0.0, None, False, quiet)
    assert film.read_bytes() == (tmp_path / "own.mp4").read_bytes()
