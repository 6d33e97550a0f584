"""Drawing of triangles in perspective, with smooth edges, lit at each pixel.

Triangles are drawn in homogeneous coordinates (Olano and Greer 1997), so that those which reach behind the camera need
no clipping: each edge of a triangle is a linear function of the pixel, which is positive inside. Their sum, if the
triangle's own size is divided out, is the inverse of the distance, and their shares of it are the barycentric
coordinates in space.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.pictures.geometry import BLEND, MASK, Surfaces
from engine_bridge.pictures.kernels import inner, kernel, shared
from engine_bridge.pictures.lights import Lights, irradiance
from engine_bridge.pictures.pixels import encoded, lay
from engine_bridge.pictures.textures import texture


class Moment(NamedTuple):
    """The characters at one moment, as a camera sees them.

    Attributes
    ----------
    surfaces : Surfaces
    points, normals : (n, 3) float32
        Vertices and their unit normals.
    projected : (n, 3) float32
        Column and row of each vertex times its distance from the camera's plane, and this distance.
    eye : (3,) float64
        The camera.
    near : float
        Distance from the camera's plane of the nearest visible point.
    side : float
        1 to leave out what is below the floor, −1 what is above it, 0 nothing.
    lights : Lights
    at_vertices : (2 n, 3) float32
        The light on both sides of each vertex, or its sRGB colour in it, where that is known already; NaN elsewhere.
    """

    surfaces: Surfaces
    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    projected: NDArray[np.float32]
    eye: NDArray[np.float64]
    near: float
    side: float
    lights: Lights
    at_vertices: NDArray[np.float32]


class Samples(NamedTuple):
    """What is seen at samples of the pixels of a frame.

    Attributes
    ----------
    places : (s, 2) float64
        Column and row of the samples in a pixel.
    nearness : (h, w, s) float32
        Inverse distances, from the camera's plane, of the nearest triangles; 0 for none.
    shown : (h, w, s) int32
        Their numbers.
    shares : (h, w, s, 2) float32
        The first two of their barycentric coordinates there, divided by the distance.
    """

    places: NDArray[np.float64]
    nearness: NDArray[np.float32]
    shown: NDArray[np.int32]
    shares: NDArray[np.float32]


@inner
def _corners(projected, triangles, t):
    """Return the projected corners of a triangle: column, row and distance of each."""
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    return (
        np.float64(projected[i, 0]),
        np.float64(projected[i, 1]),
        np.float64(projected[i, 2]),
        np.float64(projected[j, 0]),
        np.float64(projected[j, 1]),
        np.float64(projected[j, 2]),
        np.float64(projected[k, 0]),
        np.float64(projected[k, 1]),
        np.float64(projected[k, 2]),
    )


@inner
def _size(corners):
    """Return the size of a triangle, negative if its corners run counterclockwise in the picture."""
    ax, ay, aw, bx, by, bw, cx, cy, cw = corners
    return ax * (by * cw - bw * cy) + ay * (bw * cx - bx * cw) + aw * (bx * cy - by * cx)


@inner
def _is_turned_here(surfaces, t, corners):
    """Return whether a triangle turns a side that is drawn to the camera."""
    size = _size(corners)
    return size < 0 or (size > 0 and surfaces.two_sided[surfaces.part[t]])


@inner
def _edges(corners):
    """Return the coefficients of a triangle's edges: column, row and constant of each."""
    ax, ay, aw, bx, by, bw, cx, cy, cw = corners
    s = 1 / _size(corners)
    return (
        (by * cw - bw * cy) * s,
        (bw * cx - bx * cw) * s,
        (bx * cy - by * cx) * s,
        (cy * aw - cw * ay) * s,
        (cw * ax - cx * aw) * s,
        (cx * ay - cy * ax) * s,
        (ay * bw - aw * by) * s,
        (aw * bx - ax * bw) * s,
        (ax * by - ay * bx) * s,
    )


