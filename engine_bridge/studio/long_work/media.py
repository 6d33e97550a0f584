"""Videos, sounds and pictures that people bring: their kinds by the endings of their names."""

from pathlib import Path
from typing import Literal

from PIL import Image

from puppetline.errors import PuppetlineError

MediaKind = Literal["video", "sound", "picture"]

SUFFIXES: dict[MediaKind, tuple[str, ...]] = {
    "video": (".mp4", ".mov", ".m4v", ".webm", ".mkv", ".avi"),
    "sound": (".mp3", ".wav", ".ogg", ".opus", ".m4a", ".aac", ".flac"),
    "picture": (".jpg", ".jpeg", ".png", ".webp"),
}
"""Endings of names in small letters, by the kind of file."""


def media_kind(path: Path) -> MediaKind | None:
    """Return the kind of a file by the ending of its name; None if it is none of these.

    Raises
    ------
    PuppetlineError
        A picture that cannot be read.
    """
    kind = next((kind for kind, suffixes in SUFFIXES.items() if path.suffix.lower() in suffixes), None)
    if kind == "picture":
        _check_picture(path)
    return kind


def _check_picture(path: Path) -> None:
    try:
        with Image.open(path) as picture:
            picture.verify()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise PuppetlineError(
            path.name,
            found="a damaged picture",
            expected=f"a picture ({', '.join(SUFFIXES['picture'])})",
            fix="Open it in another program, and save it again.",
        ) from error
