"""A software renderer: draws a mesh in soft light, without a graphics card."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.lighting import Lights, dome_lights
from engine_bridge.pictures.rasteriser import barycentric, camera_axes, interpolate, pixel_matrix, rasterise, transform
from puppetline.compiled import compiled

SUPERSAMPLING = 2
"""Samples per pixel along each axis."""
CLAY = (0.60, 0.40, 0.27)
"""Linear RGB colour of a mesh without colours."""
BOUNCE = (0.20, 0.18, 0.16)
"""Linear RGB irradiance from the ground on a surface that faces down."""
BACKDROP_TOP, BACKDROP_BOTTOM = (0.88, 0.89, 0.91), (0.72, 0.725, 0.74)
"""Linear RGB colours of the background at the top and at the bottom."""

SOFT_EDGE_COSINE = np.cos(np.radians(40))
"""Cosine of the largest angle between two triangles whose common edge is shaded smoothly."""


@dataclass(frozen=True, slots=True)
class View:
    """An orthographic camera, in the mesh's coordinates with y up.

    Attributes
    ----------
    azimuth, elevation : float
        Degrees. At 0, 0 the camera looks along −z at a character that faces +z. A positive azimuth moves the camera
        towards +x, a positive elevation upwards.
    center : tuple of 3 floats
        The point in the centre of the image.
    radius : float
        Distance from the centre to the nearer edges of the image, in the mesh's units.
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
        """Return the view that frames all points with a margin, on a floor at the height of the lowest point.

        Parameters
        ----------
        points : (..., 3) float
            Vertices of a mesh, or of all frames of a clip.
        azimuth, elevation : float
            Degrees, see `View`.
        size : tuple of 2 ints
            Width and height of the image; only their ratio counts.
        """
        flat = np.reshape(points, (-1, 3))
        axes = camera_axes(azimuth, elevation)
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
        Triangles; both sides are drawn.
    view : View
    size : tuple of 2 ints
        Width and height in pixels.
    colors : (n, 3) float, optional
        Linear RGB per vertex, from 0 to 1.

    Returns
    -------
    (height, width, 3) uint8
        sRGB. The same input always gives the same image.
    """
    width, height = size[0] * SUPERSAMPLING, size[1] * SUPERSAMPLING
    mesh = np.ascontiguousarray(vertices, np.float64)
    triangles = np.ascontiguousarray(faces, np.int64)
    axes = camera_axes(view.azimuth, view.elevation)
    screen = transform(pixel_matrix(axes, np.array(view.center), view.radius, width, height), mesh)
    shown, _ = rasterise(screen, triangles, width, height)
    lights = dome_lights(mesh, triangles, view.azimuth)

    image = _backdrop(width, height)
    if view.ground is not None and view.elevation > 0:
        shade = _floor_shade(view, view.ground, axes, size, lights)
        image *= shade.repeat(SUPERSAMPLING, axis=0).repeat(SUPERSAMPLING, axis=1)

    row, column = np.nonzero(shown >= 0)
    corners = triangles[shown[row, column]]
    share = barycentric(screen[corners, :2], np.column_stack([column + 0.5, row + 0.5]))
    normals = _facing_normals(mesh, triangles, shown[row, column], share, axes[2])
    light = lights.irradiance(interpolate(mesh, corners, share), normals)
    light += np.array(BOUNCE, np.float32) * (1 - normals[:, 1:2]) / 2
    albedo = np.array(CLAY, np.float32) if colors is None else interpolate(colors, corners, share)
    image[row, column] = albedo * light
    return _to_srgb(image.reshape(size[1], SUPERSAMPLING, size[0], SUPERSAMPLING, 3).mean(axis=(1, 3)))


def backdrop(size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the background of `render`, (height, width, 3) uint8 sRGB."""
    return _to_srgb(_backdrop(*size))


def _backdrop(width: int, height: int) -> NDArray[np.float32]:
    image = np.empty((height, width, 3), np.float32)
    image[:] = np.linspace(BACKDROP_TOP, BACKDROP_BOTTOM, height)[:, None]
    return image


