"""Resampling of a clip to a constant frame rate, and the choice of one of several performers."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.cuts import cut_frames
from capture.orientations import interpolated
from capture.skeleton import LOST, SkeletonFrame
from puppetline.errors import SkeletonLogError, at

MAX_FRAMES = 1_000_000
"""Maximum length of a timeline: nine hours at 30 frames per second. A longer recording has a wrong clock."""

TIME_TOLERANCE_SECONDS = 1e-6
"""Maximum difference of equal times: below the resolution of sensors, above the rounding of times since 1970."""


@dataclass(frozen=True, slots=True)
class Timeline:
    """One performer's frames at a constant rate; frame k is at k / fps seconds.

    Attributes
    ----------
    fps : float
        Frames per second.
    positions : (T, 20, 3) float64
        Metres, sensor coordinates. A lost joint has its last known position, or its first one before that. A joint that
        is lost in all frames is NaN.
    confidence : (T, 20) float32
        1 tracked, 0.5 inferred, 0 lost.
    gaps : tuple of (float, float)
        Start and end in seconds of the gaps, without any known joint, that are too long to interpolate.
    orientations : (T, 20, 4) float64, optional
        Orientations of the bones (`capture.orientations`), NaN if unknown.
    rest : (20, 3) float64, optional
        The performer's calibration pose in the coordinates of the positions, if it is known otherwise than from them.
    channels : dict of str to (T,) float32, optional
        Values of channels (`capture.channels`).
    legs : int
        Number of legs of the body: 4 for an animal, whose forelegs are arms.
    """

    fps: float
    positions: NDArray[np.float64]
    confidence: NDArray[np.float32]
    gaps: tuple[tuple[float, float], ...]
    orientations: NDArray[np.float64] | None = None
    rest: NDArray[np.float64] | None = None
    channels: dict[str, NDArray[np.float32]] | None = None
    legs: int = 2

    @property
    def times(self) -> NDArray[np.float64]:
        """Times (T,) of the frames in seconds, from 0."""
        return np.arange(len(self.positions)) / self.fps

    def frame(self, number: int) -> SkeletonFrame:
        """Return one frame, of user 0, like a live source."""
        orientations = None if self.orientations is None else self.orientations[number]
        channels = {name: float(values[number]) for name, values in (self.channels or {}).items()}
        return SkeletonFrame(
            number / self.fps, 0, self.positions[number], self.confidence[number], orientations, channels or None
        )

    def part(self, first: int, end: int) -> "Timeline":
        """Return the frames from number `first` to before number `end`; their times begin at 0."""
        start, stop = first / self.fps, (end - 1) / self.fps
        return Timeline(
            self.fps,
            self.positions[first:end],
            self.confidence[first:end],
            tuple((max(a, start) - start, min(b, stop) - start) for a, b in self.gaps if a < stop and b > start),
            None if self.orientations is None else self.orientations[first:end],
            self.rest,
            None if self.channels is None else {name: each[first:end] for name, each in self.channels.items()},
            self.legs,
        )

    @property
    def held(self) -> int:
        """Number of positions, over all joints and frames, that are held because the joint is lost."""
        return int(np.count_nonzero((self.confidence == LOST) & np.isfinite(self.positions).all(axis=2)))

    def summary(self) -> str:
        """Return one line about the length, the held positions and the gaps."""
        count = len(self.positions)
        text = f"{_count(count, 'frame')} at {self.fps:g} per second"
        if self.held:
            text += f", {100 * self.held / self.confidence.size:.1f} % of the joint positions held while lost"
        if self.gaps:
            start, end = max(self.gaps, key=lambda gap: gap[1] - gap[0])
            text += f", {_count(len(self.gaps), 'gap')} (longest {end - start:.2f} s, from {start:.2f} s)"
        return text


def resample(clip: SkeletonClip, fps: float = 30.0, max_gap: float = 0.25) -> Timeline:
    """Resample a clip to a constant rate, from its first frame with a known joint to its last.

    Each joint is interpolated linearly between neighbouring known samples that are at most `max_gap` apart, with the
    lower of their two confidences. In longer gaps it is lost: it keeps its position with confidence 0. All joints keep
    their positions until a cut (`capture.cuts`).

    Parameters
    ----------
    clip : SkeletonClip
    fps : float
        Frames per second of the result.
    max_gap : float
        Seconds.

    Raises
    ------
    SkeletonLogError
        All joints are lost in every frame, or the result would have more than `MAX_FRAMES` frames.
    ValueError
        fps is not a positive number, or max_gap is negative.
    """
    if not (0 < fps < math.inf and max_gap >= 0):
        raise ValueError(f"fps {fps}, max_gap {max_gap}")
    seen = clip.times[(clip.confidence > LOST).any(axis=1)]
    if not len(seen):
        raise SkeletonLogError(
            _name(clip),
            found="no frame in which any joint is known",
            expected="at least one tracked frame",
            fix="Choose another performer or another recording.",
        )
    times = np.arange(_frame_count(clip, seen, fps)) / fps
    known_times = clip.times - seen[0]
    cuts = known_times[cut_frames(clip.times, clip.positions, clip.confidence)[1]]
    positions = np.empty((len(times), *clip.positions.shape[1:]))
    confidence = np.empty(positions.shape[:2], dtype=np.float32)
    for joint in range(positions.shape[1]):
        positions[:, joint], confidence[:, joint] = _resample_joint(
            times, known_times, cuts, clip.positions[:, joint], clip.confidence[:, joint], max_gap
        )
    orientations = None
    if clip.orientations is not None:
        orientations = _resample_orientations(times, known_times, cuts, clip.orientations, max_gap)
    channels = None
    if clip.channels is not None:
        channels = {name: _resample_channel(times, known_times, cuts, values) for name, values in clip.channels.items()}
    seen = seen - seen[0]
    before_gap = np.flatnonzero(np.diff(seen) > max_gap + TIME_TOLERANCE_SECONDS)
    gaps = tuple((float(seen[i]), float(seen[i + 1])) for i in before_gap)
    return Timeline(fps, positions, confidence, gaps, orientations, clip.rest, channels, clip.legs)


def choose(clips: Sequence[SkeletonClip], user: int | None = None) -> tuple[SkeletonClip, str]:
    """Choose one performer's clip: the given user's, or the one that is tracked in most frames.

    Returns
    -------
    clip : SkeletonClip
    note : str
        A sentence about the choice and the other performers.

    Raises
    ------
    SkeletonLogError
        There is no clip, or none of that user.
    """
    if not clips:
        raise SkeletonLogError(
            "the recording",
            found="no performer",
            expected="at least one performer",
            fix="Record again with a performer in view.",
        )
    wanted = [clip for clip in clips if user is None or clip.user == user]
    if not wanted:
        raise SkeletonLogError(
            at(f"the {clips[0].format} recording", field="user"),
            found=f"no user {user}",
            expected="one of " + ", ".join(_describe(clip) for clip in clips),
            fix="Use one of these numbers, or none to choose the performer who is tracked longest.",
        )
    chosen = max(wanted, key=lambda clip: clip.tracked_frames)
    others = ", ".join(_describe(clip) for clip in clips if clip is not chosen) or "none"
    return chosen, f"User {_describe(chosen)} was chosen; other performers: {others}."


def _resample_joint(
    times: NDArray[np.float64],
    sample_times: NDArray[np.float64],
    cuts: NDArray[np.float64],
    positions: NDArray[np.float64],
    confidence: NDArray[np.float32],
    max_gap: float,
) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Resample one joint's (S, 3) samples to (T, 3) and their confidence to (T,)."""
    known = confidence > LOST
    if not known.any():
        return np.full((len(times), 3), np.nan), np.zeros(len(times), dtype=np.float32)
    sample_times, positions, confidence = sample_times[known], positions[known], confidence[known]

    left, right, elapsed, span = _neighbours(times, sample_times, cuts)
    on_sample = np.abs(elapsed) <= TIME_TOLERANCE_SECONDS
    # there is no sample to the right of the last one (span 0) or to the left of the first one
    between = (elapsed > TIME_TOLERANCE_SECONDS) & (span > 0) & (span <= max_gap + TIME_TOLERANCE_SECONDS)
    between &= _part_of(times, cuts) == _part_of(sample_times, cuts)[left]

    part = np.divide(elapsed, span, out=np.zeros_like(times), where=between)[:, None]
    resampled = positions[left] + part * (positions[right] - positions[left])
    lower = np.minimum(confidence[left], confidence[right])
    return resampled, np.where(on_sample, confidence[left], np.where(between, lower, np.float32(LOST)))


