"""Chooses fewer keyframes for a motion, between which linear interpolation stays within a tolerance."""

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.floating]


def thin(points: Points, tolerance: float) -> NDArray[np.int64]:
    """Choose keyframes of moving points.

    From each keyframe, the next one is as far away as the tolerance allows.

    Parameters
    ----------
    points : (F, P, 3)
        Positions in all frames.
    tolerance : float
        Maximum distance of a point from its position by linear interpolation, unit of the points.

    Returns
    -------
    (k,) int64
        Numbers of the kept frames, ascending, with the first and the last one.
    """
    last = len(points) - 1
    kept = [0]
    while kept[-1] < last:
        kept.append(_next(points, kept[-1], last, tolerance))
    return np.array(kept)


def _next(points: Points, start: int, last: int, tolerance: float) -> int:
    """Return the end of a long segment from a frame, by steps of doubled length and then by bisection."""
    good, step = start + 1, 2
    while start + step <= last and _straight(points, start, start + step, tolerance):
        good, step = start + step, 2 * step
    bad = min(start + step, last + 1)
    while bad - good > 1:
        middle = (good + bad) // 2
        if _straight(points, start, middle, tolerance):
            good = middle
        else:
            bad = middle
    return good


def _straight(points: Points, start: int, end: int, tolerance: float) -> bool:
    """Return whether all frames between two are within the tolerance of the line between these."""
    share = np.arange(1, end - start)[:, None, None] / (end - start)
    missed = points[start + 1 : end] - (1 - share) * points[start] - share * points[end]
    return bool(np.einsum("fpc,fpc->fp", missed, missed).max(initial=0) <= tolerance**2)


def interpolated(values: NDArray[np.floating], kept: NDArray[np.int64]) -> NDArray[np.float32]:
    """Return values (F, width) of all frames between kept ones (k, width) by linear interpolation."""
    frames = np.arange(kept[-1] + 1)
    before = np.clip(np.searchsorted(kept, frames, side="right") - 1, 0, max(len(kept) - 2, 0))
    after = np.minimum(before + 1, len(kept) - 1)
    share = ((frames - kept[before]) / np.maximum(kept[after] - kept[before], 1))[:, None]
    return ((1 - share) * values[before] + share * values[after]).astype(np.float32)
