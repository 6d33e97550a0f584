"""How far apart the clocks of two recordings of the same performance are, by what moves when."""

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.skeleton import LOST, OPPOSITE

Array = NDArray[np.float64]

RATE = 60.0
"""Samples a second that are compared."""
REACH = 3
"""Samples on either side over which a speed is measured: a tenth of a second smooths the jitter of sensors."""
GAP = 0.2
"""Seconds for which a joint may be unknown and is interpolated."""
STILL = 0.01
"""Metres a second by which the joints' speeds must vary, root mean square: less is no motion."""
OVERLAP = 0.25
"""Share of all motion of the stiller recording that a shift must leave to be compared."""


def sampled(clip: SkeletonClip, times: Array) -> tuple[Array, Array]:
    """Return a clip at any times, each joint interpolated linearly between frames at most `GAP` apart.

    Parameters
    ----------
    clip : SkeletonClip
    times : (T,) float64
        Seconds on the clip's clock.

    Returns
    -------
    positions : (T, 20, 3) float64
        NaN where a joint is not known.
    confidence : (T, 20) float64
        The lower of the two frames'; 0 where a joint is not known.
    """
    positions = np.full((len(times), *clip.positions.shape[1:]), np.nan)
    confidence = np.zeros(positions.shape[:2])
    for joint in range(positions.shape[1]):
        known = np.flatnonzero(clip.confidence[:, joint] > LOST)
        if len(known) < 2:
            continue
        at = clip.times[known]
        right = np.clip(np.searchsorted(at, times, side="right"), 1, len(at) - 1)
        span = at[right] - at[right - 1]
        part = (times - at[right - 1]) / span
        inside = (part >= 0) & (part <= 1) & (span <= GAP)
        before, after = known[right - 1][inside], known[right][inside]
        mixed = part[inside, None]
        positions[inside, joint] = (1 - mixed) * clip.positions[before, joint] + mixed * clip.positions[after, joint]
        confidence[inside, joint] = np.minimum(clip.confidence[before, joint], clip.confidence[after, joint])
    return positions, confidence


def offsets(first: SkeletonClip, other: SkeletonClip, count: int) -> list[tuple[float, float]]:
    """Find by how much the other recording's clock is ahead: where the joints' speeds correlate best.

    The speeds of a joint and of its counterpart on the other side are added, so that it does not matter which a sensor
    takes for which, and from where it looks.

    Parameters
    ----------
    first, other : SkeletonClip
    count : int
        How many peaks of the correlation to return at most.

    Returns
    -------
    list of (float, float)
        Seconds, between samples by a parabola, and the correlation there, −1 to 1; the highest first. None where
        nothing moves.
    """
    (a, a_known), (b, b_known) = _motion(first), _motion(other)
    size = 1 << int(np.ceil(np.log2(len(a) + len(b))))

    def correlation(x: Array, y: Array) -> Array:
        spectrum = np.conj(np.fft.rfft(x, size, axis=0)) * np.fft.rfft(y, size, axis=0)
        return np.fft.irfft(spectrum.sum(axis=1), size)

    energy_a, energy_b = correlation(a**2, b_known), correlation(a_known, b**2)
    if any((motion**2).sum() <= STILL**2 * known.sum() for motion, known in ((a, a_known), (b, b_known))):
        return []
    least = OVERLAP * min((a**2).sum(), (b**2).sum())
    common = np.where(
        np.minimum(energy_a, energy_b) > least, np.sqrt(np.maximum(energy_a * energy_b, least**2)), np.inf
    )
    alike = np.fft.fftshift(correlation(a, b) / common)
    peaks = 1 + np.flatnonzero((alike[1:-1] > 0) & (alike[1:-1] >= alike[:-2]) & (alike[1:-1] > alike[2:]))
    peaks = peaks[np.argsort(-alike[peaks], kind="stable")][:count]
    start = float(other.times[0] - first.times[0])
    found = []
    for peak in peaks:
        before, top, after = alike[peak - 1 : peak + 2]
        between = (before - after) / (2 * (before - 2 * top + after))
        found.append((start + float(peak + between - size // 2) / RATE, float(top)))
    return found


def _motion(clip: SkeletonClip) -> tuple[Array, Array]:
    """Return the joints' speeds (T, 20) about their means on an even clock, 0 where unknown, and which are known."""
    times = clip.times[0] + np.arange(int((clip.times[-1] - clip.times[0]) * RATE) + 1) / RATE
    positions, _ = sampled(clip, times)
    speeds = np.full(positions.shape[:2], np.nan)
    if len(times) > 2 * REACH:
        speeds[REACH:-REACH] = np.linalg.norm(positions[2 * REACH :] - positions[: -2 * REACH], axis=2)
    speeds = (speeds + speeds[:, OPPOSITE]) * RATE / (2 * REACH)
    known = np.isfinite(speeds)
    mean = np.where(known, speeds, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(known, speeds - mean, 0.0), known.astype(np.float64)
