"""Pictures of films that cover the frame: backgrounds behind it and titles over it."""

import contextlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont, ImageOps

from engine_bridge.film.scene import DEFAULT_BACKGROUND, BackgroundTable, SceneError, TitleTable
from puppetline.errors import at

MARGIN = 0.08
"""Distance of titles from the upper and lower edges, as a share of the height."""

OUTLINE = 0.06
"""Width of the dark outline of titles, as a share of their size."""


FONTS = ("DejaVuSans.ttf", "NotoSans-Regular.ttf", "LiberationSans-Regular.ttf", "Arial.ttf", "arial.ttf")
"""Fonts of systems, of which the first one that exists shows titles with other letters than those of English."""


def background(table: BackgroundTable, size: tuple[int, int], scene: Path) -> NDArray[np.uint8]:
    """Return the picture (h, w, 4) behind everything.

    Raises
    ------
    SceneError
        The picture cannot be opened.
    """
    if table.picture is not None:
        try:
            with Image.open(scene.parent / table.picture) as opened:
                return np.asarray(ImageOps.fit(ImageOps.exif_transpose(opened).convert("RGBA"), size))
        except (OSError, ValueError, Image.DecompressionBombError) as error:
            raise SceneError(
                at(scene, field="[background], picture"),
                found=f"{scene.parent / table.picture}, which cannot be opened ({error})",
                expected="a picture, such as .png or .jpg, relative to the scene file",
                fix="Correct the path, or save the picture again.",
            ) from error
    top, bottom = table.colors or ((table.color, table.color) if table.color else DEFAULT_BACKGROUND)
    share = np.linspace(0, 1, size[1])[:, None]
    colors = (1 - share) * ImageColor.getrgb(top)[:3] + share * ImageColor.getrgb(bottom)[:3]
    column = np.rint(np.column_stack([colors, np.full(size[1], 255)])).astype(np.uint8)
    return np.ascontiguousarray(column[:, None].repeat(2, axis=1))


def title(table: TitleTable, size: tuple[int, int], where: str, folder: Path) -> NDArray[np.uint8]:
    """Return the picture (h, w, 4) of a title on nothing.

    Raises
    ------
    SceneError
        The font cannot be opened.
    """
    height = max(round(table.size * size[1]), 1)
    font = _font(table, height, where, folder)
    y, anchor = {
        "top": (MARGIN * size[1], "ma"),
        "middle": (size[1] / 2, "mm"),
        "bottom": ((1 - MARGIN) * size[1], "md"),
    }[table.place]
    # the outline's colour under the letters' edges, so that they have no dark rim where they fade out
    image = Image.new("RGBA", size, (*ImageColor.getrgb(table.color)[:3], 0))
    ImageDraw.Draw(image).multiline_text(
        (size[0] / 2, y),
        table.text,
        (*ImageColor.getrgb(table.color)[:3], 255),
        font,
        anchor=anchor,
        align="center",
        stroke_width=OUTLINE * height,
        stroke_fill=(20, 22, 28, 190),
    )
    return np.asarray(image)


def _font(table: TitleTable, height: int, where: str, folder: Path) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return the font of a title; Pillow's own one has the letters of English only."""
    if table.font is None and table.text.isascii():
        return ImageFont.load_default(height)
    for name in FONTS if table.font is None else (str(folder / table.font),):
        with contextlib.suppress(OSError):
            return ImageFont.truetype(name, height)
    if table.font is None:
        raise SceneError(
            f"{where}, text",
            found=f"the letters {''.join(sorted({letter for letter in table.text if not letter.isascii()}))}",
            expected=f"letters of English, or one of the fonts {', '.join(FONTS)} on this system",
            fix='Add a font: font = "FILE.ttf". On Debian: apt install fonts-dejavu-core',
        )
    raise SceneError(
        f"{where}, font",
        found=f"{folder / table.font}, which cannot be opened",
        expected="a font, such as .ttf, relative to the scene file",
        fix="Correct the path, or remove the key font.",
    )


def opacity(table: TitleTable, time: float) -> float:
    """Return how visible a title is at a time of the film, from 0 to 1."""
    inside = min(time - table.at, table.at + table.seconds - time)
    return float(np.clip(inside / table.fade, 0.0, 1.0)) if table.fade else float(inside >= 0)