@inner
def _bounds(projected, triangles, t, near, window):
    """Return the left, right, upper and lower end of a triangle in a window; it covers it if it reaches the camera."""
    left, top, right, bottom = window[0], window[1], window[2], window[3]
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    aw, bw, cw = projected[i, 2], projected[j, 2], projected[k, 2]
    if aw < near or bw < near or cw < near:
        return float(left), float(right), float(top), float(bottom)
    ax, ay, bx, by = projected[i, 0] / aw, projected[i, 1] / aw, projected[j, 0] / bw, projected[j, 1] / bw
    cx, cy = projected[k, 0] / cw, projected[k, 1] / cw
    return (
        max(min(ax, bx, cx), left),
        min(max(ax, bx, cx), right),
        max(min(ay, by, cy), top),
        min(max(ay, by, cy), bottom),
    )


@inner
def _heights(moment, t):
    """Return the heights of a triangle's corners on the visible side of the floor, or 0 if both are visible."""
    i, j, k = moment.surfaces.triangles[t, 0], moment.surfaces.triangles[t, 1], moment.surfaces.triangles[t, 2]
    return moment.side * moment.points[i, 1], moment.side * moment.points[j, 1], moment.side * moment.points[k, 1]


@inner
def _shares(e, x, y):
    """Return the barycentric coordinates, in space, of the point of a triangle at a point of the picture."""
    # a point beside the triangle counts as one on its edge
    u, v = max(e[0] * x + e[1] * y + e[2], 0.0), max(e[3] * x + e[4] * y + e[5], 0.0)
    w = max(e[6] * x + e[7] * y + e[8], 0.0)
    distance = 1 / max(u + v + w, 1e-30)
    return u * distance, v * distance, w * distance, distance


@shared
def _texture_at(moment, t, x, y):
    """Return the linear colour and opacity of a triangle's texture at a point of the picture; white without one."""
    surfaces = moment.surfaces
    image = surfaces.image[surfaces.part[t]]
    if image < 0:
        return 1.0, 1.0, 1.0, 1.0
    e = _edges(_corners(moment.projected, surfaces.triangles, t))
    u, v, w, distance = _shares(e, x, y)
    i, j, k = surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2]
    uv, level = surfaces.uv, surfaces.textures.levels[image, 0]
    across = u * uv[i, 0] + v * uv[j, 0] + w * uv[k, 0]
    down = u * uv[i, 1] + v * uv[j, 1] + w * uv[k, 1]
    # derivatives by columns and rows
    sum_x, sum_y = e[0] + e[3] + e[6], e[1] + e[4] + e[7]
    ux = (e[0] * uv[i, 0] + e[3] * uv[j, 0] + e[6] * uv[k, 0] - across * sum_x) * level[1]
    vx = (e[0] * uv[i, 1] + e[3] * uv[j, 1] + e[6] * uv[k, 1] - down * sum_x) * level[2]
    uy = (e[1] * uv[i, 0] + e[4] * uv[j, 0] + e[7] * uv[k, 0] - across * sum_y) * level[1]
    vy = (e[1] * uv[i, 1] + e[4] * uv[j, 1] + e[7] * uv[k, 1] - down * sum_y) * level[2]
    stride = distance * np.sqrt(max(ux * ux + vx * vx, uy * uy + vy * vy))
    return texture(surfaces.textures, image, across, down, stride)


@shared
def _opacity(moment, t, x, y):
    """Return the opacity of a triangle at a point of the picture."""
    triangles, colors = moment.surfaces.triangles, moment.surfaces.colors
    u, v, w, _ = _shares(_edges(_corners(moment.projected, triangles, t)), x, y)
    own = u * colors[triangles[t, 0], 3] + v * colors[triangles[t, 1], 3] + w * colors[triangles[t, 2], 3]
    return own * _texture_at(moment, t, x, y)[3]


@inner
def _seen_side(moment, i, j, k):
    """Return 1 where normals of a triangle point to the viewer's side of it, −1 where not, whatever its winding."""
    points, normals, eye = moment.points, moment.normals, moment.eye
    ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    fx, fy, fz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    from_eye = fx * (eye[0] - points[i, 0]) + fy * (eye[1] - points[i, 1]) + fz * (eye[2] - points[i, 2])
    nx, ny = normals[i, 0] + normals[j, 0] + normals[k, 0], normals[i, 1] + normals[j, 1] + normals[k, 1]
    nz = normals[i, 2] + normals[j, 2] + normals[k, 2]
    return -1.0 if from_eye * (fx * nx + fy * ny + fz * nz) < 0 else 1.0