def project(points: NDArray[np.floating], view: View, size: tuple[int, int]) -> NDArray[np.float64]:
    """Return where `render` shows points.

    Parameters
    ----------
    points : (n, 3) float
    view : View
    size : tuple of 2 ints
        Width and height in pixels.

    Returns
    -------
    (n, 3) float64
        Pixels right of, below and behind the image's top left corner.
    """
    axes = camera_axes(view.azimuth, view.elevation)
    return transform(pixel_matrix(axes, np.array(view.center), view.radius, *size), np.asarray(points, np.float64))


def _floor_shade(
    view: View, ground: float, axes: NDArray[np.float64], size: tuple[int, int], lights: Lights
) -> NDArray[np.float32]:
    """Return the (h, w, 3) share of the dome's light that reaches the floor at each pixel."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    spread = min(size) / (2 * view.radius)
    plane = np.stack([(x - size[0] / 2) / spread, (size[1] / 2 - y) / spread], axis=-1) @ axes[:2] + view.center
    floor = plane - ((plane[..., 1:2] - ground) / axes[2, 1]) * axes[2]
    points = floor.reshape(-1, 3).astype(np.float32)
    light = lights.irradiance(points, np.tile(np.array([0, 1, 0], np.float32), (len(points), 1)))
    return (light / (lights.directions[:, 1] @ lights.irradiances)).reshape(size[1], size[0], 3)


def _facing_normals(
    mesh: NDArray[np.float64],
    triangles: NDArray[np.int64],
    shown: NDArray[np.integer],
    share: NDArray[np.float32],
    towards: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Return (p, 3) unit normals on the viewer's side of the triangles that are shown, whatever their winding.

    Normals are smooth except across hard edges. Vertices at one position count as one, so texture seams do not show.
    """
    # one number per point, because sorting rows takes ten times as long
    x, y, z = mesh.T
    place_of = np.unique(x + np.e * y + np.pi * z, return_inverse=True)[1]
    places = place_of[triangles]
    around = np.argsort(places.ravel(), kind="stable") // 3
    starts = np.searchsorted(np.sort(places.ravel()), np.arange(places.max() + 2))
    a, b, c = np.moveaxis(mesh[triangles], 1, 0)
    flat = np.cross(b - a, c - a)
    smooth = np.empty((len(triangles), 3, 3))
    _corner_normals(flat, np.sqrt((flat * flat).sum(axis=1)), places, starts, around, smooth)
    smooth = np.einsum("pk,pkx->px", share, smooth[shown])
    side = np.where(flat[shown] @ towards < 0, -1.0, 1.0)
    return (smooth * (side / np.maximum(np.linalg.norm(smooth, axis=1), 1e-300))[:, None]).astype(np.float32)


@compiled
def _corner_normals(flat, length, places, starts, around, out):
    """Sum, for each corner of each triangle, the normals of the triangles around it across soft edges, on its side."""
    for t in range(len(flat)):
        for k in range(3):
            place = places[t, k]
            x, y, z = flat[t, 0], flat[t, 1], flat[t, 2]
            for j in range(starts[place], starts[place + 1]):
                other = around[j]
                cosine = flat[t, 0] * flat[other, 0] + flat[t, 1] * flat[other, 1] + flat[t, 2] * flat[other, 2]
                if other != t and abs(cosine) > SOFT_EDGE_COSINE * length[t] * length[other]:
                    sign = 1.0 if cosine > 0 else -1.0
                    x, y, z = x + sign * flat[other, 0], y + sign * flat[other, 1], z + sign * flat[other, 2]
            out[t, k, 0], out[t, k, 1], out[t, k, 2] = x, y, z


def _to_srgb(linear: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Encode linear light with the transfer function of IEC 61966-2-1."""
    light = np.clip(linear, 0, 1)
    encoded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(encoded * 255).astype(np.uint8)
