"""Drawing of triangles in perspective, with smooth edges, lit at each pixel.

Triangles are drawn in homogeneous coordinates (Olano and Greer 1997), so that those which reach behind the camera need
no clipping: each edge of a triangle is a linear function of the pixel, which is positive inside. Their sum, if the
triangle's own size is divided out, is the inverse of the distance, and their shares of it are the barycentric
coordinates in space.
"""

import numpy as np

from engine_bridge.pictures.geometry import BLEND, MASK
from engine_bridge.pictures.lamps import encoded, irradiance
from engine_bridge.pictures.textures import texture
from puppetline.compiled import compiled

inner, kernel = compiled(inner=True, counts=False), compiled(counts=False)


@inner
def _size(seen, triangles, t):
    """Return the size of a triangle, negative if its corners run counterclockwise in the picture."""
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    ax, ay, aw = np.float64(seen[i, 0]), np.float64(seen[i, 1]), np.float64(seen[i, 2])
    bx, by, bw = np.float64(seen[j, 0]), np.float64(seen[j, 1]), np.float64(seen[j, 2])
    cx, cy, cw = np.float64(seen[k, 0]), np.float64(seen[k, 1]), np.float64(seen[k, 2])
    return ax * (by * cw - bw * cy) + ay * (bw * cx - bx * cw) + aw * (bx * cy - by * cx)


@inner
def _edges(seen, triangles, t):
    """Return the coefficients of a triangle's edges: column, row and constant of each."""
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    ax, ay, aw = np.float64(seen[i, 0]), np.float64(seen[i, 1]), np.float64(seen[i, 2])
    bx, by, bw = np.float64(seen[j, 0]), np.float64(seen[j, 1]), np.float64(seen[j, 2])
    cx, cy, cw = np.float64(seen[k, 0]), np.float64(seen[k, 1]), np.float64(seen[k, 2])
    p0, p1, p2 = by * cw - bw * cy, bw * cx - bx * cw, bx * cy - by * cx
    s = 1 / (ax * p0 + ay * p1 + aw * p2)
    return (
        p0 * s,
        p1 * s,
        p2 * s,
        (cy * aw - cw * ay) * s,
        (cw * ax - cx * aw) * s,
        (cx * ay - cy * ax) * s,
        (ay * bw - aw * by) * s,
        (aw * bx - ax * bw) * s,
        (ax * by - ay * bx) * s,
    )


@inner
def _bounds(seen, triangles, t, near, window):
    """Return the left, right, upper and lower end of a triangle in a window; it covers it if it reaches the camera."""
    left, top, right, bottom = window[0], window[1], window[2], window[3]
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    aw, bw, cw = seen[i, 2], seen[j, 2], seen[k, 2]
    if aw < near or bw < near or cw < near:
        return float(left), float(right), float(top), float(bottom)
    ax, ay, bx, by = seen[i, 0] / aw, seen[i, 1] / aw, seen[j, 0] / bw, seen[j, 1] / bw
    cx, cy = seen[k, 0] / cw, seen[k, 1] / cw
    return (
        max(min(ax, bx, cx), left),
        min(max(ax, bx, cx), right),
        max(min(ay, by, cy), top),
        min(max(ay, by, cy), bottom),
    )


@inner
def _heights(points, triangles, t, side):
    """Return the heights of a triangle's corners above the floor, if `side` is 1, or below it, if it is −1; 0 for 0."""
    i, j, k = triangles[t, 0], triangles[t, 1], triangles[t, 2]
    return side * points[i, 1], side * points[j, 1], side * points[k, 1]


@inner
def _shares(e, x, y):
    """Return the barycentric coordinates, in space, of the point of a triangle at a point of the picture."""
    # a point beside the triangle counts as one on its edge
    u, v = max(e[0] * x + e[1] * y + e[2], 0.0), max(e[3] * x + e[4] * y + e[5], 0.0)
    w = max(e[6] * x + e[7] * y + e[8], 0.0)
    distance = 1 / max(u + v + w, 1e-30)
    return u * distance, v * distance, w * distance, distance


@inner
def _texture_at(surfaces, e, t, x, y):
    """Return the linear colour and opacity of a triangle's texture at a point of the picture; white without one."""
    image = surfaces.image[surfaces.part[t]]
    if image < 0:
        return 1.0, 1.0, 1.0, 1.0
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


@inner
def _opacity(surfaces, e, t, x, y):
    """Return the opacity of a triangle at a point of the picture."""
    u, v, w, _ = _shares(e, x, y)
    i, j, k = surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2]
    own = u * surfaces.colors[i, 3] + v * surfaces.colors[j, 3] + w * surfaces.colors[k, 3]
    return own * _texture_at(surfaces, e, t, x, y)[3]


