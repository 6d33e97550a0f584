"""The last step of every log reader: arrays in, a checked clip out."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats.options import ReadOptions
from capture.orientations import checked
from capture.skeleton import LOST, TRACKED
from puppetline.errors import SkeletonLogError, at


def clip_of(
    path: Path,
    log_format: str,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    confidence: NDArray[np.float32],
    notes: tuple[str, ...] = (),
    orientations: NDArray[np.float64] | None = None,
) -> SkeletonClip:
    """Make one performer's clip of a log's frames.

    Of frames whose time does not increase, the first is kept, and a note says how many others were left out. A joint of
    confidence 0, or at exactly (0, 0, 0), which is the sensor itself and what recorders write for "none", is lost.

    Parameters
    ----------
    path : Path
        The log, for error messages.
    log_format : str
        The clip's `format`.
    times : (T,) float64
        Seconds, in the order of the file.
    positions : (T, 20, 3) float64
        Metres, sensor frame.
    confidence : (T, 20) float32
    notes : tuple of str
    orientations : (T, 20, 4) float64, optional
        As of `capture.orientations`; what is no unit quaternion, or of a joint that the sensor did not track, is
        unknown.

    Returns
    -------
    SkeletonClip
        Of user 0.

    Raises
    ------
    SkeletonLogError
        No joint is known in any frame.
    """
    keep = np.ones(len(times), dtype=bool)
    keep[1:] = times[1:] > np.maximum.accumulate(times)[:-1]
    if dropped := np.count_nonzero(~keep):
        notes = (*notes, f"{dropped} of {len(times)} frames repeat or precede the time of an earlier one: left out.")
    times, positions, confidence = times[keep], positions[keep], confidence[keep]
    known = (confidence > LOST) & (positions != 0).any(axis=2)
    if not known.any():
        raise SkeletonLogError(
            at(path),
            found=f"no tracked performer in any of {len(times)} frames",
            expected="at least one tracked frame",
            fix="Record again with the performer in the sensor's view.",
        )
    positions = np.where(known[..., None], positions, np.nan)
    confidence = np.where(known, confidence, LOST).astype(np.float32)
    if orientations is not None:
        orientations = checked(orientations[keep])
        orientations[confidence < TRACKED] = np.nan
    return SkeletonClip(log_format, 0, times, positions, confidence, notes, orientations)


def frame_rate(options: ReadOptions, default: float) -> tuple[float, tuple[str, ...]]:
    """Return the frames a second of a log without a clock, and a note where they are assumed."""
    if options.fps is not None:
        return options.fps, ()
    return default, (f"The log has no clock: {default:g} frames a second assumed.",)
