"""A sensor's picture as a small JPEG, for programs that show it elsewhere."""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from capture.trackers.picture import Picture

MAX_WIDTH = 640
"""Maximum width of a JPEG in pixels; larger pictures are reduced."""

MAX_JPEG_BYTES = 65_536
"""Maximum size of a JPEG in bytes."""

QUALITIES = 75, 50, 25
"""Qualities that are tried before the picture is made smaller."""


def shaded(depth: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return a depth image as colours: near is light, slopes are darker, and unknown depth is violet.

    Parameters
    ----------
    depth : (height, width) float32
        Metres; 0 for unknown.

    Returns
    -------
    (height, width, 3) uint8
    """
    down, right = np.gradient(depth)
    facing = 1 / np.sqrt(1 + (100 * right) ** 2 + (100 * down) ** 2)
    light = np.clip(1.15 - depth / 5, 0.15, 1) * (0.35 + 0.65 * facing)
    gray = np.repeat((255 * light).astype(np.uint8)[..., None], 3, axis=2)
    gray[depth == 0] = (52, 26, 66)
    return gray


def jpeg(picture: Picture) -> bytes:
    """Return the colours of a picture, or its depth as colours, as a JPEG of at most `MAX_JPEG_BYTES`.

    Parameters
    ----------
    picture : Picture
        With colours or depth.
    """
    pixels = picture.color
    if pixels is None:
        assert picture.depth is not None  # noqa: S101 - a picture has one of them
        pixels = shaded(picture.depth)
    image = Image.fromarray(pixels)
    image.thumbnail((MAX_WIDTH, MAX_WIDTH), Image.Resampling.BILINEAR, reducing_gap=2.0)
    while True:
        for quality in QUALITIES:
            file = BytesIO()
            image.save(file, format="JPEG", quality=quality)
            if file.tell() <= MAX_JPEG_BYTES:
                return file.getvalue()
        image = image.reduce(2)