def _neighbours(
    times: NDArray[np.float64], sample_times: NDArray[np.float64], cuts: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
    """Return the samples (T,) before and after each time, and the time since the former and between both.

    If one of the cuts (C,) is between both samples, the former is returned twice.
    """
    left = np.maximum(np.searchsorted(sample_times, times + TIME_TOLERANCE_SECONDS, side="right") - 1, 0)
    right = np.minimum(left + 1, len(sample_times) - 1)
    part = _part_of(sample_times, cuts)
    same = np.where(part[left] == part[right], right, left)
    return left, same, times - sample_times[left], sample_times[right] - sample_times[left]


def _part_of(times: NDArray[np.float64], cuts: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return how many cuts there are until each time."""
    return np.searchsorted(cuts, times + TIME_TOLERANCE_SECONDS, side="right")


def _resample_orientations(
    times: NDArray[np.float64],
    sample_times: NDArray[np.float64],
    cuts: NDArray[np.float64],
    samples: NDArray[np.float64],
    max_gap: float,
) -> NDArray[np.float64]:
    """Resample (S, 20, 4) orientations to (T, 20, 4), NaN if a neighbouring sample is unknown or too far away."""
    left, right, elapsed, span = _neighbours(times, sample_times, cuts)
    on_sample = np.abs(elapsed) <= TIME_TOLERANCE_SECONDS
    part = np.divide(elapsed, span, out=np.zeros_like(times), where=~on_sample & (span > 0))[:, None]
    found = [
        interpolated(joint[left], np.where(part == 0, joint[left], joint[right]), part)
        for joint in samples.swapaxes(0, 1)
    ]
    resampled = np.stack(found, axis=1)
    resampled[~on_sample & (span > max_gap + TIME_TOLERANCE_SECONDS)] = np.nan
    return resampled


def _resample_channel(
    times: NDArray[np.float64],
    sample_times: NDArray[np.float64],
    cuts: NDArray[np.float64],
    values: NDArray[np.float32],
) -> NDArray[np.float32]:
    """Interpolate a channel between its known values; hold the first and the last one, and those before cuts."""
    known = ~np.isnan(values)
    values = values[known]
    left, right, elapsed, span = _neighbours(times, sample_times[known], cuts)
    part = np.clip(np.divide(elapsed, span, out=np.zeros_like(times), where=span > 0), 0, 1)
    return (values[left] + part * (values[right] - values[left])).astype(np.float32)


def _frame_count(clip: SkeletonClip, seen: NDArray[np.float64], fps: float) -> int:
    duration = float(seen[-1] - seen[0])
    last = (duration + TIME_TOLERANCE_SECONDS) * fps
    if last >= MAX_FRAMES:
        widest = int(np.argmax(np.diff(seen)))
        raise SkeletonLogError(
            _name(clip),
            found=f"{duration:g} s from the first to the last tracked frame, or {last:.3g} frames at {fps:g} per "
            f"second (the longest gap is {seen[widest + 1] - seen[widest]:g} s, after {seen[widest]:.10g} s)",
            expected=f"at most {MAX_FRAMES} frames",
            fix="Correct the time or frame number after that gap, delete the frames after it, or lower the frame rate.",
        )
    return math.floor(last) + 1


def _name(clip: SkeletonClip) -> str:
    return f"the {clip.format} recording, user {clip.user}"


def _describe(clip: SkeletonClip) -> str:
    return f"{clip.user} ({_count(clip.tracked_frames, 'tracked frame')})"


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}" if number == 1 else f"{number} {thing}s"