@inner
def _seen_side(points, normals, eye, i, j, k):
    """Return 1 where normals of a triangle point to the viewer's side of it, −1 where not, whatever its winding."""
    ax, ay, az = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1], points[j, 2] - points[i, 2]
    bx, by, bz = points[k, 0] - points[i, 0], points[k, 1] - points[i, 1], points[k, 2] - points[i, 2]
    fx, fy, fz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    from_eye = fx * (eye[0] - points[i, 0]) + fy * (eye[1] - points[i, 1]) + fz * (eye[2] - points[i, 2])
    nx, ny = normals[i, 0] + normals[j, 0] + normals[k, 0], normals[i, 1] + normals[j, 1] + normals[k, 1]
    nz = normals[i, 2] + normals[j, 2] + normals[k, 2]
    return -1.0 if from_eye * (fx * nx + fy * ny + fz * nz) < 0 else 1.0


@inner
def _light(points, normals, lamps, side, i, j, k, u, v, w):
    """Return the light on a point of a triangle with corners i, j, k and barycentric coordinates u, v, w."""
    x = u * points[i, 0] + v * points[j, 0] + w * points[k, 0]
    y = u * points[i, 1] + v * points[j, 1] + w * points[k, 1]
    z = u * points[i, 2] + v * points[j, 2] + w * points[k, 2]
    nx = u * normals[i, 0] + v * normals[j, 0] + w * normals[k, 0]
    ny = u * normals[i, 1] + v * normals[j, 1] + w * normals[k, 1]
    nz = u * normals[i, 2] + v * normals[j, 2] + w * normals[k, 2]
    scale = side / max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-30)
    return irradiance(lamps, x, y, z, nx * scale, ny * scale, nz * scale, lamps.lift)


@inner
def _vertex(surfaces, points, normals, lamps, at_vertices, side, i, is_whole):
    """Return the light on a vertex, on its side 1 or −1, or its sRGB colour in the light; it is computed once."""
    row = 2 * i + (side < 0)
    if np.isnan(at_vertices[row, 0]):
        r, g, b = _light(points, normals, lamps, side, i, i, i, 1.0, 0.0, 0.0)
        if is_whole:
            colors = surfaces.colors
            r, g, b = encoded(r * colors[i, 0]), encoded(g * colors[i, 1]), encoded(b * colors[i, 2])
        at_vertices[row, 0], at_vertices[row, 1], at_vertices[row, 2] = r, g, b
    return at_vertices[row, 0], at_vertices[row, 1], at_vertices[row, 2]


@inner
def _is_whole(surfaces, t):
    """Return whether a triangle is coloured as a whole at its vertices."""
    part = surfaces.part[t]
    return surfaces.fine[part] and surfaces.image[part] < 0 and not surfaces.unlit[part]


@inner
def _shaded(surfaces, points, normals, seen, lamps, at_vertices, eye, t, x, y):
    """Return the sRGB colour of a triangle at a point of the picture."""
    e = _edges(seen, surfaces.triangles, t)
    u, v, w, _ = _shares(e, x, y)
    part = surfaces.part[t]
    i, j, k = surfaces.triangles[t, 0], surfaces.triangles[t, 1], surfaces.triangles[t, 2]
    side = _seen_side(points, normals, eye, i, j, k) if surfaces.two_sided[part] else 1.0
    red, green, blue = 1.0, 1.0, 1.0
    if not surfaces.unlit[part]:
        if surfaces.fine[part]:
            is_whole = _is_whole(surfaces, t)
            r1, g1, b1 = _vertex(surfaces, points, normals, lamps, at_vertices, side, i, is_whole)
            r2, g2, b2 = _vertex(surfaces, points, normals, lamps, at_vertices, side, j, is_whole)
            r3, g3, b3 = _vertex(surfaces, points, normals, lamps, at_vertices, side, k, is_whole)
            red, green, blue = u * r1 + v * r2 + w * r3, u * g1 + v * g2 + w * g3, u * b1 + v * b2 + w * b3
            if is_whole:
                return red, green, blue
        else:
            red, green, blue = _light(points, normals, lamps, side, i, j, k, u, v, w)
    r, g, b, _ = _texture_at(surfaces, e, t, x, y)
    colors = surfaces.colors
    r *= red * (u * colors[i, 0] + v * colors[j, 0] + w * colors[k, 0])
    g *= green * (u * colors[i, 1] + v * colors[j, 1] + w * colors[k, 1])
    b *= blue * (u * colors[i, 2] + v * colors[j, 2] + w * colors[k, 2])
    return encoded(r), encoded(g), encoded(b)


