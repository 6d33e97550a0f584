"""Painting of landscapes and rooms around a stage, as a panorama, and of floors."""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFilter

PERIOD = 120.0
"""Degrees after which a panorama repeats."""

TOP, BOTTOM = 35.0, -10.0
"""Elevations at the upper and lower edge of a panorama, in degrees."""

PIXELS_PER_DEGREE, SUPERSAMPLING = 25.6, 2
"""Resolution of a panorama, about that of a video of 720p, and how much finer it is painted."""

FLOOR_PIXELS = 512
"""Width and height of a floor's picture, in pixels."""

Point = tuple[float, float]


class Painting:
    """A panorama that is painted from the back to the front, in degrees: to the right, and above the horizon.

    What leaves it on one side comes in on the other.

    Parameters
    ----------
    seed : int
        Of everything that is random.
    """

    def __init__(self, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        self._scale = PIXELS_PER_DEGREE * SUPERSAMPLING
        self._size = round(PERIOD * self._scale), round((TOP - BOTTOM) * self._scale)
        self._image = Image.new("RGB", self._size)
        self._pen = ImageDraw.Draw(self._image)

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """(h, w, 4): the picture, with the upper row first."""
        return np.asarray(self._image.reduce(SUPERSAMPLING).convert("RGBA"))

    def sky(self, *stops: tuple[float, str]) -> None:
        """Fill everything with colours at elevations, from the lowest to the highest one, and mixtures between them."""
        heights = TOP - np.arange(self._size[1]) / self._scale
        colors = np.array([ImageColor.getrgb(color) for _, color in stops])
        levels = [level for level, _ in stops]
        column = np.column_stack([np.interp(heights, levels, channel) for channel in colors.T])
        noise = self.random.uniform(0, 1, (self._size[1], 64, 1))  # no bands of one colour
        strip = Image.fromarray((column[:, None] + noise).clip(0, 255).astype(np.uint8))
        for left in range(0, self._size[0], 64):
            self._image.paste(strip, (left, 0))

    def polygon(self, points: Iterable[Point], color: str) -> None:
        """Fill a polygon."""
        pixels = [self._at(point) for point in points]
        for shift in self._shifts([x for x, _ in pixels]):
            self._pen.polygon([(x + shift, y) for x, y in pixels], color)

    def rectangle(self, left: float, low: float, right: float, high: float, color: str) -> None:
        """Fill a rectangle."""
        self.polygon([(left, low), (right, low), (right, high), (left, high)], color)

    def disc(self, x: float, y: float, radius: float, color: str, flat: float = 1.0) -> None:
        """Fill an ellipse, whose height is its width times `flat`."""
        (cx, cy), r = self._at((x, y)), radius * self._scale
        for shift in self._shifts([cx - r, cx + r]):
            self._pen.ellipse([cx + shift - r, cy - r * flat, cx + shift + r, cy + r * flat], color)

    def line(self, points: Sequence[Point], color: str, width: float) -> None:
        """Draw a line that is some degrees wide."""
        pixels = [self._at(point) for point in points]
        for shift in self._shifts([x for x, _ in pixels]):
            self._pen.line([(x + shift, y) for x, y in pixels], color, round(width * self._scale), "curve")

    def glow(self, x: float, y: float, radius: float, color: str, strength: float, flat: float = 1.0) -> None:
        """Add light around a point, from 0 at the radius to a strength up to 1 at the point."""
        side = 128
        away = np.hypot(*np.meshgrid(*[np.linspace(-1, 1, side)] * 2))
        mask = Image.fromarray((255 * strength * np.clip(1 - away, 0, 1) ** 2).astype(np.uint8))
        (cx, cy), r = self._at((x, y)), radius * self._scale
        mask = mask.resize((round(2 * r), max(round(2 * r * flat), 1)), Image.Resampling.BILINEAR)
        for shift in self._shifts([cx - r, cx + r]):
            self._image.paste(color, (round(cx - r + shift), round(cy - r * flat)), mask)

    def haze(self, low: float, high: float, color: str, strength: float) -> None:
        """Cover the lower part with a colour, from a strength up to 1 at an elevation to nothing at a higher one."""
        heights = TOP - np.arange(self._size[1]) / self._scale
        shares = strength * np.clip((high - heights) / (high - low), 0, 1)
        mask = Image.fromarray((255 * shares).astype(np.uint8)[:, None]).resize(self._size)
        self._image.paste(color, (0, 0), mask)

    def beam(self, points: Sequence[Point], color: str, strength: float, blur: float = 0.4) -> None:
        """Add a polygon of light with soft edges."""
        mask = Image.new("L", (self._size[0] // 8, self._size[1] // 8))
        pixels = [(x / 8, y / 8) for x, y in map(self._at, points)]
        for shift in (-mask.width, 0, mask.width):
            ImageDraw.Draw(mask).polygon([(x + shift, y) for x, y in pixels], round(255 * strength))
        soft = mask.filter(ImageFilter.GaussianBlur(blur * self._scale / 8))
        left, top, right, bottom = soft.getbbox() or (0, 0, 1, 1)
        part = soft.crop((left, top, right, bottom)).resize((8 * (right - left), 8 * (bottom - top)))
        self._image.paste(color, (8 * left, 8 * top), part)

    def cloud(self, x: float, y: float, width: float, color: str, strength: float = 0.9) -> None:
        """Draw a cloud with a flat lower side."""
        side = round(width * self._scale)
        mask = Image.new("L", (side, side // 2))
        pen = ImageDraw.Draw(mask)
        for share in np.linspace(0.15, 0.85, 9):
            r = side * (0.05 + 0.13 * (1 - (2 * share - 1) ** 2)) * self.random.uniform(0.75, 1.15)
            cx, cy = side * share, side * 0.36 - r * 0.55
            pen.ellipse([cx - r, cy - r, cx + r, cy + r], round(255 * strength))
        pen.rectangle([0, side * 0.36, side, side], 0)
        mask = mask.filter(ImageFilter.GaussianBlur(side * 0.008))
        cx, cy = self._at((x, y))
        for shift in self._shifts([cx - side / 2, cx + side / 2]):
            self._image.paste(color, (round(cx + shift - side / 2), round(cy - side * 0.36)), mask)

    def ridge(self, low: float, high: float, color: str, waves: tuple[int, int] = (2, 7), sharp: bool = False) -> None:
        """Fill everything below a line of hills, or of sharp mountains, between two elevations."""
        x = np.linspace(0, PERIOD, 1201)
        y = np.zeros_like(x)
        for count in range(waves[0], waves[1] * 3 if sharp else waves[1]):
            wave = np.sin(2 * np.pi * (count * x / PERIOD + self.random.random()))
            y += (1 - 2 * np.abs(wave) if sharp else wave) / count
        y = low + (high - low) * (y - y.min()) / np.ptp(y)
        self.polygon([(0, BOTTOM), *zip(x.tolist(), y.tolist(), strict=True), (PERIOD, BOTTOM)], color)

    def spread(self, count: int, low: float = 0.0, high: float = PERIOD) -> list[float]:
        """Return positions from left to right that are random and nowhere close together."""
        steps = (np.arange(count) + self.random.uniform(0.15, 0.85, count)) / count
        positions: list[float] = (low + (high - low) * steps).tolist()
        return positions

    def _at(self, point: Point) -> Point:
        return point[0] * self._scale, (TOP - point[1]) * self._scale

    def _shifts(self, xs: Sequence[float]) -> list[int]:
        """Return by how many pixels something is drawn again on the other sides."""
        width = self._size[0]
        return [shift for shift in (-width, 0, width) if min(xs) + shift < width and max(xs) + shift > 0]


def speckled(color: str, seed: int, contrast: float = 10.0, grain: int = 1) -> NDArray[np.uint8]:
    """Return a floor (n, n, 4) with soft patches and grains: grass, sand, snow or earth."""
    random = np.random.default_rng(seed)
    shade = np.zeros((FLOOR_PIXELS, FLOOR_PIXELS))
    for size, weight in ((grain, 0.8), (4 * grain, 0.6), (16 * grain, 0.4), (64, 0.5)):
        noise = random.normal(size=(FLOOR_PIXELS // size,) * 2)
        tiled = Image.fromarray(np.tile(noise, (3, 3)).astype(np.float32)).resize((3 * FLOOR_PIXELS,) * 2)
        shade += weight * np.asarray(tiled)[FLOOR_PIXELS : 2 * FLOOR_PIXELS, FLOOR_PIXELS : 2 * FLOOR_PIXELS]
    return _colored(color, contrast * shade)


def slabs(
    color: str, seed: int, rows: int, columns: int, joint: float = 40.0, contrast: float = 7.0
) -> NDArray[np.uint8]:
    """Return a floor (n, n, 4) of slabs or planks with dark joints, every other row shifted by half a slab."""
    random = np.random.default_rng(seed)
    y, x = np.mgrid[:FLOOR_PIXELS, :FLOOR_PIXELS] / FLOOR_PIXELS
    row = (y * rows).astype(int)
    along = (x * columns + 0.5 * (row % 2)) % columns
    shade = contrast * random.normal(size=(rows, columns))[row, along.astype(int)]
    edge = np.minimum(y * rows % 1 * FLOOR_PIXELS / rows, along % 1 * FLOOR_PIXELS / columns)
    return _colored(color, np.where(edge < 2.5, -joint, shade + random.normal(size=shade.shape)))


def _colored(color: str, shade: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return a colour (n, n, 4) that is lighter or darker; its mean is the colour."""
    base = np.array(ImageColor.getrgb(color)[:3])
    shaded = base + (shade - shade.mean())[..., None] * base / 128
    return np.pad(np.rint(shaded).clip(0, 255).astype(np.uint8), ((0, 0), (0, 0), (0, 1)), constant_values=255)
