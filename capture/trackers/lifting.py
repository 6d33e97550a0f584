"""How far away the joints of a body are, by a depth picture that is registered to the one they were found in.

Around a joint's pixel a sensor sees the skin before the joint, and what stands before or behind the body. Depths close
together are one surface. Joints are looked for from the hips outwards, each on the nearest surface where it can be:

- where the tracker guesses it, which is wrong by more than that in legs it takes for bent;
- as far from its neighbour towards the hips as its bone is long.

A joint that depth misses is as far before or behind that neighbour as the tracker guesses.
"""

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.compiled import compiled

Floats = NDArray[np.float64]

SEEN = 0.5
"""Confidence from which a joint is taken to be in sight: it is looked for in the depth picture."""

_BENEATH = {
    "hip_center": 0.10,
    "spine": 0.11,
    "shoulder_center": 0.06,
    "head": 0.09,
    "shoulder": 0.05,
    "elbow": 0.04,
    "wrist": 0.025,
    "hand": 0.015,
    "hip": 0.09,
    "knee": 0.05,
    "ankle": 0.04,
    "foot": 0.03,
}
SKIN_TO_JOINT: Floats = np.array([_BENEATH[joint.removesuffix("_left").removesuffix("_right")] for joint in JOINTS])
"""(20,) metres from the skin that a sensor sees to the joint within: half of an adult's thickness there."""

NEIGHBORS = np.array([JOINT_INDEX[PARENTS[joint]] if joint in PARENTS else -1 for joint in JOINTS])
"""(20,) index of each joint's neighbour towards the hips, which stands before it; -1 of the hips' centre."""

_WINDOW = 0.02  # metres from a joint within which depth is looked at: less than half of a wrist
_NARROWEST, _WIDEST = 2, 40  # pixels
_SURFACE = 0.15  # metres from the nearest depth of a surface to its farthest
_LEAST = 0.25  # of the window that a surface must fill
_GUESS = 0.25  # metres from where the tracker guesses a joint within which it may be
_BONE = 0.3  # of a bone's length by which a joint's distance to its neighbour may differ from that
_LONGEST = 1.4  # of a bone's length beyond which a joint cannot be
_ENOUGH = 5  # joints with depth that tell how large a body is


def lift(
    depth: NDArray[np.uint16],
    focal: float,
    pixels: Floats,
    rays: Floats,
    guessed: Floats,
    lengths: Floats,
    confidence: NDArray[np.float32],
) -> tuple[Floats, NDArray[np.bool_], float] | None:
    """Return how far away joints are, which of them depth tells, and how many metres one of the tracker's is.

    Parameters
    ----------
    depth : (height, width) uint16
        Millimetres, 0 where unknown.
    focal : float
        Pixels.
    pixels : (20, 2) float64
    rays : (20, 3) float64
        Through the pixels, z being 1.
    guessed : (20,) float64
        How far away the tracker guesses the joints, in its metres.
    lengths : (20,) float64
        Of each joint's bone, in the tracker's metres.
    confidence : (20,) float32

    Returns
    -------
    (depths, known, scale) or None
        (20,) float64 metres along z, (20,) bool, float. None where too few joints have any depth.
    """
    depth = np.ascontiguousarray(depth).view()
    depth.flags.writeable = False  # whatever a device gives, one kind of array: nothing is compiled for another one
    depths, known, scale = _lift(depth, focal, pixels, rays, guessed, lengths, confidence)
    return None if np.isnan(scale) else (depths, known, scale)


@compiled
def _window(depth, pixel, radius):
    """Return the known depths around a pixel in metres, sorted."""
    height, width = depth.shape
    column, row, reach = int(pixel[0]), int(pixel[1]), min(max(_NARROWEST, round(radius)), _WIDEST)
    values = np.empty((2 * reach + 1) ** 2)
    count = 0
    if 0 <= pixel[0] < width and 0 <= pixel[1] < height:
        for y in range(max(0, row - reach), min(height, row + reach + 1)):
            for x in range(max(0, column - reach), min(width, column + reach + 1)):
                if depth[y, x] > 0:
                    values[count] = depth[y, x] / 1000
                    count += 1
    return np.sort(values[:count])


@compiled
def _median(ordered):
    return (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


@compiled
def _may_be(ray, z, guess, bone, beside, beside_z):
    """Say whether a joint can be at depth z; `beside_z` is NaN where its neighbour's is not known."""
    square = 0.0
    for axis in range(3):
        square += (ray[axis] * z - beside[axis] * beside_z) ** 2
    length = np.sqrt(square)
    if length > _LONGEST * bone:
        return False
    return abs(z - guess) < _GUESS or abs(length - bone) < _BONE * bone


@compiled
def _surface(window, skin, ray, guess, bone, beside, beside_z):
    """Return the depth of a joint behind the nearest surface that can be its own, NaN if there is none."""
    enough = _LEAST * len(window)
    start = 0
    while len(window) - start > enough:
        end = start
        while end < len(window) and window[end] < window[start] + _SURFACE:
            end += 1
        z = _median(window[start:end]) + skin
        if end - start > enough and _may_be(ray, z, guess, bone, beside, beside_z):
            return z
        start = end
    return np.nan


@compiled
def _lift(depth, focal, pixels, rays, guessed, lengths, confidence):
    joints = len(pixels)
    depths, known = np.empty(joints), np.zeros(joints, np.bool_)
    scales, count = np.empty(joints), 0
    for j in range(joints):
        if confidence[j] >= SEEN:
            window = _window(depth, pixels[j], _WINDOW * focal / guessed[j])
            if len(window) > 0:
                scales[count] = (_median(window) + SKIN_TO_JOINT[j]) / guessed[j]
                count += 1
    if count < _ENOUGH:
        return depths, known, np.nan
    scale = _median(np.sort(scales[:count]))  # whatever hides a joint, or lies behind it, is in the minority
    for j in range(joints):
        near = NEIGHBORS[j]
        beside_z = depths[near] if near >= 0 and known[near] else np.nan
        guess, bone = guessed[j] * scale, lengths[j] * scale
        z = np.nan
        if confidence[j] >= SEEN:
            window = _window(depth, pixels[j], _WINDOW * focal / guessed[j])
            z = _surface(window, SKIN_TO_JOINT[j], rays[j], guess, bone, rays[near], beside_z)
        known[j] = not np.isnan(z)
        if known[j]:
            depths[j] = z
        else:
            depths[j] = guess if near < 0 else depths[near] + (guessed[j] - guessed[near]) * scale
    return depths, known, scale
