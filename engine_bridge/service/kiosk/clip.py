"""A visitor's recording: its files, which outlive a service that crashes."""

import re
import secrets
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import tomlkit

from engine_bridge.service.kiosk.kiosk_table import KioskTable
from engine_bridge.service.stages.stage import Stage
from puppetline import clock
from puppetline.files import output_errors, written_whole

FOLDER = "visitors"
"""Name of the folder in the folder of takes, in which nothing is kept."""

CODE_LETTERS, CODE_LENGTH = "ABCDEFGHJKMNPQRSTUVWXYZ23456789", 6
"""Letters and digits that cannot be mistaken for each other, and their number in a code: 900 million codes."""

CODE = f"[{CODE_LETTERS}]{{{CODE_LENGTH}}}"
"""Pattern of a code."""

_FILE = re.compile(rf"\.?{CODE}\..+")
"""Pattern of the names of visitors' files; a file that is not complete begins with a dot."""

SPACING_METRES = 1.6
"""Distance between characters in a film, in metres."""


def new_code() -> str:
    """Return a code that cannot be guessed."""
    return "".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH))


@dataclass
class Clip:
    """What a visitor records.

    Attributes
    ----------
    path : Path
        The take; the sound, the scene, the film, its poster and its .gif have the same name.
    characters : list of str
        Names of the characters.
    began : float
        Time at which the recording begins, of `puppetline.clock`.
    offered : float or None
        Time from which on the film is offered; None while it is made.
    attempts : int
        How often the film was begun.
    """

    path: Path
    characters: list[str]
    began: float
    offered: float | None = None
    attempts: int = 0

    @classmethod
    def begin(cls, folder: Path, stage: Stage, table: KioskTable, began: float) -> Self:
        """Return a clip of the performers of a stage, with a new code; its scene is written."""
        path = folder / f"{new_code()}.log"
        driven = [
            (each.character.name, each.document.path, each.user) for each in stage.players if each.user is not None
        ]
        clip = cls(path, [name for name, _, _ in driven], began)
        folder.mkdir(parents=True, exist_ok=True)
        with written_whole(clip.scene) as beside:
            beside.write_text(_scene(path.name, driven, table), encoding="utf-8")
        return clip

    @property
    def code(self) -> str:
        """The code with which a visitor gets the film."""
        return self.path.stem

    @property
    def scene(self) -> Path:
        """The scene file of the film."""
        return self.path.with_suffix(".toml")

    @property
    def film(self) -> Path:
        """The film, which appears when it is complete."""
        return self.path.with_suffix(".mp4")

    @property
    def recorded(self) -> bool:
        """Whether there is a take."""
        return self.path.is_file() and self.path.stat().st_size > 0

    @property
    def complete(self) -> bool:
        """Whether there are the film and all that goes with it, of which the .gif is the last."""
        return self.film.is_file() and self.path.with_suffix(".gif").is_file()

    def delete(self) -> None:
        """Delete everything, also a film that is not complete."""
        for path in self.path.parent.glob(f"*{self.code}.*"):
            with suppress(OSError):
                path.unlink()


def clips_in(folder: Path) -> list[Clip]:
    """Return the clips that a crashed service has left, in their order; what cannot become a film is deleted.

    Raises
    ------
    OutputError
        A file cannot be read or deleted.
    """
    with output_errors(folder):
        files = [path for path in folder.glob("*") if _FILE.fullmatch(path.name) and path.is_file()]
        now = clock.now()
        clips = []
        for scene in sorted((path for path in files if re.fullmatch(rf"{CODE}\.toml", path.name)), key=_changed):
            clip = Clip(scene.with_suffix(".log"), [], now)
            if clip.complete:
                clip.offered = now - max(0.0, clock.wall() - _changed(clip.film))
            if clip.complete or clip.recorded:
                clips.append(clip)
        kept = {clip.code for clip in clips}
        for path in files:
            if path.name.partition(".")[0] not in kept:
                path.unlink()
    return clips


def visitors_folder(takes: Path) -> Path:
    """Return the folder of visitors' files in a folder of takes."""
    return takes / FOLDER


def _changed(path: Path) -> float:
    return path.stat().st_mtime


def _scene(take: str, driven: list[tuple[str, Path, int]], table: KioskTable) -> str:
    """Return the scene file of a clip: its characters side by side."""
    middle = (len(driven) - 1) / 2
    characters = [
        {"name": name, "puppet": str(puppet.resolve()), "position": [(number - middle) * SPACING_METRES, 0.0]}
        for number, (name, puppet, _) in enumerate(driven)
    ]
    takes = [
        {"character": name, "file": take, "user": user, "sound": number == 0}
        for number, (name, _, user) in enumerate(driven)
    ]
    scene = {
        "film": {"size": list(table.size), "fade_in": 0.5, "fade_out": 0.5},
        "background": {"set": table.set},
        "character": characters,
        "take": takes,
    }
    return tomlkit.dumps(scene)