@inner
def _light(moment, side, i, j, k, u, v, w):
    """Return the light on a point of a triangle with corners i, j, k and barycentric coordinates u, v, w."""
    points, normals, lights = moment.points, moment.normals, moment.lights
    x = u * points[i, 0] + v * points[j, 0] + w * points[k, 0]
    y = u * points[i, 1] + v * points[j, 1] + w * points[k, 1]
    z = u * points[i, 2] + v * points[j, 2] + w * points[k, 2]
    nx = u * normals[i, 0] + v * normals[j, 0] + w * normals[k, 0]
    ny = u * normals[i, 1] + v * normals[j, 1] + w * normals[k, 1]
    nz = u * normals[i, 2] + v * normals[j, 2] + w * normals[k, 2]
    scale = side / max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-30)
    return irradiance(lights, x, y, z, nx * scale, ny * scale, nz * scale, lights.lift)


@inner
def _from_vertices(moment, side, t, is_whole, u, v, w):
    """Return the light on a point of a triangle, or its sRGB colour in it, interpolated between its vertices.

    At each vertex, on its side 1 or −1, it is computed once.
    """
    triangles, colors, known = moment.surfaces.triangles, moment.surfaces.colors, moment.at_vertices
    red, green, blue = 0.0, 0.0, 0.0
    for k in range(3):
        i = triangles[t, k]
        row = 2 * i + (side < 0)
        if np.isnan(known[row, 0]):
            r, g, b = _light(moment, side, i, i, i, 1.0, 0.0, 0.0)
            if is_whole:
                r, g, b = encoded(r * colors[i, 0]), encoded(g * colors[i, 1]), encoded(b * colors[i, 2])
            known[row, 0], known[row, 1], known[row, 2] = r, g, b
        share = u if k == 0 else (v if k == 1 else w)
        red, green, blue = red + share * known[row, 0], green + share * known[row, 1], blue + share * known[row, 2]
    return red, green, blue


@inner
def _is_whole(surfaces, part):
    """Return whether a part is coloured as a whole at its vertices."""
    return surfaces.fine[part] and surfaces.image[part] < 0 and not surfaces.unlit[part]


@inner
def _shaded(moment, t, u, v, w, x, y):
    """Return the sRGB colour of a triangle at barycentric coordinates (3), which are at a point of the picture."""
    surfaces = moment.surfaces
    part = surfaces.part[t]
    i, j, k = surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2]
    side = _seen_side(moment, i, j, k) if surfaces.two_sided[part] else 1.0
    is_whole = _is_whole(surfaces, part)
    red, green, blue = 1.0, 1.0, 1.0
    if surfaces.fine[part] and not surfaces.unlit[part]:
        red, green, blue = _from_vertices(moment, side, t, is_whole, u, v, w)
        if is_whole:
            return red, green, blue
    elif not surfaces.unlit[part]:
        red, green, blue = _light(moment, side, i, j, k, u, v, w)
    r, g, b, _ = _texture_at(moment, t, x, y)
    colors = surfaces.colors
    r *= red * (u * colors[i, 0] + v * colors[j, 0] + w * colors[k, 0])
    g *= green * (u * colors[i, 1] + v * colors[j, 1] + w * colors[k, 1])
    b *= blue * (u * colors[i, 2] + v * colors[j, 2] + w * colors[k, 2])
    return encoded(r), encoded(g), encoded(b)


