"""The rasteriser: which triangle each pixel of an orthographic camera shows, and how deep it is."""

import numpy as np
from numpy.typing import NDArray

from puppetline.compiled import compiled


@compiled
def rasterise(screen, triangles, width, height):
    """Find the nearest triangle at the centre of each pixel.

    Parameters
    ----------
    screen : (n, 3) float64
        Vertices: pixels to the right, down and away from the viewer.
    triangles : (t, 3) int64
    width, height : int

    Returns
    -------
    shown : (height, width) int32
        Index of the triangle, −1 for none.
    depth : (height, width) float32
        Depth at the pixel's centre, infinite for none.
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
                # The tolerance closes the seam of two triangles whose common edge crosses the pixel's centre.
                if a >= -1e-9 and b >= -1e-9 and c >= -1e-9:
                    z = np.float32(a * screen[i, 2] + b * screen[j, 2] + c * screen[k, 2])
                    if z < depth[row, column]:
                        depth[row, column] = z
                        shown[row, column] = t
    return shown, depth


def barycentric(triangles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return the (p, 3) barycentric coordinates of (p, 2) points in (p, 3, 2) triangles, one triangle per point."""
    a, b, c = np.moveaxis(triangles - points[:, None], 1, 0)
    twice_areas = np.stack([_cross(b, c), _cross(c, a), _cross(a, b)], axis=1)
    return (twice_areas / twice_areas.sum(axis=1, keepdims=True)).astype(np.float32)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
