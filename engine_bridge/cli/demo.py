"""The embedded default, end to end: characters and performances made by code become animated .glb files.

This is the only place of the product that reaches the example characters and their puppet files;
`capture.sources.demo` is the only one that reaches the example performances.
"""

import shutil
from collections.abc import Callable
from importlib.resources import as_file, files
from pathlib import Path

from puppetline.examples.characters import CHARACTERS
from puppetline.examples.characters.character import Character

from capture.recording import Recorder
from capture.sources.demo import performances
from engine_bridge.character.character import make_character
from engine_bridge.export.convert import Summary, convert
from engine_bridge.performance.settings import Settings
from engine_bridge.pictures import clip_sheet
from puppetline.errors import OutputError
from puppetline.files import check_writable, written_whole

CASTING: dict[str, str] = {
    "dinosaur": "lean",
    "pegasus": "bow",
    "biped": "walk",
    "dog": "bark",
    "human": "kung_fu",
}
"""Which performance each character plays: the poses of the paper's user study, and a walk."""


def example_character(name: str) -> Character:
    """Make one of the characters that `CASTING` names."""
    made: Character = CHARACTERS[name]()
    return made


def play(
    name: str, folder: Path, progress: Callable[[str, float], None] = lambda _stage, _share: None
) -> tuple[Summary, Path]:
    """Make one character, its puppet and its performance, and convert them.

    Everything is written to the folder, so that it can be converted again with changes; an edited puppet wants another
    name, since the next call writes it anew.

    Parameters
    ----------
    name : str
        A key of `CASTING`.
    folder : Path
        Made where it does not exist.
    progress : callable, optional

    Returns
    -------
    summary : Summary
        Of the animation.
    picture : Path
        Its contact sheet.

    Raises
    ------
    PuppetlineError
    """
    log, puppet = prepare(name, folder, progress)
    title = f"{name}_{CASTING[name]}"
    output, picture = folder / f"{title}.glb", folder / f"{title}.png"
    clip, summary = convert(log, puppet, output, Settings(), progress)
    clip_sheet.draw(clip, picture, f"{name} · {CASTING[name]}", lambda share: progress("Drawing", share))
    return summary, picture


def prepare(
    name: str, folder: Path, progress: Callable[[str, float], None] = lambda _stage, _share: None
) -> tuple[Path, Path]:
    """Make one character, its puppet and its performance.

    Parameters
    ----------
    name : str
        A key of `CASTING`.
    folder : Path
        Made where it does not exist.
    progress : callable, optional

    Returns
    -------
    log, puppet : Path

    Raises
    ------
    PuppetlineError
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            folder,
            found=f"that it cannot be made ({error.strerror})",
            expected="a folder to write to",
            fix="Choose another one with -o.",
        ) from error
    check_writable(folder / f"{name}.glb", ".glb")
    progress("Making the character", 0.0)
    made = example_character(name)
    make_character(name, made.vertices, made.faces, made.colors).document.save(folder / f"{name}.glb")
    progress("Making the character", 1.0)
    puppet = folder / f"{name}.toml"
    with as_file(files("puppetline.examples") / "puppets" / puppet.name) as example, written_whole(puppet) as beside:
        shutil.copyfile(example, beside)
    log = folder / f"{CASTING[name]}.log"
    with written_whole(log) as beside, Recorder(beside) as recorder:
        for frame in performances()[CASTING[name]]().frames():
            recorder.write(frame)
    return log, puppet
