"""The demo project of a checkout with the real service: performers who arrive and leave, and recorded takes."""

import json
import re
import shutil
import subprocess
import threading
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from capture.events import Cue
from capture.skeleton import JOINT_INDEX
from capture.sound import WavWriter

from .resident import Godot

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("project")]

HERE = Path(__file__).parent
DEMO = HERE.parents[2] / "integrations" / "godot"


@pytest.fixture(scope="module")
def imported_demo(godot, tmp_path_factory):
    """The project of the checkout, which Godot has looked through once, to be copied."""
    folder = tmp_path_factory.mktemp("demo") / "project"
    shutil.copytree(DEMO, folder, ignore=shutil.ignore_patterns(".godot"))
    (folder / "tests").mkdir()
    for script in [HERE / "resident.gd", HERE / "teller.gd", *HERE.glob("demo_*.gd")]:
        shutil.copy(script, folder / "tests")
    command = [godot, "--headless", "--path", folder, "--import"]
    told = subprocess.run(command, capture_output=True, text=True, check=True, timeout=300)
    assert not re.search("SCRIPT ERROR|Parse Error|Failed to load", told.stdout + told.stderr), told
    return folder


@pytest.fixture
def project(imported_demo, tmp_path):
    """Stands in for the empty project of the other tests."""
    return shutil.copytree(imported_demo, tmp_path / "project")


@pytest.fixture
def two(blob_puppet, blob_file, write_puppet):
    """Two puppet files of one figure, by the names of their characters."""
    return {name: write_puppet(blob_file.with_name(f"{name}.toml"), blob_file.name) for name in ("dog", "cat")}


def kiosk_of(service, left, right):
    port = service.port
    return json.dumps(
        {"Left/Puppet": {"character": left, "port": port}, "Right/Puppet": {"character": right, "port": port}}
    )


def test_the_kiosk_invites_while_nobody_is_there_and_lights_up_who_comes(serve, sender, two, kung_fu, start_godot):
    """Two performers come one after another, and both are silent in the end."""
    puppets = [argument for path in two.values() for argument in ("--puppet", path)]
    service = serve(*puppets, "--source", sender.uri)
    kiosk = start_godot("demo_kiosk.gd", kiosk_of(service, "dog", "cat"))
    assert kiosk.until(lambda said: "attracting" in said)["attracting"]
    for side in ("Left", "Right"):
        kiosk.until(lambda said, side=side: said.get("loaded") == side)
    assert not any("taken" in said for said in kiosk.results)

    def there(*sides):
        return lambda: all({"calibrated": side, "user": n} in [*kiosk.results] for n, side in enumerate(sides, 1))

    sender.play(kung_fu, user=1, until=there("Left"))
    assert {"taken": "Left", "on": True} in kiosk.results
    assert {"taken": "Right", "on": True} not in kiosk.results
    assert {"attracting": False, "prompt": False} in kiosk.results
    first = threading.Thread(target=sender.play, args=(kung_fu,), kwargs={"until": there("Left", "Right")})
    first.start()
    sender.play(kung_fu, user=2, until=there("Left", "Right"))
    first.join()
    said = kiosk.finish()
    lit = [each for each in said if "taken" in each]
    assert lit[:2] == [{"taken": "Left", "on": True}, {"taken": "Right", "on": True}]
    assert sorted(each["taken"] for each in lit[2:] if not each["on"]) == ["Left", "Right"]
    assert said[-1] == {"attracting": True, "prompt": True}


def test_a_service_that_ends_leaves_the_kiosk_inviting(serve, take, two, start_godot):
    puppets = [argument for path in two.values() for argument in ("--puppet", path, "--source", f"replay:{take}?loop")]
    service = serve(*puppets)
    kiosk = start_godot("demo_kiosk.gd", kiosk_of(service, "dog", "cat"))
    for side in ("Left", "Right"):
        kiosk.until(lambda said, side=side: said == {"taken": side, "on": True})
    service.stop()
    said = kiosk.finish()
    assert {"taken": "Left", "on": False} in said
    assert {"taken": "Right", "on": False} in said
    assert said[-1] == {"attracting": True, "prompt": True}


@pytest.fixture
def stage(serve, take, two, free_port):
    """A service of both characters, of which a recording drives the first."""
    puppets = [argument for path in two.values() for argument in ("--puppet", path)]
    return serve(*puppets, "--source", f"replay:{take}?loop", "--calibrate", "at_once", "--port", free_port())


def test_takes_are_recorded_over_each_other_and_trimmed_on_the_film_set(stage, start_godot):
    port = int(stage.port)
    settings = {"Live": {"character": "dog", "port": port}, "Partner": {"character": "cat", "port": port}}
    said = start_godot("demo_film.gd", json.dumps(settings)).finish(120)
    first, second = (each["name"] for each in sorted(stage.ask("list")["takes"], key=lambda each: each["written"]))
    said_of = {key: value for each in said for key, value in each.items()}
    assert said_of["played"]["take"] == first
    assert said_of["played"]["character"] == "dog"
    assert said_of["command"].endswith(f"-- dog={first} cat={second} from=0.50 to=1.50")
    assert 1.5 <= said_of["ended"] < 2.5
    assert [each["started"] for each in said if "started" in each] == [first, second]
    assert said[-1] == {"cut": "Close"}
    assert stage.ask("describe")["status"]["timeline"] is None


