"""Pictures of a mesh without a graphics card: a software renderer, and a sheet of labelled tiles.

One kernel draws a mesh's depth. Seen from the camera, that says which triangle a pixel shows; seen from each light of
a dome, it says what the light reaches. Shadows, the dark of folds and the contact with the ground are then one sum
over the lights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from puppetline.compiled import compiled
from puppetline.files import written_whole

SUPERSAMPLING = 2
MAP_SIZE = 256
"""Pixels along the side of a light's depth map."""

CLAY = (0.60, 0.40, 0.27)
"""Linear colour of a mesh without colours."""
BACKDROP_TOP, BACKDROP_BOTTOM = (0.88, 0.89, 0.91), (0.72, 0.725, 0.74)
"""Linear colours between which the background fades."""
SKY, KEY, BOUNCE = (0.36, 0.40, 0.47), (1.22, 1.10, 0.95), (0.20, 0.18, 0.16)
"""Linear irradiance of the overcast sky from all around, of the key light head-on, and of the ground from below."""
SKY_LIGHTS, KEY_LIGHTS = 28, 20
KEY_AZIMUTH, KEY_ELEVATION, KEY_SPREAD = -40.0, 52.0, 6.0
"""Degrees: the key light from over the camera's left shoulder, and its angular radius, which softens the shadow."""
GOLDEN_ANGLE = 180 * (3 - 5**0.5)

SOFT = np.cos(np.radians(40))
"""Cosine of the angle between two triangles up to which their edge is soft."""

GAP, LABEL_HEIGHT, TITLE_HEIGHT = 10, 30, 52
"""Pixels around the tiles of a sheet, for the label under each and for the title above all."""
PAPER, INK = (250, 250, 251), (52, 54, 60)


@dataclass(frozen=True, slots=True)
class View:
    """An orthographic camera, in the mesh's coordinates with y up.

    Attributes
    ----------
    azimuth, elevation : float
        Degrees. At 0, 0 the camera looks along −z at a character that faces +z; a positive azimuth takes it towards +x,
        a positive elevation upwards.
    center : tuple of 3 floats
        The point in the middle of the picture.
    radius : float
        From the middle to the nearer edges of the picture.
    ground : float or None
        Height of the floor that receives the shadow; None for no floor.
    """

    azimuth: float
    elevation: float
    center: tuple[float, float, float]
    radius: float
    ground: float | None = None

    @classmethod
    def around(
        cls,
        points: NDArray[np.floating],
        azimuth: float = 25.0,
        elevation: float = 12.0,
        size: tuple[int, int] = (1, 1),
    ) -> Self:
        """Frame all points, those of one mesh or of a whole clip, with a margin and on a floor under the lowest.

        Parameters
        ----------
        points : (..., 3) float
        azimuth, elevation : float
            Degrees, see `View`.
        size : tuple of 2 ints
            Width and height of the picture; only their ratio counts.
        """
        flat = np.reshape(points, (-1, 3))
        axes = _axes(azimuth, elevation)
        seen = flat @ axes.T
        low, high = seen.min(axis=0), seen.max(axis=0)
        x, y, z = axes.T @ ((low + high) / 2)
        needed = (high - low)[:2] * min(size) / np.array(size)
        return cls(azimuth, elevation, (x, y, z), 1.12 * float(needed.max()) / 2, float(flat[:, 1].min()))


