"""Draws takes for the page: a character in a take, and the wave form of its sound."""

from pathlib import Path

import numpy as np
from PIL import Image

from capture.sound import read_wav
from engine_bridge.film.takes import solve_take
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.pictures.clip_sheet import draw_character
from puppetline.files import written_whole

PICTURES, SIZE = 8, (96, 72)
"""Number of images of a take, and their width and height in pixels."""

WAVE_SIZE = 600, 48
"""Width and height of a wave form in pixels."""


def draw_take(puppet: Path, log: Path, path: Path, size: tuple[int, int] = SIZE) -> None:
    """Draw a character at equal intervals of a take, side by side, in the format of the file's ending.

    Raises
    ------
    PuppetlineError
    """
    prepared = load_prepared(puppet)
    motion = solve_take(prepared, log, Settings(fps=10.0), lambda _: None).motion
    chosen = np.linspace(0, len(motion) - 1, PICTURES).astype(int)
    images = draw_character(prepared, motion.R[chosen], motion.root[chosen], size)
    with written_whole(path) as beside:
        Image.fromarray(np.hstack(images)).save(beside, format=path.suffix[1:])


def draw_wave(sound: Path, path: Path) -> None:
    """Draw a sound as a PNG: white on transparent, its loudest sample as high as the picture."""
    width, height = WAVE_SIZE
    samples, _ = read_wav(sound)
    parts = np.array_split(np.abs(samples), width)
    peaks = np.array([part.max(initial=0.0) for part in parts])
    high = height / 2 * peaks / max(peaks.max(), 1e-3)
    inside = np.abs(np.arange(height)[:, None] + 0.5 - height / 2) <= np.maximum(high, 0.5)
    image = np.full((height, width, 4), 255, np.uint8)
    image[..., 3] *= inside
    with written_whole(path) as beside:
        Image.fromarray(image).save(beside, format="PNG")
