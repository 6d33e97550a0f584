"""The recorded frames of one performer, which every format reader returns."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from capture.events import Cue
from capture.skeleton import JOINTS, LOST, SkeletonFrame


@dataclass(frozen=True, slots=True)
class SkeletonClip:
    """The frames of one performer, as recorded.

    Attributes
    ----------
    format : str
        Name of the recording's format.
    user : int
        User number; 0 if the format has none.
    times : (T,) float64
        Seconds, strictly increasing, not necessarily at regular intervals or from 0.
    positions : (T, 20, 3) float64
        Metres, sensor coordinates (see `capture.skeleton`), NaN for lost joints.
    confidence : (T, 20) float32
        1 tracked, 0.5 inferred, 0 lost.
    notes : tuple of str
        Sentences for the user about the reader's assumptions and skipped data.
    orientations : (T, 20, 4) float64, optional
        Orientations of the bones (`capture.orientations`), NaN if unknown.
    channels : dict of str to (T,) float32, optional
        Values of channels (`capture.channels`), NaN if unknown.
    rest : (20, 3) float64, optional
        The performer's rest pose, in place of the first frame, if the recording has one beside its frames.
    legs : int
        Number of legs of the body: 4 for an animal, whose forelegs are arms.
    cues : tuple of Cue
        Commands of the whole recording, in its order; only takes have them.
    """

    format: str
    user: int
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    confidence: NDArray[np.float32]
    notes: tuple[str, ...] = field(default=())
    orientations: NDArray[np.float64] | None = None
    cues: tuple[Cue, ...] = ()
    channels: dict[str, NDArray[np.float32]] | None = None
    rest: NDArray[np.float64] | None = None
    legs: int = 2

    def __post_init__(self) -> None:
        """Check the conditions on which all later steps rely; a failure is a bug of the reader."""
        count = len(self.times)
        if self.positions.shape != (count, len(JOINTS), 3) or self.confidence.shape != (count, len(JOINTS)):
            raise ValueError(f"positions {self.positions.shape}, confidence {self.confidence.shape} for {count} frames")
        if self.orientations is not None and self.orientations.shape != (count, len(JOINTS), 4):
            raise ValueError(f"orientations {self.orientations.shape} for {count} frames")
        if np.any(np.diff(self.times) <= 0):
            raise ValueError("times must increase strictly")
        if not np.array_equal(np.isnan(self.positions).any(axis=2), self.confidence == LOST):
            raise ValueError("a joint must be lost exactly if its position is NaN")

    @property
    def tracked_frames(self) -> int:
        """Number of frames in which at least one joint is known."""
        return int(np.count_nonzero((self.confidence > LOST).any(axis=1)))

    def frames(self) -> Iterator[SkeletonFrame]:
        """Yield the frames one by one, like a live source."""
        orientations = repeat(None) if self.orientations is None else self.orientations
        frames = zip(self.times, self.positions, self.confidence, orientations, strict=False)
        for number, (time, positions, confidence, orientation) in enumerate(frames):
            values = {name: float(each[number]) for name, each in (self.channels or {}).items()}
            known = {name: value for name, value in values.items() if not np.isnan(value)}
            yield SkeletonFrame(float(time), self.user, positions, confidence, orientation, known or None)
