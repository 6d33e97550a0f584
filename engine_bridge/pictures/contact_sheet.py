"""A contact sheet: labelled images in rows, as a PNG."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from puppetline.files import written_whole

GAP, LABEL_HEIGHT, TITLE_HEIGHT = 10, 30, 52
"""Space between images, for the label under each, and for the title, in pixels."""
PAPER, INK = (250, 250, 251), (52, 54, 60)
"""Colours of the background and of the text, in sRGB."""


def write_contact_sheet(
    images: Sequence[NDArray[np.uint8]], labels: Sequence[str], columns: int, path: Path, title: str = ""
) -> None:
    """Write a PNG with images in rows and a label under each.

    Parameters
    ----------
    images : sequence of (h, w, 3) uint8
        All have the same size.
    labels : sequence of str
        One per image.
    columns : int
        Number of images in a row.
    path : Path
        An existing file is replaced only when the new image is complete.
    title : str
        Text above the images; empty for none.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    height, width = images[0].shape[:2]
    rows = -(-len(images) // columns)
    top = TITLE_HEIGHT if title else GAP
    sheet = Image.new("RGB", (GAP + columns * (width + GAP), top + rows * (height + LABEL_HEIGHT) + GAP), PAPER)
    pen = ImageDraw.Draw(sheet)
    if title:
        pen.text((2 * GAP, TITLE_HEIGHT / 2), title, INK, ImageFont.load_default(22), anchor="lm")
    for index, (image, label) in enumerate(zip(images, labels, strict=True)):
        x = GAP + index % columns * (width + GAP)
        y = top + index // columns * (height + LABEL_HEIGHT)
        sheet.paste(Image.fromarray(image), (x, y))
        pen.text((x + width / 2, y + height + LABEL_HEIGHT / 2), label, INK, ImageFont.load_default(15), anchor="mm")
    with written_whole(path) as partial:
        sheet.save(partial, format="PNG")