CLAP_SECONDS = 1.0
"""Second of the take at which both hands of the performer jump up and the sound clicks."""

FIRST_SECONDS, LAST_SECONDS = 0.5, 1.7
"""Part of the takes that is filmed."""


@pytest.fixture
def filmed(frames, record, record_events, standing, dance, serve, two, project, free_port, screen, godot, tmp_path):
    """Images (n, 90, 160) of grey values and samples (m,) with their rate, of a movie by Godot's movie writer: a take
    with a sound plays on one character of the film set, and a dance on the other."""
    takes = tmp_path / "takes"
    takes.mkdir()
    clap = np.tile(standing, (61, 1, 1))
    clap[round(30 * CLAP_SECONDS) :, [JOINT_INDEX["hand_left"], JOINT_INDEX["hand_right"]], 1] += 0.5
    record_events(takes / "clap.log", [Cue(0.0, "sound", {"file": "clap.wav", "at": -0.25}), *frames(clap)])
    record(takes / "dance.log", dance(61))
    with WavWriter(takes / "clap.wav") as writer:
        samples = np.zeros(3 * 48_000, np.float32)
        samples[round((CLAP_SECONDS + 0.25) * 48_000) :][:480] = 0.9
        writer.write(samples)
    port = free_port()
    puppets = [argument for path in two.values() for argument in ("--puppet", path)]
    serve(*puppets, "--source", f"replay:{takes / 'dance.log'}?loop", "--port", port, "--takes", takes)
    scene, timeline = project / "demo" / "film" / "film.tscn", 'script = ExtResource("timeline")'
    text = scene.read_text().replace(timeline, f'{timeline}\ntakes_folder = "{takes}"')
    scene.write_text(re.sub('character = "', f"port = {port}\n\\g<0>", text))
    movie = tmp_path / "film.avi"
    drawn = [*screen("640x480"), godot, "--rendering-driver", "opengl3", "--path", project]
    part = [f"from={FIRST_SECONDS}", f"to={LAST_SECONDS}"]
    writer = ["--write-movie", movie, "--fixed-fps", 30, scene.relative_to(project)]
    Godot(*drawn, *writer, "--", "dog=clap", "cat=dance", *part).finish(300)
    with av.open(str(movie)) as file:
        images = np.array([each.to_ndarray(format="gray", width=160, height=90) for each in file.decode(video=0)])
        file.seek(0)
        heard = np.concatenate([each.to_ndarray().reshape(-1, 2)[:, 0] for each in file.decode(audio=0)])
        return images.astype(int), heard.astype(int), file.streams.audio[0].rate


def test_godots_movie_writer_films_a_part_of_takes_with_their_sound(filmed):
    images, heard, rate = filmed
    assert len(images) == pytest.approx(30 * (LAST_SECONDS - FIRST_SECONDS), abs=1.5)
    assert len(heard) / rate == pytest.approx(len(images) / 30, abs=0.001)
    changes = np.abs(np.diff(images, axis=0)).mean(axis=(1, 2))
    seen = np.diff(changes).argmax() + 2
    clicked = np.flatnonzero(np.abs(heard) > 0.5 * 32767)[0] / rate
    assert seen / 30 == pytest.approx(CLAP_SECONDS - FIRST_SECONDS, abs=0.07)
    assert clicked == pytest.approx(seen / 30, abs=1 / 30)


@pytest.fixture(scope="module")
def demo_live(tmp_path_factory, own_cache, commands):
    """Run `puppetline demo --live` as the documentation says, until the tests of this module are done."""
    folder = tmp_path_factory.mktemp("live")
    with commands.start("demo", "--live", cwd=folder, stderr=subprocess.PIPE) as process:
        line = next((line for line in process.stderr if "serving" in line or "cannot be bound" in line), "")
        if "cannot be bound" in line:
            pytest.skip("another program has a default port")
        assert "serving" in line
        rest = threading.Thread(target=process.stderr.read)
        rest.start()
        yield
        process.terminate()
        rest.join()


@pytest.mark.parametrize(("script", "scene"), [("demo_kiosk.gd", "kiosk"), ("demo_film.gd", "film")])
def test_a_scene_shows_the_example_characters_as_it_is(script, scene, demo_live, start_godot, screen, tmp_path):
    """A picture with the characters and one without differ in a good part of the pixels."""
    start_godot(script, "{}", tmp_path / f"{scene}.png", screen=screen()).finish(600)
    pictures = (tmp_path / f"{scene}.png", tmp_path / f"{scene}_empty.png")
    shown, empty = (np.asarray(Image.open(path).convert("RGB"), np.int16) for path in pictures)
    assert shown.shape == (720, 1280, 3)
    assert (np.abs(shown - empty).max(axis=2) > 12).mean() > 0.03
