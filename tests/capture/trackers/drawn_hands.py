"""A drawn hand with its palm to the camera, whose fingers bend by a known angle at each joint."""

import numpy as np
from scipy.ndimage import gaussian_filter

HEIGHT, PIXELS_PER_METRE, WRIST = 360, 900.0, np.array([180.0, 240.0])
KNUCKLES = ((-0.032, 0.088), (-0.010, 0.094), (0.012, 0.090), (0.032, 0.080))
BONES = ((0.042, 0.025, 0.020), (0.046, 0.029, 0.021), (0.043, 0.027, 0.020), (0.034, 0.020, 0.018))
SPREAD_DEGREES = (-10, -2, 6, 16)
SKIN, NAIL, FAR = (205, 150, 120), (235, 190, 175), 0.05
THUMB = np.array([[-0.015, 0.01, 0], [-0.048, 0.045, -0.01], [-0.066, 0.068, -0.014], [-0.078, 0.088, -0.016]])


def landmarks(bend):
    """Return the landmarks (21, 3) in metres: x to the right, y up, z away from the camera, the wrist at 0.

    Joints bend by some degrees, those of all four fingers or of each.
    """
    points = np.zeros((21, 3))
    points[1:5] = THUMB
    bends = np.broadcast_to(np.radians(bend), 4)
    for finger, (knuckle, bones, spread) in enumerate(zip(KNUCKLES, BONES, np.radians(SPREAD_DEGREES), strict=True)):
        angles = bends[finger] * np.arange(1, 4)
        sideways = spread * np.cos(angles)
        along = np.column_stack([np.sin(sideways) * np.cos(angles), np.cos(sideways) * np.cos(angles), -np.sin(angles)])
        points[5 + 4 * finger] = (*knuckle, 0)
        points[6 + 4 * finger : 9 + 4 * finger] = points[5 + 4 * finger] + np.cumsum(
            np.array(bones)[:, None] * along, axis=0
        )
    return points


def draw(bend, turned=0.0, size=1.0):
    """Return an image uint8 of the hand with nails, which is turned about the forearm by some degrees.

    Without nails and shadows, MediaPipe takes fingers that are bent by 60 degrees for short, straight ones.
    """
    points = landmarks(bend)
    parts = [(np.array([0, -0.2, 0]), np.array([0, -0.005, 0]), 0.030, 0.026, None)]
    for u in np.linspace(0, 3, 25):  # the palm
        top = np.array([np.interp(u, range(4), points[5::4, axis]) for axis in range(3)])
        parts.append((np.array([0.6 * top[0], 0.007, 0]), top - np.array([0, 0.004, 0]), 0.015, 0.012, None))
    for first in (1, 5, 9, 13, 17):
        radii = (0.020, 0.0115, 0.010) if first == 1 else (0.0105, 0.0092, 0.0082)
        ends = zip(points[first : first + 3], points[first + 1 : first + 4], radii, strict=True)
        parts += [(tail, head, radius, radius - 0.001, None) for tail, head, radius in ends]
        if first > 1:
            angle = np.radians(3 * bend)
            parts[-1] = *parts[-1][:4], np.array([0, np.sin(angle), np.cos(angle)])
    sin, cos = np.sin(np.radians(turned)), np.cos(np.radians(turned))
    turn = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    rows, columns = np.mgrid[:HEIGHT, :HEIGHT]
    place = np.stack([columns - WRIST[0], WRIST[1] - rows], axis=-1) / PIXELS_PER_METRE
    image, nearest = np.linspace(150, 60, HEIGHT)[:, None, None] * np.ones((HEIGHT, 3)), np.full(rows.shape, FAR)
    for tail, head, first, last, back in parts:
        tail, along = turn @ tail, turn @ (head - tail)
        ends = WRIST + PIXELS_PER_METRE * np.array([1, -1]) * [tail[:2], (tail + along)[:2]]
        reach = PIXELS_PER_METRE * first + 1
        corners = np.clip([ends.min(axis=0) - reach, ends.max(axis=0) + reach], 0, HEIGHT).astype(int)
        part_of_image = tuple(map(slice, *corners[:, ::-1]))
        near, shown, away = nearest[part_of_image], image[part_of_image], place[part_of_image] - tail[:2]
        part = np.clip(away @ along[:2] / max(along[:2] @ along[:2], 1e-12), 0, 1)
        radius = first + (last - first) * part
        off = away - part[..., None] * along[:2]
        high = np.sqrt(np.maximum(radius**2 - (off**2).sum(axis=-1), 0))
        depth = tail[2] + part * along[2] - high
        seen = (high > 0) & (depth < near)
        light = 0.35 + (0.55 * high + 0.2 * off[..., 1] - 0.25 * off[..., 0]) / radius
        color = np.broadcast_to(SKIN, shown.shape)
        if back is not None:
            normal = np.concatenate([off, -high[..., None]], axis=-1) / radius[..., None]
            color = np.where(((normal @ turn @ back > 0.6) & (part > 0.35))[..., None], NAIL, color)
        near[seen] = depth[seen]
        shown[seen] = (np.clip(light, 0, 1.1)[..., None] * color)[seen]
    hidden = np.clip((nearest - gaussian_filter(nearest, 5)) / 0.02, 0, 1)  # by what is in front of it
    image = np.clip(image * np.where(nearest < FAR, 1 - 0.6 * hidden, 1)[..., None], 0, 255).astype(np.uint8)
    import cv2  # only the environment of cameras has it

    return cv2.resize(image, None, fx=size, fy=size, interpolation=cv2.INTER_AREA)


def body(size=1.0):
    """Return MediaPipe's landmarks (33, 2) of a body with this forearm as its left one, in pixels."""
    points = np.zeros((33, 2))
    for index, (x, y) in {13: (0, -0.25), 15: (0, 0), 17: KNUCKLES[3], 19: KNUCKLES[0]}.items():
        points[index] = WRIST + PIXELS_PER_METRE * np.array([x, -y])
    return size * points


def four(*bends):
    """Return an image of four hands side by side, and landmarks (33, 2) of a body that ends in the two in the middle.

    From the left: the left hand of somebody else, the performer's right and left one, another right one.
    """
    narrow = slice(70, 290)
    tiles = [draw(bend)[:, narrow][:, :: (1, -1)[k % 2]] for k, bend in enumerate(bends)]
    points, width = body() - [narrow.start, 0], narrow.stop - narrow.start
    points[[14, 16, 18, 20]] = [width - 1, 0] + points[[13, 15, 17, 19]] * [-1, 1]
    return np.hstack(tiles), points + np.where(np.arange(33) % 2, 2, 1)[:, None] * [width, 0]