def render(
    vertices: NDArray[np.floating],
    faces: NDArray[np.integer],
    view: View,
    size: tuple[int, int],
    colors: NDArray[np.floating] | None = None,
) -> NDArray[np.uint8]:
    """Draw a mesh in soft light on a light background.

    Parameters
    ----------
    vertices : (n, 3) float
        y up.
    faces : (t, 3) int
        Triangles; either side is drawn.
    view : View
    size : tuple of 2 ints
        Width and height in pixels.
    colors : (n, 3) float, optional
        Linear RGB from 0 to 1 a vertex.

    Returns
    -------
    (height, width, 3) uint8
        sRGB. The same input always gives the same picture.
    """
    width, height = size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING
    mesh = np.ascontiguousarray(vertices, np.float64)
    triangles = np.ascontiguousarray(faces, np.int64)
    axes = _axes(view.azimuth, view.elevation)
    screen = _apply(_to_pixels(axes, np.array(view.center), view.radius, width, height), mesh)
    shown, _ = rasterise(screen, triangles, width, height)
    lights = _light_up(mesh, triangles, view.azimuth)

    image = _backdrop(width, height)
    if view.ground is not None and view.elevation > 0:
        shade = _floor_shade(view, view.ground, axes, size, lights)
        image *= shade.repeat(SUPERSAMPLING, axis=0).repeat(SUPERSAMPLING, axis=1)

    row, column = np.nonzero(shown >= 0)
    corners = triangles[shown[row, column]]
    share = barycentric(screen[corners, :2], np.column_stack([column + 0.5, row + 0.5]))
    normals = _facing_normals(mesh, triangles, shown[row, column], share, axes[2])
    light = _irradiance(_interpolate(mesh, corners, share), normals, *lights)
    light += np.array(BOUNCE, np.float32) * (1 - normals[:, 1:2]) / 2
    albedo = np.array(CLAY, np.float32) if colors is None else _interpolate(colors, corners, share)
    image[row, column] = albedo * light
    return _to_srgb(image.reshape(size[1], SUPERSAMPLING, size[0], SUPERSAMPLING, 3).mean(axis=(1, 3)))


