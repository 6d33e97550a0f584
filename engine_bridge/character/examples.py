"""Example characters and their motions, written to files.

This is the only module of the product that imports the example characters and their puppet files;
`capture.sources.demo` is the only one that imports the example performances.
"""

import shutil
import wave
from collections.abc import Callable
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
from puppetline.examples import film
from puppetline.examples.characters import CHARACTERS
from puppetline.examples.characters.character import ColoredSurface

from capture.recording import Recorder
from capture.sources.demo import performances
from engine_bridge.character.character import make_character
from puppetline.errors import OutputError
from puppetline.files import check_writable, written_whole

MOTIONS: dict[str, str] = {"dinosaur": "roar", "pegasus": "rear", "biped": "walk", "dog": "bark", "human": "kung_fu"}
"""Motion of each character."""

Progress = Callable[[str, float], None]


def example_character(name: str) -> ColoredSurface:
    """Make one of the characters in `MOTIONS`."""
    made: ColoredSurface = CHARACTERS[name]()
    return made


def prepare(name: str, folder: Path, progress: Progress = lambda _stage, _share: None) -> tuple[Path, Path]:
    """Write a character, its puppet file and a recording of its motion; existing files are replaced.

    Parameters
    ----------
    name : str
        A key of `MOTIONS`.
    folder : Path
        Created if it does not exist.
    progress : callable, optional
        Called with the name of a step and the share of it that is done.

    Returns
    -------
    log, puppet : Path

    Raises
    ------
    PuppetlineError
        A file cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            folder,
            found=f"a folder that cannot be created ({error.strerror})",
            expected="a folder to write to",
            fix="Choose another folder with -o.",
        ) from error
    check_writable(folder / f"{name}.glb", ".glb")
    progress("Making the character", 0.0)
    made = example_character(name)
    make_character(name, made.vertices, made.faces, made.colors).document.save(folder / f"{name}.glb")
    progress("Making the character", 1.0)
    puppet = folder / f"{name}.toml"
    with as_file(files("puppetline.examples") / "puppets" / puppet.name) as example, written_whole(puppet) as beside:
        shutil.copyfile(example, beside)
    return _write_motion(MOTIONS[name], folder), puppet


def _write_motion(name: str, folder: Path) -> Path:
    """Write the recording of an example motion, and return its path."""
    log = folder / f"{name}.log"
    with written_whole(log) as beside, Recorder(beside) as recorder:
        for frame in performances()[name]().frames():
            recorder.write(frame)
    return log


def prepare_film(folder: Path, progress: Progress = lambda _stage, _share: None) -> Path:
    """Write a scene file with two characters, their takes and a sound; existing files are replaced.

    Returns
    -------
    Path
        The scene file.

    Raises
    ------
    PuppetlineError
        A file cannot be written.
    """
    for name in ("human", "dog"):
        prepare(name, folder, progress)
    _write_motion("train", folder)
    with written_whole(folder / "film.wav") as beside, wave.open(str(beside), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(film.SAMPLE_RATE)
        file.writeframes(np.rint(film.sound() * 32767).astype("<i2").tobytes())
    scene = folder / "film.toml"
    with written_whole(scene) as beside:
        beside.write_text(film.SCENE, encoding="utf-8")
    return scene
