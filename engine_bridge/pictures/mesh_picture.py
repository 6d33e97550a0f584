"""Pictures of a mesh in soft light on a light background."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.camera import Camera
from engine_bridge.pictures.geometry import CLAY, LINEAR, OPAQUE, Geometry, Surfaces, are_fine
from engine_bridge.pictures.renderer import Renderer
from engine_bridge.pictures.surroundings import Lighting, StageExtent, Surroundings
from engine_bridge.pictures.textures import textures_of
from engine_bridge.pictures.view import View, camera_axes
from puppetline.compiled import compiled

BACKDROP_TOP, BACKDROP_BOTTOM = (0.88, 0.89, 0.91), (0.72, 0.725, 0.74)
"""Linear RGB colours of the background at the top and at the bottom."""

SOFT_EDGE_COSINE = np.cos(np.radians(40))
"""Cosine of the largest angle between two triangles whose common edge is shaded smoothly."""

KEY_AZIMUTH, KEY_ELEVATION = -40.0, 52.0
"""Direction of the key light, over the camera's left shoulder, in degrees."""

AWAY = 1000.0
"""Distance of the camera, in radii of the view, from which perspective cannot be seen."""


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
    floor = np.array([0.0, view.ground or 0.0, 0.0])
    mesh, triangles = np.asarray(vertices, np.float64) - floor, np.ascontiguousarray(faces, np.int64)
    around = Surroundings(
        np.dstack([backdrop(size), np.full(size[::-1], 255, np.uint8)]),
        has_floor=view.ground is not None and view.elevation > 0,
        floor_hides=False,
        lighting=Lighting(direction=tuple(camera_axes(view.azimuth + KEY_AZIMUTH, KEY_ELEVATION)[2].tolist())),
    )
    target = np.array(view.center) - floor
    eye = target + AWAY * view.radius * camera_axes(view.azimuth, view.elevation)[2]
    height = 2 * view.radius * size[1] / min(size)
    camera = Camera(eye, target, 2 * np.degrees(np.arctan(height / 2 / (AWAY * view.radius))))
    moved = mesh[triangles].reshape(-1, 3).astype(np.float32), _corner_normals(mesh, triangles)
    shown = Renderer(size).draw(camera, _stage(mesh), _geometry(mesh, triangles, colors), [moved], around)
    return np.ascontiguousarray(shown[..., :3])


def backdrop(size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return the background of `render`, (height, width, 3) uint8 sRGB."""
    light = np.linspace(BACKDROP_TOP, BACKDROP_BOTTOM, size[1])[:, None]
    encoded = np.rint(255 * (1.055 * light ** (1 / 2.4) - 0.055)).astype(np.uint8)  # IEC 61966-2-1
    return np.ascontiguousarray(encoded.repeat(size[0], axis=1))


def _stage(mesh: NDArray[np.float64]) -> StageExtent:
    """Return the space of vertices (n, 3), for lights."""
    low, high = mesh.min(axis=0), mesh.max(axis=0)
    middle, size = (low + high) / 2, max(float(np.linalg.norm(high - low)), 1e-9)
    bottom = min(float(low[1]), 0.0)  # of the floor
    radius, height = float(np.hypot(*(high - low)[[0, 2]])) / 2, float(high[1]) - bottom
    return StageExtent(np.array([middle[0], bottom, middle[2]]), radius + 1e-3 * size, height + 1e-3 * size, size)


def _geometry(mesh: NDArray[np.float64], triangles: NDArray[np.int64], colors: NDArray[np.floating] | None) -> Geometry:
    """Return triangles (t, 3) of vertices (n, 3), each with corners of its own."""
    count = 3 * len(triangles)
    corners = np.arange(count, dtype=np.int32).reshape(-1, 3)
    opaque = np.ones((count, 4), np.float32)
    opaque[:, :3] = CLAY if colors is None else np.asarray(colors)[triangles.reshape(-1)]
    surfaces = Surfaces(
        triangles=corners,
        part=np.zeros(len(triangles), np.int32),
        colors=opaque,
        uv=np.zeros((count, 2), np.float32),
        image=np.array([-1], np.int32),
        opacity=np.array([OPAQUE], np.int8),
        cutoff=np.zeros(1, np.float32),
        unlit=np.array([False]),
        two_sided=np.array([True]),
        fine=np.array([are_fine(mesh, triangles, float(np.ptp(mesh, axis=0).max()))]),
        textures=textures_of([], LINEAR),
    )
    return Geometry(surfaces, corners, [0, count], [np.zeros(0, np.int32)])


def _corner_normals(mesh: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return unit normals (3 t, 3) at the corners of triangles, on their sides, which are smooth across soft edges.

    Vertices at one position count as one, so texture seams do not show.
    """
    # one number per point, because sorting rows takes ten times as long
    x, y, z = mesh.T
    places = np.unique(x + np.e * y + np.pi * z, return_inverse=True)[1][triangles]
    around = np.argsort(places.ravel(), kind="stable") // 3
    starts = np.searchsorted(np.sort(places.ravel()), np.arange(places.max(initial=0) + 2))
    a, b, c = np.moveaxis(mesh[triangles], 1, 0)
    flat = np.cross(b - a, c - a)
    summed = np.empty((len(triangles), 3, 3))
    _sum_around(flat, np.sqrt((flat * flat).sum(axis=1)), places, starts, around, summed)
    normals = summed.reshape(-1, 3)
    return (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)).astype(np.float32)


@compiled
def _sum_around(flat, length, places, starts, around, out):
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
