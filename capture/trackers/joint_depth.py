"""Depth of joints from a depth image that is registered to the colour image in which a tracker found them.

Around a joint's pixel, a sensor sees the skin in front of the joint, and objects in front of or behind the body. Depths
close together form one surface. From the hips outwards, each joint is placed behind the nearest surface where one of
these is true:

- The depth is close to the tracker's estimate.
- The distance to the parent joint matches the bone's length. The estimate can be far off for legs that look bent.

A joint without depth keeps the tracker's estimate of its offset from the parent joint.
"""

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.compiled import compiled

Floats = NDArray[np.float64]

MIN_CONFIDENCE = 0.5
"""Confidence from which a joint counts as visible, so that the depth image shows it."""

_SKIN_TO_JOINT = {
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
SKIN_TO_JOINT_METRES: Floats = np.array(
    [_SKIN_TO_JOINT[joint.removesuffix("_left").removesuffix("_right")] for joint in JOINTS]
)
"""(20,) distance from the visible skin to the joint, in metres: half of an adult's thickness there."""

PARENT_INDICES = np.array([JOINT_INDEX[PARENTS[joint]] if joint in PARENTS else -1 for joint in JOINTS])
"""(20,) index of each joint's parent joint, which is smaller than its own; −1 for the hip centre."""

_WINDOW_METRES = 0.02  # distance from the joint's pixel to the window's edge: less than half of a wrist
_MIN_WINDOW, _MAX_WINDOW = 2, 40  # the same, in pixels
_SURFACE_METRES = 0.15  # depth range of one surface
_MIN_SURFACE_SHARE = 0.25  # share of the window that a surface must fill
_MAX_ESTIMATE_ERROR = 0.25  # metres between a joint and the tracker's estimate
_MAX_BONE_ERROR = 0.3  # error of a joint's distance to its parent, relative to the bone's length
_MAX_BONE_STRETCH = 1.4  # largest distance from the parent, relative to the bone's length
_MIN_JOINT_COUNT = 5  # joints with depth that determine the scale of a body


def measure_depths(
    depth: NDArray[np.float32],
    focal: float,
    pixels: Floats,
    rays: Floats,
    estimated: Floats,
    lengths: Floats,
    confidence: NDArray[np.float32],
) -> tuple[Floats, NDArray[np.bool_], float] | None:
    """Measure the depths of joints, and the scale of the tracker's metres.

    Parameters
    ----------
    depth : (height, width) float32
        Metres; 0 for unknown.
    focal : float
        Focal length, in pixels.
    pixels : (20, 2) float64
    rays : (20, 3) float64
        Directions through the pixels, with z = 1.
    estimated : (20,) float64
        The tracker's estimate of the depths, in its metres.
    lengths : (20,) float64
        Length of each joint's bone, in the tracker's metres.
    confidence : (20,) float32

    Returns
    -------
    (depths, known, scale) or None
        (20,) float64 metres along z, (20,) bool whether the depth was measured, and float metres per metre of the
        tracker. None if too few joints have any depth.
    """
    depth = np.ascontiguousarray(depth).view()
    depth.flags.writeable = False  # one kind of array for all devices, so that nothing is compiled again
    depths, known, scale = _measure(depth, focal, pixels, rays, estimated, lengths, confidence)
    return None if np.isnan(scale) else (depths, known, scale)


@compiled(inner=True)
def _window(depth, pixel, radius):
    """Return the known depths around a pixel, in metres, sorted."""
    height, width = depth.shape
    column, row, reach = int(pixel[0]), int(pixel[1]), min(max(_MIN_WINDOW, round(radius)), _MAX_WINDOW)
    values = np.empty((2 * reach + 1) ** 2)
    count = 0
    if 0 <= pixel[0] < width and 0 <= pixel[1] < height:
        for y in range(max(0, row - reach), min(height, row + reach + 1)):
            for x in range(max(0, column - reach), min(width, column + reach + 1)):
                if depth[y, x] > 0:
                    values[count] = depth[y, x]
                    count += 1
    return np.sort(values[:count])


@compiled(inner=True)
def _median(ordered):
    return (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


@compiled(inner=True)
def _is_plausible(ray, z, estimate, bone, parent_ray, parent_z):
    """Return whether a joint can be at depth z; `parent_z` is NaN if unknown."""
    square = 0.0
    for axis in range(3):
        square += (ray[axis] * z - parent_ray[axis] * parent_z) ** 2
    length = np.sqrt(square)
    if length > _MAX_BONE_STRETCH * bone:
        return False
    return abs(z - estimate) < _MAX_ESTIMATE_ERROR or abs(length - bone) < _MAX_BONE_ERROR * bone


@compiled(inner=True)
def _surface_depth(window, skin, ray, estimate, bone, parent_ray, parent_z):
    """Return the depth of a joint behind the nearest plausible surface; NaN if there is none."""
    enough = _MIN_SURFACE_SHARE * len(window)
    start = 0
    while len(window) - start > enough:
        end = start
        while end < len(window) and window[end] < window[start] + _SURFACE_METRES:
            end += 1
        z = _median(window[start:end]) + skin
        if end - start > enough and _is_plausible(ray, z, estimate, bone, parent_ray, parent_z):
            return z
        start = end
    return np.nan


@compiled
def _measure(depth, focal, pixels, rays, estimated, lengths, confidence):
    joints = len(pixels)
    depths, known = np.empty(joints), np.zeros(joints, np.bool_)
    scales, count = np.empty(joints), 0
    for j in range(joints):
        if confidence[j] >= MIN_CONFIDENCE:
            window = _window(depth, pixels[j], _WINDOW_METRES * focal / estimated[j])
            if len(window) > 0:
                scales[count] = (_median(window) + SKIN_TO_JOINT_METRES[j]) / estimated[j]
                count += 1
    if count < _MIN_JOINT_COUNT:
        return depths, known, np.nan
    scale = _median(np.sort(scales[:count]))  # objects in front of or behind joints are the minority
    for j in range(joints):
        parent = PARENT_INDICES[j]
        parent_z = depths[parent] if parent >= 0 and known[parent] else np.nan
        estimate, bone = estimated[j] * scale, lengths[j] * scale
        z = np.nan
        if confidence[j] >= MIN_CONFIDENCE:
            window = _window(depth, pixels[j], _WINDOW_METRES * focal / estimated[j])
            z = _surface_depth(window, SKIN_TO_JOINT_METRES[j], rays[j], estimate, bone, rays[parent], parent_z)
        known[j] = not np.isnan(z)
        if known[j]:
            depths[j] = z
        else:
            depths[j] = estimate if parent < 0 else depths[parent] + (estimated[j] - estimated[parent]) * scale
    return depths, known, scale
