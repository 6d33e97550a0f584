"""Cuts in a performer's motion: displacements that no person makes, in files, replays and live.

Sensors confuse people, senders change their origin, and recordings are joined. What follows a motion over time
(filters, springs, held feet) begins again after a cut.
"""

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import LOST

MAX_SPEED = 12.0
"""Largest speed of a person, in metres per second: that of a sprinter."""

SLACK_METRES = 0.15
"""Displacement that errors of a sensor add to a person's, in metres."""

MAX_SECONDS = 0.1
"""Longest time for which this speed counts, in seconds: after a gap, a motion does not continue."""

MIN_JOINTS = 3
"""Smallest number of joints, known before and after, that tell a cut."""


def is_cut(
    before: NDArray[np.float64],
    confidence_before: NDArray[np.float32],
    after: NDArray[np.float64],
    confidence_after: NDArray[np.float32],
    elapsed: NDArray[np.float64] | float,
    share: float = 0.5,
) -> NDArray[np.bool_]:
    """Return whether a performer cannot have moved from one pose to another.

    Parameters
    ----------
    before, after : (..., 20, 3) float64
        Metres.
    confidence_before, confidence_after : (..., 20) float32
    elapsed : (...) float64
        Seconds between the poses.
    share : float
        Share of the joints that may move too fast, because a sensor mistakes single limbs.

    Returns
    -------
    (...) bool
    """
    known = (confidence_before > LOST) & (confidence_after > LOST)
    distances = np.where(known, np.linalg.norm(after - before, axis=-1), np.inf)
    count = known.sum(axis=-1)
    place = np.maximum(np.ceil((1 - share) * count).astype(np.intp) - 1, 0)
    distance = np.take_along_axis(np.sort(distances, axis=-1), place[..., None], axis=-1)[..., 0]
    limit = SLACK_METRES + MAX_SPEED * np.minimum(elapsed, MAX_SECONDS)
    return np.asarray((count >= MIN_JOINTS) & (distance > limit))


def cut_frames(
    times: NDArray[np.float64], positions: NDArray[np.float64], confidence: NDArray[np.float32], share: float = 0.5
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the last frame before each cut of a clip, and the first after it; frames without joints do not count.

    Parameters
    ----------
    times : (T,) float64
    positions : (T, 20, 3) float64
    confidence : (T, 20) float32
    share : float
        As for `is_cut`.

    Returns
    -------
    before, after : (C,) intp
        Numbers of the frames.
    """
    seen = np.flatnonzero((confidence > LOST).any(axis=1))
    before, after = seen[:-1], seen[1:]
    cut = is_cut(
        positions[before], confidence[before], positions[after], confidence[after], times[after] - times[before], share
    )
    return before[cut], after[cut]
