"""Typefaces of titles and speech bubbles: five from packages, and files."""

import contextlib
from importlib import resources
from pathlib import Path

from PIL import ImageFont

from engine_bridge.film.scene import SceneError, Typeface

FILES: dict[Typeface, tuple[str, str]] = {
    "plain": ("font_source_sans_pro", "SourceSansPro-Bold.otf"),
    "serif": ("font_source_serif_pro", "SourceSerifPro-Bold.otf"),
    "round": ("font_fredoka_one", "FredokaOne-Regular.ttf"),
    "hand": ("font_amatic_sc", "AmaticSC-Bold.ttf"),
    "poster": ("font_source_sans_pro", "SourceSansPro-Black.otf"),
}
"""Package and file of each typeface."""

SYSTEM_FILES = ("DejaVuSans.ttf", "NotoSans-Regular.ttf", "NotoSansCJK-Regular.ttc", "Arial.ttf", "arial.ttf")
"""Typefaces of systems, for letters that no typeface of Puppetline has."""

UNASSIGNED = "\U0010ffff"
"""A character that no typeface has, which shows what it draws in place of one that it does not have."""


def typeface(font: str, text: str, height: int, where: str, folder: Path) -> ImageFont.FreeTypeFont:
    """Return a typeface that has all letters of a text: the chosen one, else the plain one, else one of the system.

    Parameters
    ----------
    font : str
        A name in `FILES`, or a file relative to `folder`.
    text : str
    height : int
        Pixels.
    where : str
        The table, for errors.
    folder : Path

    Raises
    ------
    SceneError
        The file cannot be opened, or no typeface has the letters.
    """
    if font not in FILES:
        try:
            return ImageFont.truetype(folder / font, height)
        except OSError:
            raise SceneError(
                f"{where}, font",
                found=f"{folder / font}, which cannot be opened",
                expected=f"{', '.join(FILES)}, or a font, such as .ttf, relative to the scene file",
                fix="Correct the path, or remove the key font.",
            ) from None
    letters = {letter for letter in text if not letter.isspace()}
    lacking = letters  # if no typeface can be opened
    for file in (FILES[font], FILES["plain"], *SYSTEM_FILES):
        with contextlib.suppress(OSError, ModuleNotFoundError):
            opened = ImageFont.truetype(file if isinstance(file, str) else _packaged(*file), height)
            lacking = _lacking(opened, letters)
            if not lacking:
                return opened
    raise SceneError(
        f"{where}, text",
        found=f"the letters {''.join(sorted(lacking))}",
        expected=f"letters of Europe, or one of the fonts {', '.join(SYSTEM_FILES)} with these letters on this system",
        fix="Add a font: font = \"FILE.ttf\". Typefaces come with pip install 'puppetline[film]' and, on Debian, with "
        "apt install fonts-noto.",
    )


def installed_file(name: str) -> Path | None:
    """Return the file of a typeface in `FILES`; None for another name, or if its package is not installed."""
    with contextlib.suppress(KeyError, ModuleNotFoundError):
        return _packaged(*FILES[name])  # type: ignore[index]
    return None


def _packaged(package: str, file: str) -> Path:
    """Return the path of a typeface in a package."""
    return Path(str(resources.files(package))) / "files" / file


def _lacking(font: ImageFont.FreeTypeFont, letters: set[str]) -> set[str]:
    """Return the letters that a typeface does not have."""
    box = bytes(font.getmask(UNASSIGNED))
    return {letter for letter in letters if bytes(font.getmask(letter)) == box}
