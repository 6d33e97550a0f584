"""The light of films: a key light and the sky, whose shadows are soft, and light from the ground."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.camera import orthographic
from engine_bridge.pictures.kernels import inner, kernel, shared
from engine_bridge.pictures.surroundings import Lighting, StageExtent

KEY_SIZES, SKY_SIZE = (512, 1024, 2048), 128
"""Widths and heights of the depth maps of the key light, of which one is chosen, and of the sky, in texels."""

PENUMBRA_TEXELS = 3
"""Minimum radius in texels of the soft edge of the key light's shadow, if the largest map has it."""

OUTER_SAMPLES, INNER_SAMPLES = 5, 6
"""Samples of the depth maps for a point: around it, and inside where these differ."""

KEY_PENUMBRA, SKY_PENUMBRA = 0.018, 0.09
"""Radii of the soft edges of the shadows of the key light and of the sky, as shares of `StageExtent.size`."""

LIFT = 0.006
"""Distance off a surface from which light is looked up, as a share of `StageExtent.size`; nearer, it shades itself."""

_ANGLES = np.arange(OUTER_SAMPLES + INNER_SAMPLES) * np.pi * (3 - 5**0.5)
_RADII = np.sqrt(np.concatenate([np.ones(OUTER_SAMPLES), (np.arange(INNER_SAMPLES) + 0.5) / INNER_SAMPLES]))
_DISC = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)]) * _RADII[:, None]


class DepthMap(NamedTuple):
    """What a light reaches.

    Attributes
    ----------
    depths : (r, c) float32
        The depth, from 0 to 1, of what casts shadows, at each texel of the part of the map in which something does.
    corner : (2,) int64
        Column and row of its first texel in the map.
    matrix : (4, 3) float32
        Map of points to columns, rows and depths.
    blur : (2,) float64
        Radius of the soft edges of shadows, in columns and rows.
    """

    depths: NDArray[np.float32]
    corner: NDArray[np.int64]
    matrix: NDArray[np.float32]
    blur: NDArray[np.float64]


class Lights(NamedTuple):
    """The light on a stage; colours are those of `Lighting`.

    Attributes
    ----------
    key, sky : DepthMap
    towards : (3,) float64
        Unit vector towards the key light.
    key_color, sky_color, ground_color : (3,) float64
    lift : float
        Distance off a surface from which light is looked up, in metres.
    """

    key: DepthMap
    sky: DepthMap
    towards: NDArray[np.float64]
    key_color: NDArray[np.float64]
    sky_color: NDArray[np.float64]
    ground_color: NDArray[np.float64]
    lift: float


def lights_of(
    lighting: Lighting, stage: StageExtent, points: NDArray[np.float32], casting: NDArray[np.int32]
) -> Lights:
    """Return the light on a stage on which triangles (t, 3) between points (n, 3) cast shadows."""
    towards = np.array(lighting.direction) / np.linalg.norm(lighting.direction)
    half = float(orthographic(towards, stage.center, stage.radius, stage.height).half.max())
    texels = PENUMBRA_TEXELS * 2 * half / (KEY_PENUMBRA * stage.size)
    size = next((each for each in KEY_SIZES if each >= texels), KEY_SIZES[-1])
    up = np.array([0.0, 1.0, 0.0])
    key_color, sky_color, ground_color = np.array([lighting.key, lighting.sky, lighting.ground])
    return Lights(
        _depth_map(towards, stage, size, KEY_PENUMBRA, points, casting),
        _depth_map(up, stage, SKY_SIZE, SKY_PENUMBRA, points, casting),
        towards,
        key_color,
        sky_color,
        ground_color,
        LIFT * stage.size + 3 * half / size,
    )


def _depth_map(
    direction: NDArray[np.float64],
    stage: StageExtent,
    size: int,
    penumbra: float,
    points: NDArray[np.float32],
    casting: NDArray[np.int32],
) -> DepthMap:
    light = orthographic(direction, stage.center, stage.radius, stage.height)
    # from −1 … 1 to texels, and depths from 0 to 1
    scale = np.array([size / 2, size / 2, 1 / 2], np.float32)
    matrix: NDArray[np.float32] = (light.matrix[:, :3] + light.matrix[:, 3:]) * scale
    projected = points @ matrix[:3] + matrix[3]
    across, down = np.ascontiguousarray(projected[:, :2].T)  # of which NumPy finds extremes 40 times as fast
    low = np.clip(np.floor([across.min(), down.min()]), 0, size).astype(np.int64)
    high = np.clip(np.ceil([across.max(), down.max()]), low, size).astype(np.int64)
    columns, rows = high - low
    depths = np.full((rows, columns), np.inf, np.float32)
    cast(projected, casting, low, depths)
    return DepthMap(depths, low, matrix, penumbra * stage.size / (2 * light.half) * size)


