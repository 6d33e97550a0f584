"""A dome of lights around a mesh, and the light that reaches a point.

Each light has a depth map of the mesh, which shows what the light reaches. Shadows, the dark of folds and the contact
with the ground are then one sum over the lights.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.rasteriser import camera_axes, pixel_matrix, rasterise, transform
from puppetline.compiled import compiled

MAP_SIZE = 256
"""Width and height of a light's depth map, in pixels."""
SKY, KEY = (0.36, 0.40, 0.47), (1.22, 1.10, 0.95)
"""Linear RGB irradiance of the overcast sky on the floor, and of the key light on a surface that faces it."""
KEY_AZIMUTH, KEY_ELEVATION = -40.0, 52.0
"""Direction of the key light, over the camera's left shoulder, in degrees."""
KEY_RADIUS = 6.0
"""Angular radius of the key light, in degrees; it softens the shadow."""

_SKY_LIGHTS, _KEY_LIGHTS = 28, 20
_GOLDEN_ANGLE = 180 * (3 - 5**0.5)  # degrees


class Lights(NamedTuple):
    """A dome of k lights with their depth maps of a mesh.

    Attributes
    ----------
    directions : (k, 3) float32
        Unit vectors towards the lights.
    irradiances : (k, 3) float32
        Linear RGB on a surface that faces the light.
    matrices : (k, 3, 4) float32
        Maps of points to pixels of the depth maps and depths.
    depths : (k, m, m) float32
        Depth maps, in pixels, with m = `MAP_SIZE`.
    """

    directions: NDArray[np.float32]
    irradiances: NDArray[np.float32]
    matrices: NDArray[np.float32]
    depths: NDArray[np.float32]

    def irradiance(self, points: NDArray[np.float32], normals: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the (p, 3) linear RGB light that reaches (p, 3) points with unit normals."""
        light: NDArray[np.float32] = _irradiance(points, normals, *self)
        return light


def _dome() -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return the (k, 2) azimuths and elevations, in degrees, for a camera at azimuth 0, and (k, 3) irradiances."""
    sky, key = np.arange(_SKY_LIGHTS), np.arange(_KEY_LIGHTS)
    # The lights are denser towards the zenith, where an overcast sky is brighter. With sin e = √u, the mean of sin e is
    # 2/3, so a weight of 3/2 lights the floor with SKY.
    sky_angles = np.column_stack([sky * _GOLDEN_ANGLE, np.degrees(np.arcsin(np.sqrt((sky + 0.5) / _SKY_LIGHTS)))])
    around, distance = np.radians(key * _GOLDEN_ANGLE), KEY_RADIUS * np.sqrt((key + 0.5) / _KEY_LIGHTS)
    # Meridians converge upwards, so the key light is round only if it is stretched in azimuth.
    offset = np.column_stack([np.cos(around) / np.cos(np.radians(KEY_ELEVATION)), np.sin(around)]) * distance[:, None]
    irradiances = np.repeat(
        [np.array(SKY) * 3 / 2 / _SKY_LIGHTS, np.array(KEY) / _KEY_LIGHTS], [_SKY_LIGHTS, _KEY_LIGHTS], axis=0
    )
    key_angles = np.array([KEY_AZIMUTH, KEY_ELEVATION]) + offset
    return np.vstack([sky_angles, key_angles]), irradiances.astype(np.float32)


def dome_lights(mesh: NDArray[np.float64], triangles: NDArray[np.int64], azimuth: float) -> Lights:
    """Return the lights for a camera's azimuth, in degrees, with their depth maps of (n, 3) vertices and triangles."""
    angles, irradiances = _dome()
    center = (mesh.min(axis=0) + mesh.max(axis=0)) / 2
    radius = 1.02 * float(np.linalg.norm(mesh - center, axis=1).max())
    axes = [camera_axes(azimuth + beside, elevation) for beside, elevation in angles]
    matrices = [pixel_matrix(a, center, radius, MAP_SIZE, MAP_SIZE) for a in axes]
    depths = np.array([rasterise(transform(each, mesh), triangles, MAP_SIZE, MAP_SIZE)[1] for each in matrices])
    return Lights(np.array([a[2] for a in axes], np.float32), irradiances, np.array(matrices, np.float32), depths)


@compiled
def _irradiance(points, normals, directions, irradiances, matrices, depths):
    out = np.zeros((len(points), 3), np.float32)
    size = depths.shape[1]
    for k in range(len(directions)):
        dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
        red, green, blue = irradiances[k, 0], irradiances[k, 1], irradiances[k, 2]
        matrix, depth = matrices[k], depths[k]
        # Points are lifted off the surface by 1.5 texels; otherwise the surface would shade itself between texels.
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
