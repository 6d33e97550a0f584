"""The last step of every format reader: checked clips from arrays or frames."""

import re
from collections.abc import Iterable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.formats.options import ReadOptions
from capture.orientations import unit_or_unknown, unknown
from capture.skeleton import INFERRED, LOST, SkeletonFrame
from puppetline.errors import SkeletonLogError

_OF = "camera|capture|clip|data|mocap|motion|original|recording|source|video"
_RATE = re.compile(
    f"(({_OF})_?)?(freq|frequency|fps|frame_?rate|sampl(e|ing)_?rate|(frame|sample|tick)s_?per_?second)|trajectories"
)
"""Names of values that are the number of frames per second; Vicon Nexus writes it below the last one."""

MAX_RATE, _STATED = 1000, "The file states {:g} frames per second."

DEFAULT_FPS = 30.0
"""Frames per second of a recording that states no times."""

MIN_RESTART_FRAMES = 10
"""Number of frames in which times go on after they began again."""

MAX_JOINTS = 500
"""Maximum number of joints of a skeleton; a detailed rig with fingers and face has about 150."""

MAX_POSITIONS = 10_000_000
"""Maximum number of joints times frames, about 100 bytes each: half an hour of CMU's skeleton at 120 Hz."""


def build_clip(
    path: Path,
    log_format: str,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    confidence: NDArray[np.float32],
    notes: tuple[str, ...] = (),
    orientations: NDArray[np.float64] | None = None,
    channels: dict[str, NDArray[np.float32]] | None = None,
) -> SkeletonClip:
    """Build one performer's clip from the frames of a recording.

    The arrays are those of `SkeletonClip`, in the order of the file, and the clip has user 0. Frames whose times begin
    again follow the others; those whose times do not increase otherwise are skipped, and a note counts them. A joint is
    lost if its confidence is 0 or its position is exactly (0, 0, 0), which recorders write for a lost joint. A
    quaternion becomes NaN if its length is not 1 or if its joint is inferred or lost.

    Raises
    ------
    SkeletonLogError
        All joints are lost in every frame.
    """
    times, restart_notes = _continued(times)
    notes = (*notes, *restart_notes)
    keep = np.ones(len(times), dtype=bool)
    keep[1:] = times[1:] > np.maximum.accumulate(times)[:-1]
    if skipped := np.count_nonzero(~keep):
        notes = (*notes, f"Skipped {skipped} of {len(times)} frames that repeat or precede an earlier time.")
    times, positions, confidence = times[keep], positions[keep], confidence[keep]
    known = (confidence > LOST) & (positions != 0).any(axis=2)
    if not known.any():
        raise _no_performer(path, f"no tracked performer in any of {len(times)} frames")
    positions = np.where(known[..., None], positions, np.nan)
    confidence = np.where(known, confidence, LOST).astype(np.float32)
    if orientations is not None:
        orientations = unit_or_unknown(orientations[keep])
        orientations[confidence <= INFERRED] = np.nan
    if channels is not None:
        kept = {name: values[keep] for name, values in channels.items()}
        channels = {name: values for name, values in kept.items() if not np.isnan(values).all()} or None
    return SkeletonClip(log_format, 0, times, positions, confidence, notes, orientations, channels=channels)


def _continued(times: NDArray[np.float64]) -> tuple[NDArray[np.float64], tuple[str, ...]]:
    """Return times of which those that begin again continue the others, and a note that they do.

    They begin again if they go back by most of what has passed, and go on for several frames.
    """
    steps = np.diff(times)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    starts, seen, latest = [0], 0, -np.inf
    for index in (np.flatnonzero(steps < 0) + 1).tolist():
        seen, latest = index, max(latest, times[seen:index].max())
        passed = latest - times[starts[-1]]
        goes_on = np.diff(times[index : index + MIN_RESTART_FRAMES])
        if (
            times[index - 1] - times[index] > passed / 2
            and len(goes_on) == MIN_RESTART_FRAMES - 1
            and (goes_on > 0).all()
        ):
            starts.append(index)
            latest = -np.inf
    if len(starts) == 1:
        return times, ()
    continued, end = times.copy(), -np.inf
    for start, stop in pairwise([*starts, len(times)]):
        if start:
            continued[start:stop] += end + step - times[start]
        end = max(end, continued[start:stop].max())
    count = "once" if len(starts) == 2 else f"{len(starts) - 1} times"
    return continued, (f"The times begin again {count}. These frames follow the others.",)


