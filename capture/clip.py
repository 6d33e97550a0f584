"""One performer's recorded frames, as every log reader returns them."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from capture.skeleton import JOINTS, LOST, SkeletonFrame


@dataclass(frozen=True, slots=True)
class SkeletonClip:
    """The frames of one performer, as recorded.

    Attributes
    ----------
    format : str
        Name of the log format it was read from.
    user : int
        The sensor's number for the performer; 0 where the format has none.
    times : (T,) float64
        Seconds, strictly increasing, not necessarily evenly spaced. The first need not be 0.
    positions : (T, 20, 3) float64
        Metres, sensor frame (see `capture.skeleton`), NaN where a joint is lost.
    confidence : (T, 20) float32
        1 tracked, 0.5 inferred, 0 lost.
    notes : tuple of str
        What the reader had to assume or leave out, a sentence each, for the user to read.
    orientations : (T, 20, 4) float64, optional
        How the bones are turned (`capture.orientations`), NaN where that is not known.
    """

    format: str
    user: int
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    confidence: NDArray[np.float32]
    notes: tuple[str, ...] = field(default=())
    orientations: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        """Check what every later step relies on; a failure here is a reader's fault, not the user's."""
        count = len(self.times)
        if self.positions.shape != (count, len(JOINTS), 3) or self.confidence.shape != (count, len(JOINTS)):
            raise ValueError(f"positions {self.positions.shape}, confidence {self.confidence.shape} for {count} frames")
        if self.orientations is not None and self.orientations.shape != (count, len(JOINTS), 4):
            raise ValueError(f"orientations {self.orientations.shape} for {count} frames")
        if np.any(np.diff(self.times) <= 0):
            raise ValueError("times must increase strictly")
        if not np.array_equal(np.isnan(self.positions).any(axis=2), self.confidence == LOST):
            raise ValueError("a joint is lost exactly where its position is NaN")

    @property
    def tracked_frames(self) -> int:
        """Frames in which at least one joint is known."""
        return int(np.count_nonzero((self.confidence > LOST).any(axis=1)))

    def frames(self) -> Iterator[SkeletonFrame]:
        """Go through the frames one by one, as a live source would give them."""
        turns = repeat(None) if self.orientations is None else self.orientations
        for time, positions, confidence, turn in zip(self.times, self.positions, self.confidence, turns, strict=False):
            yield SkeletonFrame(float(time), self.user, positions, confidence, turn)
