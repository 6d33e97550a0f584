"""A family's film as one story in a browser: two characters, one performer who speaks, two takes, a cut, the film."""

import json
import shutil
import tomllib

import av
import numpy as np
import pytest
from PIL import Image, ImageDraw
from puppetline.examples.performances import PERFORMANCES

from capture.formats import puppetline_log
from capture.skeleton import SkeletonFrame
from capture.sound import BLOCK_SECONDS
from engine_bridge.film import scene as scenes
from engine_bridge.film.framing import Shots
from engine_bridge.film.production import produce

from ..film.conftest import placed
from .page_driver import TIMEOUT_SECONDS, running

pytestmark = pytest.mark.slow

SIZE = (320, 180)
FPS = 30

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

MAX_OFFSET_SECONDS = 0.02
"""Maximum difference of sound and motion in the film, in seconds."""

SPOKEN_FRAMES, SPOKEN_SECONDS = 30, 0.3
"""Frames of the motion from one beginning to speak to the next, and for how long, see `virtual_camera`."""

MIN_AGREEMENT = 0.9
"""Least share of the pixels of a small figure that are drawn where its take says; edges are about a pixel wide."""

LEAST_GREY, LEAST_SOUND = 40, 0.1
"""Values above which a pixel is of a character, and the sound of the performer."""


@pytest.fixture(scope="module")
def studio(limbed_puppet, opengl, tmp_path_factory):
    """A studio with two figures whose heads nod with the voice, a webcam, and a small film without takes."""
    folder = tmp_path_factory.mktemp("studio")
    head = 'joints = ["shoulder_center", "head"]\n'
    nods = head + 'bend = { channel = "voice", degrees = 40, axis = "x" }\n'
    characters = []
    for name in ("first", "second"):
        own = folder / "characters" / name
        own.mkdir(parents=True)
        text = limbed_puppet.read_text()
        mesh = tomllib.loads(text)["character"]["mesh"]
        shutil.copy(limbed_puppet.parent / mesh, own / mesh)
        for file in (f"{name}.toml", "live.toml"):
            (own / file).write_text(text.replace(head, nods))
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
    window.frames(75)
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


def test_joints_are_drawn_over_the_picture_of_the_camera(studio, browser, window):
    opened = studio.open(browser)
    opened.button("Show what the sensor sees").click()
    picture = opened.page.locator(".sensor img")
    picture.wait_for()
    size = "each => Object.assign(new Image(), { src: each.src })"  # a copy: the page soon shows the next picture
    size += ".decode().then(() => [each.naturalWidth, each.naturalHeight])"
    assert picture.evaluate(size) == [640, 480]
    # a joint that leaves the picture is not drawn for that time
    drawn = "['circle', 'line'].map((each) => document.querySelectorAll(`.sensor ${each}`).length)"
    opened.until(f"String({drawn}) === '20,19'")
    frame, head = picture.bounding_box(), opened.page.locator(".sensor circle").nth(3).bounding_box()
    assert frame["x"] < head["x"] < frame["x"] + frame["width"]
    assert frame["y"] < head["y"] < frame["y"] + frame["height"] / 2
    first = opened.state("look.picture")
    opened.until(f"state.look?.picture && state.look.picture !== {first!r}")
    opened.close()


def test_every_frame_shows_the_poses_of_both_takes(studio, film):
    path = studio.folder / "film.toml"
    production = produce(path, scenes.load(path), lambda *_: None)
    with av.open(str(film)) as file:
        frames = [(each.time, each.to_ndarray(format="gray")) for each in file.decode(video=0)]
    assert len(frames) == production.frames
    np.testing.assert_allclose([time for time, _ in frames], np.arange(len(frames)) / FPS, atol=1e-3)
    shots = Shots(production.scene.camera, production.extents(lambda *_: None), FPS, SIZE)
    half = SIZE[0] // 2
    for side, actor in zip((slice(0, half), slice(half, None)), production.actors, strict=True):
        triangles, places = actor.prepared.character.triangles, placed(actor, range(production.frames))
        moving = np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1)
        fastest = int(moving[10:-10].argmax()) + 10  # between this frame and the next one
        for frame in (10, fastest, len(frames) - 10):
            (view,) = shots.views(frame)
            shown = frames[frame][1][:, side] > LEAST_GREY
            drawn = [silhouette(places[k], triangles, view.camera)[:, side] for k in (frame, frame + 1)]
            agreement = [(shown & each).sum() / (shown | each).sum() for each in drawn]
            assert agreement[0] > MIN_AGREEMENT
            assert frame != fastest or agreement[0] > agreement[1]


def silhouette(places, triangles, camera):
    """Return which pixels (h, w) of a frame a character covers."""
    clip = np.c_[places, np.ones(len(places))] @ camera.matrix(SIZE)
    pixels = (clip[:, :2] / clip[:, 3:] + 1) / 2 * SIZE
    image = Image.new("1", SIZE)
    pen = ImageDraw.Draw(image)
    for corners in pixels[triangles]:
        pen.polygon([tuple(corner) for corner in corners - 0.5], fill=1)
    return np.asarray(image)


def test_the_performer_is_heard_when_the_motion_says(studio, film):
    with av.open(str(film)) as file:
        blocks = list(file.decode(audio=0))
    heard = np.abs(np.concatenate([block.to_ndarray() for block in blocks], axis=1)[0])
    loud = np.flatnonzero(heard > LEAST_SOUND) / blocks[0].sample_rate
    onsets = loud[np.insert(np.diff(loud) > 0.1, 0, True)]
    words, whole = np.concatenate([spoken(studio.folder, table) for table in takes_of(studio)], axis=1)
    words, whole = words[words.argsort()], whole[words.argsort()] > 0
    clear = words[np.insert(np.diff(words) > SPOKEN_SECONDS + 0.1, 0, True) & whole]  # not while the other is heard
    begun = max(table.get("at", 0.0) for table in takes_of(studio)) + SPOKEN_SECONDS + 0.1  # a take can begin in a word
    assert (clear > begun).sum() >= 2
    for some, all_of_them in ((clear, onsets), (onsets, words)):
        assert np.abs(some[some > begun, None] - all_of_them).min(axis=1).max() <= MAX_OFFSET_SECONDS


def takes_of(studio):
    return tomllib.loads((studio.folder / "film.toml").read_text())["take"]


def spoken(folder, table):
    """Return the seconds of the film at which the performer of a take begins to speak, by what the performer does.

    Below them is 1, or 0 for a word that begins with the last frame: that may be heard, or not any more.
    """
    clip = PERFORMANCES["rear"]().positions
    seen = [each for each in puppetline_log.events(folder / table["file"]) if isinstance(each, SkeletonFrame)]
    times = np.array([each.time for each in seen]) - seen[0].time
    numbers = [np.nanmax(np.abs(clip - each.positions), axis=(1, 2)).argmin() for each in seen]
    numbers = np.unwrap(numbers, period=len(clip))
    late = np.mean(times - (numbers + 0.5) / FPS)
    first, last = round(FPS * table.get("start", 0.0)) / FPS, min(table.get("stop", 1000.0), times[-1])
    begins = np.array([k for k in range(numbers[0], numbers[-1]) if k % len(clip) % SPOKEN_FRAMES == 0]) / FPS + late
    begins = begins[(begins > first) & (begins < last)]
    whole = begins < last - BLOCK_SECONDS - 1 / FPS
    return np.array([begins - first + round(FPS * table.get("at", 0.0)) / FPS, whole])