@kernel
def cover(moment, samples, window):
    """Find the nearest triangle at each sample in a window, except for those that are blended with what is behind them.

    Parameters
    ----------
    moment : Moment
    samples : Samples
    window : tuple of 4 ints
        First column and row, and those after the last.
    """
    surfaces, projected, near = moment.surfaces, moment.projected, moment.near
    places, nearness, shown, shares = samples.places, samples.nearness, samples.shown, samples.shares
    greatest = 1 / near
    triangles = surfaces.triangles
    nearness[window[1] : window[3], window[0] : window[2]] = 0
    for t in range(len(triangles)):
        part = surfaces.part[t]
        opacity = surfaces.opacity[part]
        corners = _corners(projected, triangles, t)
        if opacity == BLEND or not _is_turned_here(surfaces, t, corners):
            continue
        left, right, top, bottom = _bounds(projected, triangles, t, near, window)
        if left > right or top > bottom:
            continue
        e0, e1, e2, e3, e4, e5, e6, e7, e8 = _edges(corners)
        ay, by, cy = _heights(moment, t)
        is_cut = min(ay, by, cy) < 0
        for s in range(len(places)):
            dx, dy = places[s, 0], places[s, 1]
            first, last = int(np.ceil(left - dx)), min(int(np.floor(right - dx)), window[2] - 1)
            for row in range(int(np.ceil(top - dy)), min(int(np.floor(bottom - dy)), window[3] - 1) + 1):
                y = row + dy
                begin_u, begin_v, begin_w = e1 * y + e2, e4 * y + e5, e7 * y + e8
                for column in range(first, last + 1):
                    x = column + dx
                    u, v, w = e0 * x + begin_u, e3 * x + begin_v, e6 * x + begin_w
                    if min(u, v, w) < 0:
                        continue
                    inverse = np.float32(u + v + w)
                    if (
                        nearness[row, column, s] < inverse <= greatest
                        and not (is_cut and u * ay + v * by + w * cy < 0)
                        and not (
                            opacity == MASK and _opacity(moment, t, column + 0.5, row + 0.5) < surfaces.cutoff[part]
                        )
                    ):
                        nearness[row, column, s] = inverse
                        shown[row, column, s] = t
                        shares[row, column, s, 0], shares[row, column, s, 1] = u, v


@kernel
def paint(moment, samples, window, frame):
    """Paint what `cover` has found over a frame (h, w, 4) uint8."""
    places, nearness, shown, shares = samples.places, samples.nearness, samples.shown, samples.shares
    count_all = len(places)
    for row in range(window[1], window[3]):
        for column in range(window[0], window[2]):
            r, g, b, covered = 0.0, 0.0, 0.0, 0
            done = 0
            for s in range(count_all):
                if nearness[row, column, s] == 0 or done >> s & 1:
                    continue
                t = shown[row, column, s]
                u, v, x, y, count = 0.0, 0.0, 0.0, 0.0, 0
                for other in range(s, count_all):
                    near = nearness[row, column, other]
                    if near > 0 and shown[row, column, other] == t:
                        done |= 1 << other
                        u, v = u + shares[row, column, other, 0] / near, v + shares[row, column, other, 1] / near
                        x, y, count = x + places[other, 0], y + places[other, 1], count + 1
                u, v, x, y = u / count, v / count, column + x / count, row + y / count
                red, green, blue = _shaded(moment, t, u, v, 1 - u - v, x, y)
                r, g, b, covered = r + count * red, g + count * green, b + count * blue, covered + count
            if covered:
                scale = 255 / covered
                lay(frame, row, column, scale * r, scale * g, scale * b, covered / count_all)


@kernel
def blend(moment, samples, window, chosen, frame):
    """Blend some triangles (u,) with what is behind them in a frame (h, w, 4) uint8, one after another; see `cover`."""
    surfaces, projected, near = moment.surfaces, moment.projected, moment.near
    places, nearness, triangles, greatest = samples.places, samples.nearness, surfaces.triangles, 1 / near
    for t in chosen:
        corners = _corners(projected, triangles, t)
        if not _is_turned_here(surfaces, t, corners):
            continue
        left, right, top, bottom = _bounds(projected, triangles, t, near, window)
        if left > right or top > bottom:
            continue
        e = _edges(corners)
        ay, by, cy = _heights(moment, t)
        for row in range(int(top), min(int(bottom) + 1, window[3])):
            for column in range(int(left), min(int(right) + 1, window[2])):
                px, py, count = 0.0, 0.0, 0
                for s in range(len(places)):
                    x, y = column + places[s, 0], row + places[s, 1]
                    u, v, w = e[0] * x + e[1] * y + e[2], e[3] * x + e[4] * y + e[5], e[6] * x + e[7] * y + e[8]
                    inverse = np.float32(u + v + w)
                    inside = min(u, v, w) >= 0 and u * ay + v * by + w * cy >= 0
                    if inside and nearness[row, column, s] < inverse <= greatest:
                        nearness[row, column, s] = inverse
                        px, py, count = px + x, py + y, count + 1
                if count:
                    px, py = px / count, py / count
                    u, v, w, _ = _shares(e, px, py)
                    r, g, b = _shaded(moment, t, u, v, w, px, py)
                    a = _opacity(moment, t, px, py) * count / len(places)
                    lay(frame, row, column, 255 * r, 255 * g, 255 * b, a)