def backdrop(size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return what `render` shows where there is nothing, (height, width, 3) uint8 sRGB."""
    return _to_srgb(_backdrop(*size))


def _backdrop(width: int, height: int) -> NDArray[np.float32]:
    image = np.empty((height, width, 3), np.float32)
    image[:] = np.linspace(BACKDROP_TOP, BACKDROP_BOTTOM, height)[:, None]
    return image


def project(points: NDArray[np.floating], view: View, size: tuple[int, int]) -> NDArray[np.float64]:
    """Say where `render` shows points.

    Parameters
    ----------
    points : (n, 3) float
    view : View
    size : tuple of 2 ints
        Width and height in pixels.

    Returns
    -------
    (n, 3) float64
        Pixels right of, below and behind the picture's top left corner.
    """
    axes = _axes(view.azimuth, view.elevation)
    return _apply(_to_pixels(axes, np.array(view.center), view.radius, *size), np.asarray(points, np.float64))


def contact_sheet(
    images: Sequence[NDArray[np.uint8]], labels: Sequence[str], columns: int, path: Path, title: str = ""
) -> None:
    """Write a PNG with all images in rows, each with its label under it.

    Parameters
    ----------
    images : sequence of (h, w, 3) uint8
        All of one size.
    labels : sequence of str
        One an image.
    columns : int
        Images in a row.
    path : Path
        Replaced only once the new picture is complete.
    title : str
        Stands above all; empty for none.

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


@compiled
def rasterise(screen, triangles, width, height):
    """Return (height, width) int32 nearest triangle, −1 for none, and float32 depth in the middle of each pixel.

    Parameters
    ----------
    screen : (n, 3) float64
        Pixels to the right, down and away from the viewer.
    triangles : (t, 3) int64
    """
    shown = np.full((height, width), -1, np.int32)
    depth = np.full((height, width), np.inf, np.float32)
    for t in range(len(triangles)):
        i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
        ax, ay, bx, by, cx, cy = screen[i, 0], screen[i, 1], screen[j, 0], screen[j, 1], screen[k, 0], screen[k, 1]
        first_column = max(0, int(np.ceil(min(ax, bx, cx) - 0.5)))
        last_column = min(width - 1, int(np.floor(max(ax, bx, cx) - 0.5)))
        first_row = max(0, int(np.ceil(min(ay, by, cy) - 0.5)))
        last_row = min(height - 1, int(np.floor(max(ay, by, cy) - 0.5)))
        if first_column > last_column or first_row > last_row:
            continue
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if area == 0:
            continue
        for row in range(first_row, last_row + 1):
            y = row + 0.5
            for column in range(first_column, last_column + 1):
                x = column + 0.5
                a = ((bx - x) * (cy - y) - (cx - x) * (by - y)) / area
                b = ((cx - x) * (ay - y) - (ax - x) * (cy - y)) / area
                c = 1 - a - b
                # The slack closes the seam of two triangles whose common edge crosses the middle of a pixel.
                if a >= -1e-9 and b >= -1e-9 and c >= -1e-9:
                    z = np.float32(a * screen[i, 2] + b * screen[j, 2] + c * screen[k, 2])
                    if z < depth[row, column]:
                        depth[row, column] = z
                        shown[row, column] = t
    return shown, depth


def barycentric(triangles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the (p, 3) shares that the corners of (p, 3, 2) triangles have in (p, 2) points, a triangle for each."""
    a, b, c = np.moveaxis(triangles - points[:, None], 1, 0)
    twice_areas = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
    return (twice_areas / twice_areas.sum(axis=1, keepdims=True)).astype(np.float32)


def _axes(azimuth: float, elevation: float) -> NDArray[np.float64]:
    """Return the (3, 3) rows right, up and towards the viewer of somebody who looks from there at the origin."""
    a, e = np.radians([azimuth, elevation])
    right = np.array([np.cos(a), 0, -np.sin(a)])
    towards = np.array([np.sin(a) * np.cos(e), np.sin(e), np.cos(a) * np.cos(e)])
    return np.array([right, np.cross(towards, right), towards])


def _to_pixels(
    axes: NDArray[np.floating], center: NDArray[np.float64], radius: float, width: int, height: int
) -> NDArray[np.float64]:
    """Return the (3, 4) map of points to pixels right of, below and behind the picture's top left corner."""
    linear: NDArray[np.float64] = min(width, height) / (2 * radius) * axes * [[1], [-1], [-1]]
    return np.column_stack([linear, [width / 2, height / 2, 0] - linear @ center])


def _apply(matrix: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    return points @ matrix[:, :3].T + matrix[:, 3]


def _interpolate(
    values: NDArray[np.floating], corners: NDArray[np.int64], share: NDArray[np.float32]
) -> NDArray[np.float32]:
    return np.einsum("pk,pkc->pc", share, values.astype(np.float32)[corners])


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _facing_normals(
    mesh: NDArray[np.float64],
    triangles: NDArray[np.int64],
    shown: NDArray[np.integer],
    share: NDArray[np.float32],
    towards: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return (p, 3) unit normals on the viewer's side of a triangle even if it is wound the other way.

    They are smooth but for hard edges, and know no seams of texture.
    """
    # one number a point: rows would take ten times as long to sort
    x, y, z = mesh.T
    place_of = np.unique(x + np.e * y + np.pi * z, return_inverse=True)[1]
    places = place_of[triangles]
    around = np.argsort(places.ravel(), kind="stable") // 3
    starts = np.searchsorted(np.sort(places.ravel()), np.arange(places.max() + 2))
    a, b, c = np.moveaxis(mesh[triangles], 1, 0)
    flat = np.cross(b - a, c - a)
    smooth = np.empty((len(triangles), 3, 3))
    _corner_normals(flat, places, starts, around, smooth)
    smooth = np.einsum("pk,pkx->px", share, smooth[shown])
    side = np.where(flat[shown] @ towards < 0, -1.0, 1.0)
    return (smooth * (side / np.maximum(np.linalg.norm(smooth, axis=1), 1e-300))[:, None]).astype(np.float32)


@compiled
def _corner_normals(flat, places, starts, around, out):
    """Sum, for each corner of each triangle, the normals of those around it across soft edges, on its own side."""
    length = np.sqrt((flat * flat).sum(axis=1))
    for t in range(len(flat)):
        for k in range(3):
            place = places[t, k]
            out[t, k] = flat[t]
            for j in range(starts[place], starts[place + 1]):
                other = around[j]
                cosine = flat[t, 0] * flat[other, 0] + flat[t, 1] * flat[other, 1] + flat[t, 2] * flat[other, 2]
                if other != t and abs(cosine) > SOFT * length[t] * length[other]:
                    out[t, k] += flat[other] if cosine > 0 else -flat[other]


def _floor_shade(
    view: View, ground: float, axes: NDArray[np.float64], size: tuple[int, int], lights: "_Lights"
) -> NDArray[np.float32]:
    """Return the (h, w, 3) part of the dome's light that the mesh leaves to the floor seen through each pixel."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    spread = min(size) / (2 * view.radius)
    plane = np.stack([(x - size[0] / 2) / spread, (size[1] / 2 - y) / spread], axis=-1) @ axes[:2] + view.center
    floor = plane - ((plane[..., 1:2] - ground) / axes[2, 1]) * axes[2]
    points = floor.reshape(-1, 3).astype(np.float32)
    light = _irradiance(points, np.tile(np.array([0, 1, 0], np.float32), (len(points), 1)), *lights)
    return (light / (lights.directions[:, 1] @ lights.irradiances)).reshape(size[1], size[0], 3)


class _Lights(NamedTuple):
    """A dome of lights: (k, 3) unit directions, (k, 3) irradiances head-on, and what each sees of the mesh.

    A depth map, one of (k, m, m), is in pixels as (k, 3, 4) matrices bring points there, with m = `MAP_SIZE`.
    """

    directions: NDArray[np.float32]
    irradiances: NDArray[np.float32]
    matrices: NDArray[np.float32]
    depths: NDArray[np.float32]


def _dome() -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return the (k, 2) azimuths and elevations of the lights, for a camera at azimuth 0, and (k, 3) irradiances."""
    sky, key = np.arange(SKY_LIGHTS), np.arange(KEY_LIGHTS)
    # Denser towards the zenith, where an overcast sky is brighter. With sin e = √u the mean of sin e is 2/3, so that a
    # weight of 3/2 lights the floor with SKY.
    sky_angles = np.column_stack([sky * GOLDEN_ANGLE, np.degrees(np.arcsin(np.sqrt((sky + 0.5) / SKY_LIGHTS)))])
    around, distance = np.radians(key * GOLDEN_ANGLE), KEY_SPREAD * np.sqrt((key + 0.5) / KEY_LIGHTS)
    # Meridians draw together upwards; stretched in azimuth, the key light stays round.
    offset = np.column_stack([np.cos(around) / np.cos(np.radians(KEY_ELEVATION)), np.sin(around)]) * distance[:, None]
    irradiances = np.repeat(
        [np.array(SKY) * 3 / 2 / SKY_LIGHTS, np.array(KEY) / KEY_LIGHTS], [SKY_LIGHTS, KEY_LIGHTS], axis=0
    )
    key_angles = np.array([KEY_AZIMUTH, KEY_ELEVATION]) + offset
    return np.vstack([sky_angles, key_angles]), irradiances.astype(np.float32)


def _light_up(mesh: NDArray[np.float64], triangles: NDArray[np.int64], azimuth: float) -> _Lights:
    """Let each light of the dome, which turns with the camera's azimuth, look at the mesh."""
    angles, irradiances = _dome()
    center = (mesh.min(axis=0) + mesh.max(axis=0)) / 2
    radius = 1.02 * float(np.linalg.norm(mesh - center, axis=1).max())
    axes = [_axes(azimuth + beside, elevation) for beside, elevation in angles]
    matrices = [_to_pixels(a, center, radius, MAP_SIZE, MAP_SIZE) for a in axes]
    return _Lights(
        np.array([a[2] for a in axes], np.float32),
        irradiances,
        np.array(matrices, np.float32),
        np.array([rasterise(_apply(matrix, mesh), triangles, MAP_SIZE, MAP_SIZE)[1] for matrix in matrices]),
    )


def _to_srgb(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode linear light by the transfer function of IEC 61966-2-1."""
    light = np.clip(linear, 0, 1)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(encoded * 255).astype(np.uint8)


@compiled
def _irradiance(points, normals, directions, irradiances, matrices, depths):
    """Return the (p, 3) float32 light that reaches (p, 3) points with unit normals, given the parts of `_Lights`."""
    out = np.zeros((len(points), 3), np.float32)
    size = depths.shape[1]
    for k in range(len(directions)):
        dx, dy, dz = directions[k]
        red, green, blue = irradiances[k]
        matrix, depth = matrices[k], depths[k]
        # Lifted off the surface by a texel and a half, or it would shade itself between the pixels of the map.
        lift = np.float32(1.5) / np.sqrt(matrix[0, 0] ** 2 + matrix[0, 1] ** 2 + matrix[0, 2] ** 2)
        for p in range(len(points)):
            nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
            cosine = nx * dx + ny * dy + nz * dz
            if cosine <= 0:
                continue
            x, y, z = points[p, 0] + lift * nx, points[p, 1] + lift * ny, points[p, 2] + lift * nz
            column = int(np.floor(matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]))
            row = int(np.floor(matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]))
            if 0 <= column < size and 0 <= row < size:
                behind = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
                if behind > depth[row, column] + 1:
                    continue
            out[p, 0] += red * cosine
            out[p, 1] += green * cosine
            out[p, 2] += blue * cosine
    return out
