"""Difference of the clocks of two recordings of the same motion, by correlation of the joints' speeds."""

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.skeleton import LOST, OPPOSITE

Array = NDArray[np.float64]

SAMPLES_PER_SECOND = 60.0
"""Sampling rate of the comparison."""
HALF_WINDOW_SAMPLES = 3
"""Number of samples on either side over which a speed is measured: 0.1 s smooths the noise of sensors."""
MAX_GAP_SECONDS = 0.2
"""Maximum length of a gap over which a joint is interpolated."""
MIN_SPEED_VARIATION = 0.01
"""Minimum root mean square variation of the joints' speeds, in metres per second; less counts as no motion."""
MIN_MOTION_SHARE = 0.25
"""Minimum share of the motion of the recording with less motion that must overlap at a shift."""


def sampled(clip: SkeletonClip, times: Array) -> tuple[Array, Array]:
    """Sample a clip at any times. Joints are interpolated linearly between frames at most `MAX_GAP_SECONDS` apart.

    Parameters
    ----------
    clip : SkeletonClip
    times : (T,) float64
        Seconds on the clip's clock.

    Returns
    -------
    positions : (T, 20, 3) float64
        NaN for lost joints.
    confidence : (T, 20) float64
        The lower confidence of the two frames; 0 for lost joints.
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
        inside = (part >= 0) & (part <= 1) & (span <= MAX_GAP_SECONDS)
        before, after = known[right - 1][inside], known[right][inside]
        mixed = part[inside, None]
        positions[inside, joint] = (1 - mixed) * clip.positions[before, joint] + mixed * clip.positions[after, joint]
        confidence[inside, joint] = np.minimum(clip.confidence[before, joint], clip.confidence[after, joint])
    return positions, confidence


def clock_offsets(first: SkeletonClip, other: SkeletonClip, count: int) -> list[tuple[float, float]]:
    """Find the times by which the other recording's clock may be ahead, where the joints' speeds correlate best.

    The speeds of a joint and of its counterpart on the other side are added, so the result does not depend on swapped
    sides or on the sensors' poses.

    Parameters
    ----------
    first, other : SkeletonClip
    count : int
        Maximum number of peaks of the correlation to return.

    Returns
    -------
    list of (float, float)
        Seconds, refined by a parabola through three samples, and correlation from −1 to 1; the highest correlation
        first. The list is empty without motion.
    """
    (a, a_known), (b, b_known) = _motion(first), _motion(other)
    size = 1 << int(np.ceil(np.log2(len(a) + len(b))))

    def correlation(x: Array, y: Array) -> Array:
        spectrum = np.conj(np.fft.rfft(x, size, axis=0)) * np.fft.rfft(y, size, axis=0)
        return np.fft.irfft(spectrum.sum(axis=1), size)

    energy_a, energy_b = correlation(a**2, b_known), correlation(a_known, b**2)
    if any((motion**2).sum() <= MIN_SPEED_VARIATION**2 * known.sum() for motion, known in ((a, a_known), (b, b_known))):
        return []
    least = MIN_MOTION_SHARE * min((a**2).sum(), (b**2).sum())
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
        found.append((start + float(peak + between - size // 2) / SAMPLES_PER_SECOND, float(top)))
    return found


def _motion(clip: SkeletonClip) -> tuple[Array, Array]:
    """Return the joints' speeds (T, 20) minus their means at regular times, 0 if unknown, and 1 for known speeds."""
    duration = clip.times[-1] - clip.times[0]
    times = clip.times[0] + np.arange(int(duration * SAMPLES_PER_SECOND) + 1) / SAMPLES_PER_SECOND
    positions, _ = sampled(clip, times)
    speeds = np.full(positions.shape[:2], np.nan)
    half = HALF_WINDOW_SAMPLES
    if len(times) > 2 * half:
        speeds[half:-half] = np.linalg.norm(positions[2 * half :] - positions[: -2 * half], axis=2)
    speeds = (speeds + speeds[:, OPPOSITE]) * SAMPLES_PER_SECOND / (2 * half)
    known = np.isfinite(speeds)
    mean = np.where(known, speeds, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return np.where(known, speeds - mean, 0.0), known.astype(np.float64)
