"""A visitor's recording: its files, which outlive a service that crashes."""

import secrets
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import tomlkit

from engine_bridge.service.stages.stage import Stage
from puppetline import clock

FOLDER = "visitors"
"""Name of the folder in the folder of takes, in which nothing is kept."""

CODE_LETTERS, CODE_LENGTH = "ABCDEFGHJKMNPQRSTUVWXYZ23456789", 6
"""Letters and digits that cannot be mistaken for each other, and their number in a code: 900 million codes."""

CODE = f"[{CODE_LETTERS}]{{{CODE_LENGTH}}}"
"""Pattern of a code."""

SPACING_METRES = 1.6
"""Distance between characters in a film, in metres."""


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
    def begin(cls, folder: Path, stage: Stage, size: tuple[int, int], began: float) -> Self:
        """Return a clip of the performers of a stage, with a new code; its scene is written."""
        path = folder / ("".join(secrets.choice(CODE_LETTERS) for _ in range(CODE_LENGTH)) + ".log")
        driven = [
            (each.character.name, each.document.path, each.user) for each in stage.players if each.user is not None
        ]
        clip = cls(path, [name for name, _, _ in driven], began)
        folder.mkdir(parents=True, exist_ok=True)
        clip.scene.write_text(_scene(path.name, driven, size), encoding="utf-8")
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

    def delete(self) -> None:
        """Delete everything, also a film that is not complete."""
        for path in self.path.parent.glob(f"*{self.code}.*"):
            with suppress(OSError):
                path.unlink()


def clips_in(folder: Path) -> list[Clip]:
    """Return the clips that a crashed service has left, in their order; what cannot become a film is deleted."""
    clips = []
    now = clock.now()
    for scene in sorted(folder.glob("*.toml"), key=_changed):
        clip = Clip(scene.with_suffix(".log"), [], now)
        if clip.film.is_file():
            clip.offered = now - max(0.0, clock.wall() - _changed(clip.film))
        if clip.offered is not None or (clip.path.is_file() and clip.path.stat().st_size):
            clips.append(clip)
    kept = {clip.code for clip in clips}
    for path in folder.glob("*"):
        if path.stem not in kept:
            path.unlink()
    return clips


def visitors_folder(takes: Path) -> Path:
    """Return the folder of visitors' files in a folder of takes."""
    return takes / FOLDER


def _changed(path: Path) -> float:
    return path.stat().st_mtime


def _scene(take: str, driven: list[tuple[str, Path, int]], size: tuple[int, int]) -> str:
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
    return tomlkit.dumps({"film": {"size": list(size)}, "character": characters, "take": takes})
