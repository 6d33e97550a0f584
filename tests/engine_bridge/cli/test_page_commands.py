"""Every command of the README and of docs/ runs: on a small figure, with short recordings and without a device."""

import os
import re
import shutil
import signal
import wave
from dataclasses import replace
from pathlib import Path

import igl
import numpy as np
import pytest
from click.testing import CliRunner
from puppetline.examples import film
from puppetline.examples.performances import PERFORMANCES, clean

from engine_bridge.character import examples
from engine_bridge.cli.main import main
from engine_bridge.pictures import clip_sheet

from ...capture.formats.bvh_files import animal_file
from ...test_documentation import PAGES, ROOT, blocks, commands, name_of

pytestmark = pytest.mark.slow

FRAMES = 40
"""Length of the example motions here."""

NOT_RUN = {
    "bench": "measures for minutes; test_benchmark.py runs it with a small mesh",
    "demo --live": "has fixed ports; test_serve.py runs it",
    "look --live": "requires a terminal; test_look.py runs it in one",
    "record --sound": "requires a microphone; tests/capture/test_sound.py has a virtual one",
    "record --sensor": "requires a RealSense; tests/capture/sensors has a virtual one",
}
"""Commands that do not run here, and why."""

REPLACED = {
    "(camera|openni|realsense|orbbec|freenect|video):.*": "demo:walk?loop",  # tests/capture/sensors opens these
    r"osc:711\d": "osc:0",
    r"127\.0\.0\.1:7400": "SERVICE",
    "7402": "0",
    "--sound": "--sound=voice.wav",
    "MESH": "figure.glb",
    r"^dance\.mp4$": "dance.txt",  # tests/engine_bridge/service/test_video.py tracks a video
    r"^couple\.glb$": "couple.obj",
    "^biped$": "human",  # has four times as many vertices
}
"""Arguments that need a device or a certain port, and what takes their places."""

ADDED = {
    "serve": ("--port", "0", "--no-announce"),
    "studio": ("--port", "0", "--no-browser"),
    "record": ("--source", "demo:walk?loop", "--seconds", "0.3"),
    "look": ("--seconds", "0.3"),
    "listen": ("--seconds", "0.3"),
    "batch": ("--workers", "0"),
}
"""Options that end a command soon, and keep it from ports and folders of the user."""

LISTENS = "serving|The studio is at"


@pytest.fixture(scope="module")
def short_examples():
    """Let the example characters move for a second, and draw less."""
    with pytest.MonkeyPatch.context() as patch:
        for name, make in list(PERFORMANCES.items()):
            whole = make()
            short = replace(
                whole,
                times=whole.times[:FRAMES],
                positions=whole.positions[:FRAMES],
                confidence=whole.confidence[:FRAMES],
            )
            patch.setitem(PERFORMANCES, name, lambda short=short: short)
        patch.setattr(clip_sheet, "TILE_COUNT", 1)
        patch.setattr(film, "SCENE", film.SCENE.replace("seconds = 11.5", "seconds = 0.2\nsize = [64, 36]"))
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory, short_examples, blob, blob_file, limbed_puppet, take, free_port, record_events):
    """Return a folder with the files that the pages take for granted."""
    folder = tmp_path_factory.mktemp("pages")
    for name in ("out", "recordings", "more/1"):
        (folder / name).mkdir(parents=True)
    for name in ("human", "dog", "dinosaur"):
        examples.prepare(name, folder / "out")
    for name in ("dog", "dragon", "figure", "human"):
        shutil.copy(blob_file, folder / f"{name}.glb")
        text = limbed_puppet.read_text(encoding="utf-8").replace(blob_file.name, f"{name}.glb")
        (folder / f"{name}.toml").write_text(text, encoding="utf-8")
    shutil.copy(folder / "out/human.toml", folder / "out/mine.toml")
    record_events(folder / "whole.log", clean("walk").frames())
    record_events(folder / "out" / "walk.log", PERFORMANCES["walk"]().frames())  # that of the biped, which is not made
    igl.write_triangle_mesh(str(folder / "robot.obj"), blob.vertices.astype(float), blob.faces)
    shutil.copy(folder / "out" / "dog.glb", folder / "horse.glb")
    animal_file(folder, "dog_walk.bvh")
    both = np.vstack([blob.vertices, blob.vertices + np.array([2 * np.ptp(blob.vertices[:, 0]), 0, 0])])
    igl.write_triangle_mesh(str(folder / "couple.obj"), both, np.vstack([blob.faces, blob.faces + len(blob.vertices)]))
    for name in ("recordings/a.log", "more/1/S001.skeleton", "take.bvh", "dance.txt", "evening.log", "kung_fu.log"):
        shutil.copy(take, folder / name)  # what a recording is does not depend on its name
    with wave.open(str(folder / "voice.wav"), "wb") as sound:
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(16_000))
    (folder / "list.txt").write_text("recordings/a.log\n")
    texts = {
        name: next(blocks(ROOT / "docs" / f"{name}.md", "toml")).replace("camera:0?height=1.75", "demo:walk")
        for name in ("kiosk", "film")
    }
    texts["kiosk"] = texts["kiosk"].replace('sound = "default"\n', "") + f"\n[network]\nport = {free_port()}\n"
    (folder / "kiosk.toml").write_text(texts["kiosk"])
    (folder / "out" / "scene.toml").write_text(f"[film]\nsize = [64, 36]\nseconds = 0.2\n{texts['film']}")
    return folder