@kernel
def cover(surfaces, points, seen, side, near, window, places, nearness, shown):
    """Find the nearest triangle at each sample of each pixel in a window, except for those that mix with others.

    Parameters
    ----------
    surfaces : Surfaces
    points : (n, 3) float32
    seen : (n, 3) float32
        Column and row of each point times its distance from the camera's plane, and this distance.
    side : float
        1 to leave out what is below the floor, −1 what is above it, 0 nothing.
    near : float
        Distance of the nearest visible point.
    window : tuple of 4 ints
        First column and row, and those after the last.
    places : (s, 2) float64
        Samples in a pixel.
    nearness : (h, w, s) float32
        Inverse distances of the triangles; 0 for none.
    shown : (h, w, s) int32
        Numbers of the triangles.
    """
    triangles = surfaces.triangles
    nearness[window[1] : window[3], window[0] : window[2]] = 0
    for t in range(len(triangles)):
        part = surfaces.part[t]
        opacity = surfaces.opacity[part]
        size = _size(seen, triangles, t)
        if opacity == BLEND or not (size < 0 or (size > 0 and surfaces.two_sided[part])):
            continue
        left, right, top, bottom = _bounds(seen, triangles, t, near, window)
        if left > right or top > bottom:
            continue
        e0, e1, e2, e3, e4, e5, e6, e7, e8 = e = _edges(seen, triangles, t)
        ay, by, cy = _heights(points, triangles, t, side)
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
                        nearness[row, column, s] < inverse <= 1 / near
                        and not (is_cut and u * ay + v * by + w * cy < 0)
                        and not (
                            opacity == MASK
                            and _opacity(surfaces, e, t, column + 0.5, row + 0.5) < surfaces.cutoff[part]
                        )
                    ):
                        nearness[row, column, s] = inverse
                        shown[row, column, s] = t


@kernel
def paint(surfaces, points, normals, seen, lamps, at_vertices, eye, window, places, nearness, shown, frame):
    """Paint what `cover` has found over a frame (h, w, 4) uint8; see there and `irradiance` for the parameters."""
    samples = len(places)
    for row in range(window[1], window[3]):
        for column in range(window[0], window[2]):
            r, g, b, covered = 0.0, 0.0, 0.0, 0
            done = 0
            for s in range(samples):
                if nearness[row, column, s] == 0 or done >> s & 1:
                    continue
                t = shown[row, column, s]
                x, y, count = 0.0, 0.0, 0
                for other in range(s, samples):
                    if shown[row, column, other] == t and nearness[row, column, other] > 0:
                        done |= 1 << other
                        x, y, count = x + places[other, 0], y + places[other, 1], count + 1
                x, y = column + x / count, row + y / count
                red, green, blue = _shaded(surfaces, points, normals, seen, lamps, at_vertices, eye, t, x, y)
                r, g, b, covered = r + count * red, g + count * green, b + count * blue, covered + count
            if covered:
                rest = 1 - covered / samples
                frame[row, column, 0] = int(rest * frame[row, column, 0] + 255 * r / samples + 0.5)
                frame[row, column, 1] = int(rest * frame[row, column, 1] + 255 * g / samples + 0.5)
                frame[row, column, 2] = int(rest * frame[row, column, 2] + 255 * b / samples + 0.5)


@kernel
def mix(surfaces, points, normals, seen, lamps, at_vertices, eye, side, near, window, places, nearness, chosen, frame):
    """Mix some triangles (u,) with what is behind them in a frame (h, w, 4) uint8, one after another; see `paint`."""
    triangles = surfaces.triangles
    for t in chosen:
        size = _size(seen, triangles, t)
        if not (size < 0 or (size > 0 and surfaces.two_sided[surfaces.part[t]])):
            continue
        left, right, top, bottom = _bounds(seen, triangles, t, near, window)
        if left > right or top > bottom:
            continue
        e = _edges(seen, triangles, t)
        ay, by, cy = _heights(points, triangles, t, side)
        for row in range(int(top), min(int(bottom) + 1, window[3])):
            for column in range(int(left), min(int(right) + 1, window[2])):
                px, py, count = 0.0, 0.0, 0
                for s in range(len(places)):
                    x, y = column + places[s, 0], row + places[s, 1]
                    u, v, w = e[0] * x + e[1] * y + e[2], e[3] * x + e[4] * y + e[5], e[6] * x + e[7] * y + e[8]
                    inverse = np.float32(u + v + w)
                    inside = min(u, v, w) >= 0 and u * ay + v * by + w * cy >= 0
                    if inside and nearness[row, column, s] < inverse <= 1 / near:
                        nearness[row, column, s] = inverse
                        px, py, count = px + x, py + y, count + 1
                if count:
                    px, py = px / count, py / count
                    r, g, b = _shaded(surfaces, points, normals, seen, lamps, at_vertices, eye, t, px, py)
                    a = _opacity(surfaces, e, t, px, py) * count / len(places)
                    frame[row, column, 0] = int((1 - a) * frame[row, column, 0] + 255 * a * r + 0.5)
                    frame[row, column, 1] = int((1 - a) * frame[row, column, 1] + 255 * a * g + 0.5)
                    frame[row, column, 2] = int((1 - a) * frame[row, column, 2] + 255 * a * b + 0.5)
