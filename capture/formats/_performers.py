"""The last step of the readers whose logs hold several bodies: one clip a performer."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from capture.clip import SkeletonClip
from capture.formats._clips import clip_of
from capture.orientations import none as unknown
from capture.skeleton import LOST, SkeletonFrame
from puppetline.errors import SkeletonLogError


def clips_by_performer(
    path: Path, log_format: str, frames: list[SkeletonFrame], notes: tuple[str, ...] = ()
) -> list[SkeletonClip]:
    """Sort the bodies of a log by their number.

    A performer's clip holds the frames that show the performer and no others, so it may start late and have gaps.
    Bodies of which no joint was ever tracked are left out.

    Parameters
    ----------
    path : Path
        The log, for the error.
    log_format : str
        The clips' `format`.
    frames : list of SkeletonFrame
        In the order of the log.
    notes : tuple of str
        For every clip.

    Returns
    -------
    list of SkeletonClip
        In the order in which the performers first appear.

    Raises
    ------
    SkeletonLogError
        No joint is known in any frame.
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
            clip = clip_of(path, log_format, times, positions, confidence, notes, orientations)
            clips.append(replace(clip, user=user))
    if not clips:
        raise SkeletonLogError(
            path,
            found="no frame with a tracked performer",
            expected="at least one",
            fix="Record again with the performer in the sensor's view.",
        )
    return clips
