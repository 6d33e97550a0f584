"""Pictures of films that cover the frame: backgrounds behind it and titles over it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont, ImageOps

from engine_bridge.film.scene import BackgroundTable, SceneError, TitleTable
from engine_bridge.film.typeface import typeface
from puppetline.errors import at

MARGIN = 0.08
"""Distance of titles from the upper and lower edges, as a share of the height."""

WIDTH = 0.9
"""Maximum width of a title's lines, as a share of the picture's width; longer lines are broken at spaces."""

OUTLINE = 0.06
"""Width of the dark outline of titles, as a share of their size."""


def background(table: BackgroundTable, size: tuple[int, int], scene: Path) -> NDArray[np.uint8]:
    """Return the picture (h, w, 4) behind everything, if it is not a set.

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
    top, bottom = table.colors or (table.color or "black",) * 2
    share = np.linspace(0, 1, size[1])[:, None]
    colors = (1 - share) * ImageColor.getrgb(top)[:3] + share * ImageColor.getrgb(bottom)[:3]
    column = np.rint(np.column_stack([colors, np.full(size[1], 255)])).astype(np.uint8)
    return column[:, None].repeat(size[0], axis=1)


def title(table: TitleTable, size: tuple[int, int], where: str, folder: Path) -> NDArray[np.uint8]:
    """Return the picture (h, w, 4) of a title on nothing.

    Raises
    ------
    SceneError
        The typeface cannot be opened, or has no such letters.
    """
    height = max(round(table.size * size[1]), 1)
    font = typeface(table.font, table.text, height, where, folder)
    text = _wrapped(table.text, font, WIDTH * size[0])
    y, anchor = {
        "top": (MARGIN * size[1], "ma"),
        "middle": (size[1] / 2, "mm"),
        "bottom": ((1 - MARGIN) * size[1], "md"),
    }[table.place]
    # the outline's colour under the letters' edges, so that they have no dark rim where they fade out
    image = Image.new("RGBA", size, (*ImageColor.getrgb(table.color)[:3], 0))
    ImageDraw.Draw(image).multiline_text(
        (size[0] / 2, y),
        text,
        (*ImageColor.getrgb(table.color)[:3], 255),
        font,
        anchor=anchor,
        align="center",
        stroke_width=OUTLINE * height,
        stroke_fill=(20, 22, 28, 190),
    )
    return np.asarray(image)


def _wrapped(text: str, font: ImageFont.FreeTypeFont, width: float) -> str:
    """Return a text whose lines are broken at spaces where they are longer than a width in pixels."""
    lines = list[str]()
    for line in text.split("\n"):
        lines.append("")
        for word in line.split(" "):
            longer = f"{lines[-1]} {word}".lstrip()
            if lines[-1] and font.getlength(longer) > width:
                lines.append(word)
            else:
                lines[-1] = longer
    return "\n".join(lines)


def fading(time: float, begin: float, seconds: float, fade: float) -> float:
    """Return how visible something is at a time of the film, from 0 to 1, if it appears and disappears in a fade."""
    inside = min(time - begin, begin + seconds - time)
    return float(np.clip(inside / fade, 0.0, 1.0)) if fade else float(inside >= 0)