@pytest.fixture(scope="module")
def service(serve_module, folder):
    """Return the address of a service."""
    return serve_module("--puppet", folder / "dog.toml", "--source", "osc:0").stream.removeprefix("tcp://")


def tried(arguments, service):
    """Return the arguments with which a command runs here; None if it does not."""
    if any(all(word in arguments for word in command.split()) for command in NOT_RUN):
        return None
    for pattern, other in REPLACED.items():
        arguments = [re.sub(pattern, other, each) for each in arguments]
    arguments = [each.replace("SERVICE", service) for each in arguments]
    added = () if "--config" in arguments else ADDED.get(arguments[0], ())
    if arguments[0] == "listen":
        added = (service, *added)
    if arguments[0] == "align":
        arguments[1:3] = ["whole.log", "whole.log"]  # the two that `record` writes here are too short
    if arguments[-1] == "--studio":
        added = ("0",)
    return (*arguments, *added)


@pytest.fixture(scope="module")
def ran():
    """Return the commands that ran already: pages repeat some of them."""
    return set()


def starts_and_stops(running, arguments):
    """Run a command that does not end by itself, up to the first line that says where it listens, then press Ctrl-C.

    Ctrl-C is pressed once: a second one, while the command stops, ends it at once with an error.
    """
    read, write = os.pipe()
    process = running.start(*arguments, stdout=write, stderr=write)
    os.close(write)
    with os.fdopen(read) as lines:
        heard = ""
        for line in lines:
            listened, heard = re.search(LISTENS, heard), heard + line
            if re.search(LISTENS, line) and not listened:
                process.send_signal(signal.SIGINT)
        assert process.wait() == 0, heard
        assert re.search(LISTENS, heard)


@pytest.mark.parametrize("page", [page for page in PAGES if any(commands(page))], ids=name_of)
def test_the_commands_of_a_page_run(page, folder, service, ran, request, monkeypatch):
    monkeypatch.chdir(folder)
    for name in ("STATE", "DATA"):
        monkeypatch.setenv(f"XDG_{name}_HOME", str(folder / name))
    monkeypatch.setenv("SLURM_ARRAY_TASK_ID", "1")
    monkeypatch.setenv("SLURM_ARRAY_TASK_COUNT", "2")
    for arguments in (tried(each, service) for each in commands(page)):
        if arguments is None or arguments in ran:
            continue
        ran.add(arguments)
        output = arguments[arguments.index("-o") + 1] if "-o" in arguments else arguments[-1]
        if arguments[0] in ("new", "token", "keys", "record") and Path(output).is_file():
            Path(output).unlink()  # these do not replace files
        if arguments[0] in ("serve", "studio"):
            starts_and_stops(request.getfixturevalue("commands"), arguments)
        else:
            result = CliRunner().invoke(main, arguments, catch_exceptions=False)
            is_amiss = arguments[0] == "doctor" and "!!" in result.output  # a library does not load on a bare machine
            if result.exit_code != is_amiss:
                pytest.fail(f"{' '.join(arguments)}\n{result.output}")
