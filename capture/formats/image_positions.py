"""Positions that trackers measure in an image, in one unit.

x and y are shares of the image's width and height, or pixels. z, the depth from the hips, is a share of its width, or
in pixels. The ratio of the image's sides and the factor of the depths are those with which the body comes closest to
the proportions of a typical one, and its bones keep their lengths best. For pixels, the image is the smallest common
one that has the body in it.
"""

import warnings

import numpy as np
from numpy.typing import NDArray

from capture.body import typical_bone_length
from capture.formats.placement import bone_length
from capture.formats.proportions import BONES, bone_ratios
from capture.skeleton import JOINT_INDEX

Floats = NDArray[np.float64]

RATIOS = {"16:9": 16 / 9, "9:16": 9 / 16, "4:3": 4 / 3, "3:4": 3 / 4}
"""Common ratios of an image's width to its height, the most common ones first."""

RARITY = 0.045
"""How much closer to a typical body's the proportions must be for a less common ratio to be chosen, for each step in
`RATIOS`. With 0.05, two of 56 recordings had the wrong ratio, by less than 0.006."""

MAX_OUTSIDE = 3.0
"""How far the feet may be below the image, in heights of it."""

SIZES = ((640, 480), (480, 640), (1280, 720), (720, 1280), (1920, 1080), (1080, 1920), (3840, 2160), (2160, 3840))
"""Common widths and heights of images, the smallest ones first."""

DEPTHS = (1.0, 0.7, 0.5, 0.35, 0.25, 0.18, 0.125)
"""Factors of the depths that are tried; trackers exaggerate them. Their steps must be so small that `RARITY` decides
between ratios only if these are about as good."""

MAX_DEPTH_OF_HIPS = 0.002
"""Largest distance of the hips from the depth 0, if it is in pixels, as a share of the body's height."""

MIN_PIXELS = 20
"""Smallest distance of the hips from the image's edges, from which they are taken to be in pixels."""

PIXEL_DEPTH_SHARE = 0.02
"""Ratio of the extents of z and y below which y is in pixels if z is a share of the image's width."""

TYPICAL_WIDTHS_METRES = 0.6
"""Sum of the distances between the shoulders and between the hips of a typical person."""


def unit_of(points: Floats) -> tuple[Floats, str]:
    """Return the factors (3,) that give positions in an image one unit, and a note; no note for other positions.

    Parameters
    ----------
    points : (T, 20, 3) float64
        NaN for lost joints.
    """
    known = points[np.isfinite(points).all(axis=2)]
    hips = points[:, [JOINT_INDEX["hip_left"], JOINT_INDEX["hip_right"]]].mean(axis=1)
    if not np.isfinite(hips).all(axis=1).any():
        return np.ones(3), ""
    middle = np.nanmedian(hips, axis=0)
    low, high = np.percentile(known, [5, 95], axis=0)
    extent = high - low
    is_share = 0 < extent[2] < PIXEL_DEPTH_SHARE * extent[1]
    depth_of_hips = np.nanpercentile(np.abs(hips[:, 2]), 90)
    is_pixel = bool(depth_of_hips < MAX_DEPTH_OF_HIPS * extent[1] and extent[2] > 0 and (high[:2] < SIZES[-2]).all())
    if (middle[:2] < 0.05).any() or (abs(middle[2]) > 0.05 and (is_share or not is_pixel)):
        return np.ones(3), ""
    if (low[:2] > -0.2).all() and (high[:2] < 1 + MAX_OUTSIDE).all():
        kind, units = "shares", {name: (1.0, 1 / ratio, 1.0) for name, ratio in RATIOS.items()}
    elif is_share or (is_pixel and (middle[:2] > MIN_PIXELS).all() and (low[:2] > 0).all()):
        width, height = next((size for size in SIZES if (high[:2] < size).all()), SIZES[-1])
        kind, units = "pixels", {f"{width} × {height}": (1.0, 1.0, float(width if is_share else 1))}
    else:
        return np.ones(3), ""
    misfits = {
        (size, depth): _misfit(points * unit * [1, 1, depth]) + RARITY * rank
        for rank, (size, unit) in enumerate(units.items())
        for depth in DEPTHS
    }
    size, depth = min(misfits, key=misfits.__getitem__)
    if kind == "shares" and _misfit(points) < misfits[size, depth]:  # they have one unit
        return np.ones(3), ""
    note = f"x and y are {kind} of an image, which is assumed to have {size}. Depths of such positions are rough."
    return np.multiply(units[size], [1, 1, depth]), note


def _misfit(points: Floats) -> float:
    """Return how much bones, and hips and shoulders, differ in their proportions from those of a typical person.

    A bone that changes its length adds to it.
    """
    with warnings.catch_warnings(action="ignore"):  # joints that are always lost
        lengths = np.array([bone_length(points, *bone) for bone in BONES])
        spread = np.nanmean(np.nanstd(lengths, axis=1) / np.nanmean(lengths, axis=1))
        wide = [np.nanmedian(bone_length(points, f"{joint}_left", f"{joint}_right")) for joint in ("shoulder", "hip")]
        tall = np.nanmedian(lengths, axis=1)
        typical = np.array([typical_bone_length(bone) for bone, _ in BONES])
        expected = TYPICAL_WIDTHS_METRES / typical[np.isfinite(tall)].sum()
        deviation = np.nanmean(np.abs(np.log(bone_ratios(points))))
        return float(deviation + spread + abs(np.log(np.nansum(wide) / np.nansum(tall) / expected)))