@kernel
def cast(projected, casting, corner, depths):
    """Draw triangles (t, 3) between points (n, 3) of a map into a part of it that begins at a corner."""
    rows, columns = depths.shape
    for t in range(len(casting)):
        i, j, k = casting[t, 0], casting[t, 1], casting[t, 2]
        ax, ay, az = projected[i, 0] - corner[0], projected[i, 1] - corner[1], projected[i, 2]
        bx, by, bz = projected[j, 0] - corner[0], projected[j, 1] - corner[1], projected[j, 2]
        cx, cy, cz = projected[k, 0] - corner[0], projected[k, 1] - corner[1], projected[k, 2]
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0:
            continue
        first = max(0, int(np.ceil(min(ax, bx, cx) - 0.5)))
        last = min(columns - 1, int(np.floor(max(ax, bx, cx) - 0.5)))
        top = max(0, int(np.ceil(min(ay, by, cy) - 0.5)))
        bottom = min(rows - 1, int(np.floor(max(ay, by, cy) - 0.5)))
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(first, last + 1):
                x = column + 0.5
                b = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
                c = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
                if b >= 0 and c >= 0 and b + c <= 1:
                    depth = np.float32(az + b * (bz - az) + c * (cz - az))
                    if depth < depths[row, column]:
                        depths[row, column] = depth


@inner
def _is_hidden(depths, row, column, depth):
    rows, columns = depths.shape
    return 0 <= row < rows and 0 <= column < columns and depth > depths[row, column]


@inner
def _hidden(depths, x, y, depth):
    """Return the share of a light that does not reach a point, interpolated between four texels."""
    column, row = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
    across, down = x - 0.5 - column, y - 0.5 - row
    upper = (1 - across) * _is_hidden(depths, row, column, depth) + across * _is_hidden(depths, row, column + 1, depth)
    row += 1
    lower = (1 - across) * _is_hidden(depths, row, column, depth) + across * _is_hidden(depths, row, column + 1, depth)
    return (1 - down) * upper + down * lower


@inner
def _lit(light, x, y, z):
    """Return the share of a light that reaches a point (3), softly.

    It is looked up at points on a disc that are evenly dense (Vogel 1979), so that the edge of a shadow is soft without
    grain. Where the outermost ones agree, no others are taken.
    """
    depths, m = light.depths, light.matrix
    column = m[0, 0] * x + m[1, 0] * y + m[2, 0] * z + m[3, 0] - light.corner[0]
    row = m[0, 1] * x + m[1, 1] * y + m[2, 1] * z + m[3, 1] - light.corner[1]
    depth = m[0, 2] * x + m[1, 2] * y + m[2, 2] * z + m[3, 2]
    wide, high = light.blur[0], light.blur[1]
    if not (-wide - 1 < column < depths.shape[1] + wide + 1 and -high - 1 < row < depths.shape[0] + high + 1):
        return 1.0
    hidden = 0
    for k in range(OUTER_SAMPLES):
        i, j = int(np.floor(row + high * _DISC[k, 1])), int(np.floor(column + wide * _DISC[k, 0]))
        hidden += _is_hidden(depths, i, j, depth)
    if hidden == 0 or hidden == OUTER_SAMPLES:
        return 1.0 - hidden / OUTER_SAMPLES
    total = 0.0
    for k in range(len(_DISC)):
        total += _hidden(depths, column + wide * _DISC[k, 0], row + high * _DISC[k, 1], depth)
    return 1 - total / len(_DISC)


@shared
def irradiance(lights, x, y, z, nx, ny, nz, lift):
    """Return the linear RGB light on a point (3) of a surface with a unit normal (3)."""
    towards = lights.towards
    cosine = nx * towards[0] + ny * towards[1] + nz * towards[2]
    key = 0.0
    if cosine > 0:
        key = cosine * _lit(lights.key, x + lift * nx, y + lift * ny, z + lift * nz)
    up = 0.5 + 0.5 * ny
    open_sky = _lit(lights.sky, x + 2 * lift * nx, y + 2 * lift * ny, z + 2 * lift * nz)
    sky, ground = up * (0.35 + 0.65 * open_sky), 1 - up
    return (
        key * lights.key_color[0] + sky * lights.sky_color[0] + ground * lights.ground_color[0],
        key * lights.key_color[1] + sky * lights.sky_color[1] + ground * lights.ground_color[1],
        key * lights.key_color[2] + sky * lights.sky_color[2] + ground * lights.ground_color[2],
    )