def clips_by_performer(
    path: Path, log_format: str, frames: list[SkeletonFrame], notes: tuple[str, ...] = ()
) -> list[SkeletonClip]:
    """Build one clip per user number from the frames of a recording of several performers.

    A performer's clip holds only the frames that show the performer, so it may start late and have gaps. A performer
    of whom no joint is ever tracked has no clip. The clips are in the order in which the performers first appear.

    Raises
    ------
    SkeletonLogError
        All joints are lost in every frame.
    """
    performers: dict[int, list[SkeletonFrame]] = {}
    for frame in frames:
        performers.setdefault(frame.user, []).append(frame)
    clips = []
    for user, seen in performers.items():
        times = np.array([frame.time for frame in seen])
        positions = np.stack([frame.positions for frame in seen])
        confidence = np.stack([frame.confidence for frame in seen])
        turns = [unknown() if frame.orientations is None else frame.orientations for frame in seen]
        orientations = np.stack(turns) if any(frame.orientations is not None for frame in seen) else None
        if (confidence > LOST).any():
            channels = _channels(seen)
            clip = build_clip(path, log_format, times, positions, confidence, notes, orientations, channels)
            clips.append(replace(clip, user=user))
    if not clips:
        raise _no_performer(path, "no frame with a tracked performer")
    return clips


def _channels(seen: list[SkeletonFrame]) -> dict[str, NDArray[np.float32]] | None:
    """Return the values of the channels of all frames; None if there are none."""
    values = [frame.channels or {} for frame in seen]
    names = dict.fromkeys(name for each in values for name in each)
    return {name: np.array([each.get(name, np.nan) for each in values], np.float32) for name in names} or None


def refuse_too_many(where: Path | str, frames: int, joints: int) -> None:
    """Raise an error if a recording has more than `MAX_POSITIONS` positions, before they fill the memory."""
    if frames * joints > MAX_POSITIONS:
        raise SkeletonLogError(
            where,
            found=f"{frames} frames of {joints} joints",
            expected=f"at most {MAX_POSITIONS // joints} frames",
            fix="Shorten the recording, or export it at a lower frame rate.",
        )


def frame_rate(options: ReadOptions, default: float) -> tuple[float, tuple[str, ...]]:
    """Return the frames per second of a recording without a clock, and a note if they are assumed."""
    if options.fps is not None:
        return options.fps, ()
    return default, (f"The recording has no clock; {default:g} frames per second are assumed.",)


def with_stated_rate(options: ReadOptions, values: Iterable[tuple[str, float]]) -> tuple[ReadOptions, tuple[str, ...]]:
    """Return options with the rate that a recording states among named values, if none is given, and a note on it."""
    stated = (
        value for name, value in values if _RATE.fullmatch(name.lower().replace(" ", "_")) and 1 <= value <= MAX_RATE
    )
    rate = next(stated, None) if options.fps is None else None
    return (options, ()) if rate is None else (replace(options, fps=rate), (_STATED.format(rate),))


def refuse_nobody(path: Path, positions: NDArray[np.float64]) -> None:
    """Raise an error if no position is known: recorders write zeros for a performer who is not seen."""
    if not np.nan_to_num(positions).any():
        raise _no_performer(path, f"no tracked performer in any of {len(positions)} frames")


def _no_performer(path: Path, found: str) -> SkeletonLogError:
    return SkeletonLogError(
        path,
        found=found,
        expected="at least one tracked frame",
        fix="Record again with the performer in the sensor's view.",
    )
