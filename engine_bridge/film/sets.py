"""Sets of films: a panorama around the stage, a floor and the mood of the light, all made by code."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.painting import PERIOD, Painting, slabs, speckled
from engine_bridge.film.scene import Mood
from puppetline.toml_schema import FilmSet


class PaintedSet(NamedTuple):
    """What a set is made of.

    Attributes
    ----------
    paint : callable
        Paints its panorama.
    floor : callable
        Returns a picture (n, n, 4) that repeats on the floor.
    mood : Mood
    """

    paint: Callable[[Painting], None]
    floor: Callable[[], NDArray[np.uint8]]
    mood: Mood


@cache
def panorama(name: FilmSet) -> NDArray[np.uint8]:
    """Paint what is around a set, (h, w, 4): `PERIOD` degrees, from `TOP` to `BOTTOM` degrees above the horizon."""
    painting = Painting(seed=sorted(SETS).index(name))
    SETS[name].paint(painting)
    return painting.pixels


def _studio(to: Painting) -> None:
    to.sky((-10, "#dedbd5"), (0, "#dedbd5"), (5, "#e9e6e1"), (35, "#aebfd6"))
    for x in (30, 90):
        to.glow(x, 8, 34, "#ffffff", 0.7, 0.5)


def _meadow(to: Painting) -> None:
    to.sky((-10, "#8fbf5c"), (0, "#dff1f7"), (8, "#a9dcf2"), (35, "#3f94d8"))
    to.glow(84, 17, 22, "#fffbe0", 0.9)
    to.disc(84, 17, 1.6, "#fffdf0")
    for x in to.spread(7):
        to.cloud(x, to.random.uniform(7, 17), to.random.uniform(9, 18), "#ffffff")
    to.ridge(2.2, 5.2, "#9cc7d4", (1, 5))
    to.ridge(1.2, 3.6, "#86bd93", (2, 7))
    for x in to.spread(34):
        _round_tree(to, x, to.random.uniform(1.2, 2.0), to.random.uniform(0.8, 1.6), "#5f9e62", "#77b36c")
    to.ridge(0.5, 1.9, "#83ba57", (2, 6))
    for x in (14, 49, 68, 104):
        _round_tree(to, x, 0.9, to.random.uniform(4.2, 5.6), "#4b8a48", "#6bab58")
    to.ridge(-0.4, 0.7, "#8fbf5c", (3, 8))
    for x in to.spread(260):
        y = to.random.uniform(-2.5, 0.3)
        to.disc(x, y, 0.09, str(to.random.choice(["#ffffff", "#ffd84d", "#ff8fa3", "#c9a7ff"])), 0.7)


def _forest(to: Painting) -> None:
    to.sky((-10, "#5f7a3c"), (0, "#dfe8b8"), (10, "#b9d59a"), (35, "#3c6e4b"))
    to.glow(62, 12, 30, "#fffbd0", 0.9)
    for count, size, trunk, color in ((34, 0.5, "#9dbb8c", "#a5c592"), (24, 0.9, "#6f8f67", "#7ba16d")):
        for x in to.spread(count):
            to.rectangle(x - 0.5 * size, -1, x + 0.4 * size, 35, trunk)
        for x in to.spread(count):
            to.disc(x, to.random.uniform(14, 22) / size**0.3, to.random.uniform(4, 7), color, 0.7)
        to.haze(-2, 12, "#e4edbf", 0.55)
    for x in (50, 58, 66, 74):
        to.beam([(x + 8, 35), (x + 11, 35), (x - 4, -1), (x - 9, -1)], "#fffde0", 0.3, 0.8)
    to.ridge(0.2, 2.2, "#6f8f45", (6, 22))
    for x in to.spread(13):
        width = to.random.uniform(1.0, 1.6)
        to.polygon([(x - 1.7 * width, -2), (x - 0.6 * width, 2), (x - 0.5 * width, 35), (x + 0.5 * width, 35),
                    (x + 0.6 * width, 2), (x + 1.7 * width, -2)], "#4b3d2c")  # fmt: skip
        to.polygon(
            [(x + 0.15 * width, 1), (x + 0.2 * width, 35), (x + 0.5 * width, 35), (x + 0.6 * width, 1)], "#5d4c36"
        )
    for x in to.spread(46):
        _bush(to, x, -0.6, to.random.uniform(0.8, 2.0), str(to.random.choice(["#4f7a35", "#5c8a3c", "#436b30"])))
    to.ridge(-1.2, -0.3, "#5f7a3c", (5, 14))


def _beach(to: Painting) -> None:
    to.sky((-10, "#f0d9a8"), (0, "#e9f6f2"), (9, "#8fd3ee"), (35, "#2d8fd2"))
    to.glow(38, 16, 24, "#fffbe6", 0.9)
    to.disc(38, 16, 1.5, "#fffef4")
    for x in to.spread(5):
        to.cloud(x, to.random.uniform(6, 12), to.random.uniform(8, 15), "#ffffff", 0.85)
    to.rectangle(0, -10, PERIOD, 0.9, "#2aa4c4")
    to.ridge(0.9, 2.3, "#6fa79a", (1, 3))
    to.rectangle(0, -10, PERIOD, 0.85, "#2f9fc6")
    to.rectangle(0, -10, PERIOD, 0.3, "#45b9d2")
    for x in to.spread(90):
        y, wide = to.random.uniform(-0.1, 0.75), to.random.uniform(0.4, 1.6)
        to.line([(x, y), (x + wide, y)], "#a6e3ea", 0.05)
    for x in (66, 71):
        to.polygon([(x, 1.0), (x, 3.4), (x + 1.5, 1.25)], "#ffffff")
        to.polygon([(x - 0.7, 0.95), (x + 1.3, 0.95), (x + 0.9, 0.6), (x - 0.4, 0.6)], "#c7553f")
    to.ridge(-0.9, -0.3, "#fbfdfa", (4, 12))
    to.ridge(-1.3, -0.6, "#f0d9a8", (4, 12))
    for x, high, lean in ((16, 9.5, 2.2), (22, 7.0, -1.8), (101, 10.5, -2.6), (109, 7.5, 1.6)):
        _palm(to, x, high, lean)


def _desert(to: Painting) -> None:
    to.sky((-10, "#e0a863"), (0, "#fbe3b4"), (9, "#f6c98b"), (35, "#5e9ccb"))
    to.glow(72, 9, 26, "#fff3cf", 0.95)
    to.disc(72, 9, 1.9, "#fffaf0")
    for x, wide, high in ((18, 9, 6.5), (33, 5, 4.5), (93, 11, 7.5), (109, 5, 5)):
        _mesa(to, x, wide, high)
    to.haze(-1, 5, "#fbe3b4", 0.5)
    to.ridge(0.8, 3.0, "#e9b06b", (1, 4))
    to.ridge(0.3, 1.8, "#dd9d58", (1, 5))
    to.ridge(-0.6, 0.6, "#e0a863", (2, 5))
    for x, high in ((24, 3.6), (46, 2.4), (84, 4.4), (100, 2.6)):
        _cactus(to, x, high)


def _snow(to: Painting) -> None:
    to.sky((-10, "#eef4fa"), (0, "#f4e9ee"), (7, "#cfe0f2"), (35, "#6f9fd0"))
    to.glow(86, 8, 24, "#fff4e4", 0.8)
    for low, high, shade, light in ((4, 12, "#9db8d6", "#f4f8fd"), (2.5, 8, "#b9cde3", "#ffffff")):
        for x in to.spread(8):
            tall, wide = to.random.uniform(low + 1, high), to.random.uniform(7, 12)
            to.polygon([(x - wide, 0), (x, tall), (x + wide, 0)], shade)
            to.polygon([(x, tall), (x - wide, 0), (x - 0.3 * wide, 0), (x - 0.1 * wide, 0.45 * tall)], light)
        to.haze(-1, 8, "#f4eef3", 0.5)
    to.ridge(0.8, 2.2, "#e3edf7", (2, 6))
    for x in to.spread(60):
        _pine(to, x, to.random.uniform(0.6, 1.4), to.random.uniform(1.5, 3.0), "#6f93a8", "#dfeaf4")
    to.ridge(0.0, 1.1, "#eef4fa", (2, 6))
    for x in to.spread(17):
        if abs(x - 60) > 9:
            _pine(to, x, -0.3, to.random.uniform(4.5, 8.5), "#3f6b6c", "#f7fbff")
    to.ridge(-0.9, -0.1, "#eef4fa", (3, 9))
    for x in to.spread(420):
        to.disc(x, to.random.uniform(0, 30), to.random.uniform(0.03, 0.1), "#ffffff")


def _castle(to: Painting) -> None:
    to.sky((-10, "#a79c8a"), (0, "#fde3c8"), (9, "#f3b8a6"), (35, "#5a6fb0"))
    to.glow(98, 10, 26, "#fff0c8", 0.9)
    for x in to.spread(5):
        to.cloud(x, to.random.uniform(9, 18), to.random.uniform(8, 15), "#ffe9dc", 0.8)
    to.ridge(2, 5, "#b7a3bf", (1, 5))
    to.ridge(1, 3, "#93a07f", (2, 7))
    for x, wide, high, roof in ((60, 5, 13, "#5b4a7a"), (49, 3, 15.5, "#6a5690"), (71, 3, 14.5, "#6a5690")):
        _tower(to, x, wide, high, roof, "#cbbca4")
    _wall(to, 0, PERIOD, 5.2, "#bcae97")
    for x in (8, 32, 88, 112):
        _tower(to, x, 5, 8.5, "#8e4f4f", "#c9bba4")
    for x in (20, 44, 76, 100):
        _banner(to, x, 4.4, str(to.random.choice(["#b03a48", "#2f5fa0"])))
    to.rectangle(56.5, -1, 63.5, 3.0, "#6d6353")
    to.disc(60, 3.0, 3.5, "#6d6353")
    to.rectangle(57.2, -1, 62.8, 3.0, "#4b3426")
    to.disc(60, 3.0, 2.8, "#4b3426")
    for x in (58.3, 59.4, 60.6, 61.7):
        to.rectangle(x - 0.05, -1, x + 0.05, 5.2, "#38261b")
    to.rectangle(0, -10, PERIOD, -0.6, "#a79c8a")


def _city(to: Painting) -> None:
    to.sky((-10, "#6d7078"), (0, "#ffd9ae"), (8, "#f59f8c"), (20, "#8a6aa8"), (35, "#3d4f8f"))
    to.glow(60, 3, 30, "#fff0c4", 0.95)
    for count, low, high, color, lit in (
        (26, 7, 15, "#b58aa5", 0.0), (24, 5, 12, "#7f6a92", 0.25), (18, 3.5, 8.5, "#4d4a6c", 0.4),
    ):  # fmt: skip
        for x in to.spread(count):
            _building(to, x, to.random.uniform(1.6, 3.4), to.random.uniform(low, high), color, lit)
        to.haze(-1, 9, "#ffc9a0", 0.35)
    to.rectangle(0, -10, PERIOD, 0.5, "#3f4152")
    for x in to.spread(26):
        _round_tree(to, x, 0.2, to.random.uniform(1.2, 2.1), "#3b4d4c", "#4d6355")
    for x in np.arange(5, PERIOD, 15).tolist():
        to.rectangle(x - 0.07, 0, x + 0.07, 5.0, "#2c2e3b")
        to.glow(x, 5.1, 2.2, "#fff3c4", 0.8)
        to.disc(x, 5.1, 0.28, "#fff9e0")
    to.rectangle(0, -10, PERIOD, -0.1, "#8b8c92")
    to.rectangle(0, -10, PERIOD, -0.5, "#6d7078")


def _night(to: Painting) -> None:
    to.sky((-10, "#22344a"), (0, "#41608c"), (9, "#24406e"), (35, "#0b1633"))
    _stars(to, 500, 2)
    to.glow(82, 14, 17, "#cfe0ff", 0.75)
    to.disc(82, 14, 2.6, "#f4f3e2")
    for x, y, r in ((81.2, 14.6, 0.55), (82.9, 13.4, 0.75), (82.4, 15.4, 0.35)):
        to.disc(x, y, r, "#dddcc8")
    to.ridge(2.5, 6.0, "#2c4a74", (1, 5))
    to.ridge(1.2, 3.6, "#223b5e", (2, 7))
    for x in to.spread(70):
        _pine(to, x, to.random.uniform(0.4, 1.4), to.random.uniform(1.4, 3.6), "#172c47", "#1d3453")
    to.ridge(-0.2, 1.1, "#1d3048", (2, 6))
    to.polygon([(28, 0.6), (28, 2.6), (29.6, 3.9), (31.2, 2.6), (31.2, 0.6)], "#101e33")
    to.rectangle(28.6, 1.3, 29.3, 2.1, "#ffd98a")
    to.rectangle(29.9, 1.3, 30.6, 2.1, "#ffd98a")
    to.glow(29.6, 1.7, 3.5, "#ffcf7a", 0.5)
    to.ridge(-1.0, -0.2, "#22344a", (3, 8))
    for x in to.spread(30):
        y = to.random.uniform(-1.5, 2.5)
        to.glow(x, y, 0.5, "#f2ffb0", 0.9)


def _stage(to: Painting) -> None:
    to.sky((-10, "#a8703f"), (0, "#2a0d14"), (35, "#12060a"))
    for left in np.arange(0, PERIOD, 2.5).tolist():
        for step, color in enumerate(("#4d0c17", "#7a1522", "#a31d2c", "#b9283a", "#a31d2c", "#7a1522", "#5c101b")):
            to.rectangle(left + step * 0.36, 0.4, left + (step + 1) * 0.36 + 0.05, 35, color)
    to.haze(-1, 4, "#1a0508", 0.5)
    for left in np.arange(0, PERIOD, 10).tolist():
        curve = np.linspace(0, np.pi, 15)
        hem = [(left + 10 * a / np.pi, 15.5 - 3.2 * np.sin(a)) for a in curve]
        to.polygon([(left, 35), *hem, (left + 10, 35)], "#8b1827")
        to.polygon([(left, 35), *[(x, y + 1.6) for x, y in hem], (left + 10, 35)], "#a31d2c")
        to.line(hem, "#e8b84a", 0.35)
    for x in (45, 75):
        to.glow(x, 6, 17, "#ffd9a0", 0.45, 0.8)
    to.rectangle(0, -10, PERIOD, 0.5, "#5c3a20")
    to.rectangle(0, -10, PERIOD, 0.2, "#a8703f")


def _space(to: Painting) -> None:
    to.sky((-10, "#8d8f98"), (0, "#161a33"), (12, "#0d1026"), (35, "#05060f"))
    for _ in range(9):
        x, y = to.random.uniform(0, PERIOD), to.random.uniform(6, 28)
        to.glow(x, y, to.random.uniform(9, 20), str(to.random.choice(["#5b3a8c", "#2b4b9b", "#8c3a6b"])), 0.4, 0.5)
    _stars(to, 900, 0)
    to.glow(42, 13, 11, "#6fb7ff", 0.55)
    to.disc(42, 13, 5.2, "#2f78c4")
    for x, y, r, flat in ((40.5, 15, 2.2, 0.5), (43.8, 12.2, 1.7, 0.7), (41, 10.4, 1.6, 0.4)):
        to.disc(x, y, r, "#4f9c62", flat)
    for x, y, r in ((42, 16.4, 2.6), (40, 12.7, 2.4), (44, 10.2, 2.2)):
        to.disc(x, y, r, "#e8f2fb", 0.12)
    to.disc(88, 20, 1.9, "#e0b070")
    to.line([(84.6, 19.0), (91.4, 21.0)], "#f0d8a8", 0.22)
    to.ridge(1.0, 4.8, "#55575f", (2, 6), sharp=True)
    to.ridge(0.2, 2.2, "#73757e", (2, 6))
    to.ridge(-0.8, 0.5, "#8d8f98", (2, 6))
    for x in to.spread(30):
        y = to.random.uniform(-4, -0.7)
        to.disc(x, y, 0.5 - 0.15 * y, "#74767f", 0.22)
        to.disc(x, y - 0.06, 0.42 - 0.13 * y, "#7f818a", 0.18)


def _underwater(to: Painting) -> None:
    to.sky((-10, "#b9b98a"), (0, "#2a8fa8"), (10, "#1f86b5"), (35, "#8fe0ee"))
    for x in to.spread(10):
        to.beam([(x, 35), (x + 3, 35), (x - 3, -2), (x - 9, -2)], "#d9fbff", 0.2, 1.0)
    to.ridge(2, 7, "#2b84a0", (2, 7))
    to.ridge(1, 4, "#2c7a8c", (3, 9))
    for x in to.spread(14):
        _coral(to, x, to.random.uniform(1.5, 4), str(to.random.choice(["#e8788a", "#f0a35e", "#c77dd8", "#f2cf63"])))
    for x in to.spread(40):
        _seaweed(to, x, to.random.uniform(2.5, 9), str(to.random.choice(["#2f8f6a", "#3fa574", "#27785f"])))
    for x in to.spread(16):
        _fish(to, x, to.random.uniform(4, 17), to.random.uniform(0.5, 1.3),
              str(to.random.choice(["#ffb347", "#ff7f6e", "#ffe27a", "#8fd8ff"])))  # fmt: skip
    for x in to.spread(60):
        to.disc(x, to.random.uniform(1, 30), to.random.uniform(0.08, 0.28), "#c9f3fa")
    to.ridge(-0.8, 0.5, "#b9b98a", (3, 9))


def _round_tree(to: Painting, x: float, y: float, size: float, dark: str, light: str) -> None:
    to.rectangle(x - 0.06 * size, y - 0.3, x + 0.06 * size, y + 0.5 * size, "#6b5138")
    for dx, dy, r, color in ((-0.22, 0.62, 0.3, dark), (0.24, 0.6, 0.28, dark), (0, 0.8, 0.36, dark),
                             (-0.08, 0.86, 0.25, light), (-0.22, 0.68, 0.16, light)):  # fmt: skip
        to.disc(x + dx * size, y + dy * size, r * size, color, 0.9)


def _pine(to: Painting, x: float, y: float, size: float, dark: str, light: str) -> None:
    to.rectangle(x - 0.035 * size, y - 0.3, x + 0.035 * size, y + 0.2 * size, "#5a4634")
    for low, high, wide in ((0.12, 0.52, 0.27), (0.36, 0.76, 0.21), (0.6, 1.0, 0.14)):
        to.polygon([(x - wide * size, y + low * size), (x, y + high * size), (x + wide * size, y + low * size)], dark)
        to.polygon([(x - 0.6 * wide * size, y + (low + 0.4 * (high - low)) * size), (x, y + high * size),
                    (x + 0.35 * wide * size, y + (low + 0.65 * (high - low)) * size)], light)  # fmt: skip


def _bush(to: Painting, x: float, y: float, size: float, color: str) -> None:
    for dx, r in ((-0.6, 0.6), (0.0, 0.85), (0.65, 0.6)):
        to.disc(x + dx * size, y, r * size, color)


def _palm(to: Painting, x: float, high: float, lean: float) -> None:
    trunk = [(x + lean * t**2, -1 + (high + 1) * t) for t in np.linspace(0, 1, 9)]
    for width, ((x0, y0), (x1, y1)) in zip(np.linspace(0.5, 0.28, 8), pairwise(trunk), strict=True):
        to.line([(x0, y0), (x1, y1)], "#8a6844", float(width))
    top_x, top_y = trunk[-1]
    for angle, color in zip(np.radians([-25, 20, 60, 115, 155, 205]), ["#2f7d4a", "#3f9858"] * 3, strict=True):
        length = 0.42 * high
        t = np.linspace(0, 1, 9)
        spine_x, spine_y = top_x + length * t * np.cos(angle), top_y + length * (t * np.sin(angle) - 0.55 * t**2)
        width = 0.09 * high * np.sin(np.pi * t**0.7)
        upper, lower = zip(spine_x, spine_y + width, strict=True), zip(spine_x, spine_y - 0.3 * width, strict=True)
        to.polygon([*upper, *reversed(list(lower))], color)


def _mesa(to: Painting, x: float, wide: float, high: float) -> None:
    to.polygon([(x - wide, 0), (x - 0.62 * wide, 0.5 * high), (x - 0.55 * wide, high), (x + 0.5 * wide, high),
                (x + 0.58 * wide, 0.5 * high), (x + wide, 0)], "#b5643f")  # fmt: skip
    to.polygon([(x + 0.05 * wide, high), (x + 0.5 * wide, high), (x + 0.58 * wide, 0.5 * high), (x + wide, 0),
                (x + 0.3 * wide, 0)], "#9c5436")  # fmt: skip
    for share in (0.62, 0.8):
        to.line([(x - 0.57 * wide, share * high), (x + 0.54 * wide, share * high)], "#c97d55", 0.12)


def _cactus(to: Painting, x: float, high: float) -> None:
    arms = ([(x, -0.8), (x, high)], [(x, 0.4 * high), (x - 0.3 * high, 0.45 * high), (x - 0.3 * high, 0.75 * high)],
            [(x, 0.3 * high), (x + 0.26 * high, 0.35 * high), (x + 0.26 * high, 0.62 * high)])  # fmt: skip
    for arm in arms:
        to.line(arm, "#4f7d4a", 0.13 * high)
        to.disc(*arm[-1], 0.065 * high, "#4f7d4a")
    to.line([(x - 0.025 * high, -0.5), (x - 0.025 * high, high)], "#66985c", 0.03 * high)


def _tower(to: Painting, x: float, wide: float, high: float, roof: str, stone: str) -> None:
    to.rectangle(x - wide / 2, -1, x + wide / 2, high, stone)
    to.rectangle(x + 0.18 * wide, -1, x + wide / 2, high, "#a8997f")
    to.polygon([(x - 0.68 * wide, high), (x, high + 1.1 * wide), (x + 0.68 * wide, high)], roof)
    to.rectangle(x - 0.58 * wide, high - 0.5, x + 0.58 * wide, high, "#8f8069")
    for share in (0.45, 0.75):
        to.rectangle(x - 0.09 * wide, share * high, x + 0.09 * wide, share * high + 1.0, "#4a3b30")
        to.disc(x, share * high + 1.0, 0.09 * wide, "#4a3b30")
    tip = high + 1.1 * wide
    to.rectangle(x - 0.05, tip, x + 0.05, tip + 1.5, "#4a3b30")
    to.polygon([(x, tip + 1.5), (x + 1.6, tip + 1.15), (x, tip + 0.8)], "#c8414f")


def _wall(to: Painting, left: float, right: float, high: float, stone: str) -> None:
    to.rectangle(left, -1, right, high, stone)
    for x in np.arange(left, right, 1.5).tolist():
        to.rectangle(x, high, x + 0.8, high + 0.8, stone)
    for row, y in enumerate(np.arange(-0.4, high, 0.62).tolist()):
        to.line([(left, y), (right, y)], "#a3957e", 0.06)
        for x in np.arange(left + 0.8 * (row % 2), right, 1.6).tolist():
            to.line([(x, y), (x, y + 0.62)], "#a3957e", 0.05)


def _banner(to: Painting, x: float, high: float, color: str) -> None:
    to.polygon([(x - 0.8, high), (x + 0.8, high), (x + 0.8, high - 3), (x, high - 2.4), (x - 0.8, high - 3)], color)
    to.disc(x, high - 1.2, 0.42, "#f2d27a")


def _building(to: Painting, x: float, wide: float, high: float, color: str, lit: float) -> None:
    to.rectangle(x - wide / 2, -1, x + wide / 2, high, color)
    if to.random.random() < 0.4:
        to.rectangle(x - 0.06, high, x + 0.06, high + 1.4, color)
    if lit:
        for y in np.arange(0.8, high - 0.5, 0.7).tolist():
            for left in np.arange(x - wide / 2 + 0.25, x + wide / 2 - 0.4, 0.55).tolist():
                if to.random.random() < lit:
                    to.rectangle(
                        left, y, left + 0.26, y + 0.36, str(to.random.choice(["#ffd27a", "#ffe7b0", "#f6b35e"]))
                    )


def _stars(to: Painting, count: int, low: float) -> None:
    for _ in range(count):
        x, y, r = to.random.uniform(0, PERIOD), to.random.uniform(low, 34), 0.03 + 0.09 * to.random.random() ** 4
        to.disc(x, y, r, str(to.random.choice(["#ffffff", "#dfe9ff", "#fff1d6"])))


def _coral(to: Painting, x: float, size: float, color: str) -> None:
    for angle in np.radians(to.random.uniform(35, 145, 7)):
        length = size * to.random.uniform(0.6, 1.0)
        tip = (x + length * float(np.cos(angle)), -0.3 + length * float(np.sin(angle)))
        to.line([(x, -0.5), tip], color, 0.16 * size)
        to.disc(*tip, 0.11 * size, color)


def _seaweed(to: Painting, x: float, high: float, color: str) -> None:
    t, phase = np.linspace(0, 1, 13), to.random.uniform(0, 6)
    way = x + 0.5 * np.sin(5 * t + phase)
    left, right = way - 0.3 * (1 - t), way + 0.3 * (1 - t)
    heights = -0.6 + (high + 0.6) * t
    to.polygon([*zip(left, heights, strict=True), *reversed(list(zip(right, heights, strict=True)))], color)


def _fish(to: Painting, x: float, y: float, size: float, color: str) -> None:
    side = 1 if to.random.random() < 0.5 else -1
    back, tail = x - side * 0.7 * size, x - side * 1.5 * size
    to.polygon([(back, y), (tail, y + 0.6 * size), (tail, y - 0.6 * size)], color)
    to.disc(x, y, size, color, 0.55)
    to.disc(x + side * 0.5 * size, y + 0.12 * size, 0.14 * size, "#ffffff")
    to.disc(x + side * 0.54 * size, y + 0.12 * size, 0.07 * size, "#202838")


SETS: dict[FilmSet, PaintedSet] = {
    "studio": PaintedSet(_studio, lambda: speckled("#dedbd5", 0, 0.4), "day"),
    "meadow": PaintedSet(_meadow, lambda: speckled("#8fbf5c", 1, 7.0), "day"),
    "forest": PaintedSet(_forest, lambda: speckled("#5f7a3c", 2, 9.0), "overcast"),
    "beach": PaintedSet(_beach, lambda: speckled("#f0d9a8", 3, 4.0), "day"),
    "desert": PaintedSet(_desert, lambda: speckled("#e0a863", 4, 4.0), "evening"),
    "snow": PaintedSet(_snow, lambda: speckled("#eef4fa", 5, 2.0), "overcast"),
    "castle": PaintedSet(_castle, lambda: slabs("#a79c8a", 6, 8, 6), "evening"),
    "city": PaintedSet(_city, lambda: slabs("#6d7078", 7, 6, 6, 14.0, 3.0), "evening"),
    "night": PaintedSet(_night, lambda: speckled("#22344a", 8, 8.0), "night"),
    "stage": PaintedSet(_stage, lambda: slabs("#a8703f", 9, 16, 1), "spotlight"),
    "space": PaintedSet(_space, lambda: speckled("#8d8f98", 10, 8.0, 2), "spotlight"),
    "underwater": PaintedSet(_underwater, lambda: speckled("#b9b98a", 11, 6.0), "water"),
}
"""All sets by their names."""
