"""Poses of several sensors from their recordings of the same motion."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.formats import read_log
from capture.fusion import fused_file
from capture.fusion.alignment import align as align_clips
from capture.fusion.source import Member
from capture.sensor_pose import SensorPose
from capture.sources.registry import is_recorded
from capture.timeline import choose
from puppetline.errors import SourceError
from puppetline.files import check_writable


@dataclass(frozen=True)
class SensorSummary:
    """Pose of one sensor, and how well its recording fits the first one.

    Attributes
    ----------
    log, source : str
    position : tuple
        Metres, in the first sensor's coordinates.
    rotation : tuple
        Degrees: tilt, turn, roll.
    clock : float
        Seconds by which its clock is ahead of the first sensor's.
    residual_cm : float
        Mean distance between the two positions of a joint, in centimetres.
    seconds : float
        How long both sensors saw the performer.
    swapped : float
        Share of the frames in which the sensors disagree about left and right.
    notes : tuple of str
    """

    log: str
    source: str
    position: tuple[float, ...]
    rotation: tuple[float, ...]
    clock: float
    residual_cm: float
    seconds: float
    swapped: float
    notes: tuple[str, ...]


def align(logs: Sequence[Path], sources: Sequence[str], output: Path) -> list[SensorSummary]:
    """Align recordings with the first one, and write the file for the source ``fused:``.

    Parameters
    ----------
    logs : sequence of Path
        Two or more recordings in any supported format. The performer who was tracked longest in each is used.
    sources : sequence of str
        URIs of the sensors that made the recordings, for the file; empty to replay the recordings.
    output : Path
        The .toml file.

    Returns
    -------
    list of SensorSummary
        One for each recording but the first.

    Raises
    ------
    PuppetlineError
        A recording cannot be read or does not fit, or the file cannot be written.
    """
    check_writable(output, ".toml", logs)
    if sources and len(sources) != len(logs):
        raise SourceError(
            "the sources",
            found=f"{len(sources)} sources and {len(logs)} recordings",
            expected="one source for each recording, in the same order",
            fix="Give all sources, or none to replay the recordings.",
        )
    folder = output.resolve().parent
    uris = sources or [f"replay:{Path(os.path.relpath(log.resolve(), folder)).as_posix()}" for log in logs]
    clips = [choose(read_log(log))[0] for log in logs]
    members = [Member(uris[0], SensorPose(np.eye(3), np.zeros(3)))]
    summaries = []
    for log, uri, clip in zip(logs[1:], uris[1:], clips[1:], strict=True):
        found = align_clips(clips[0], clip, f"{logs[0]} and {log}")
        clock = found.clock
        notes: tuple[str, ...] = ()
        if abs(clock) > fused_file.MAX_CLOCK_DIFFERENCE_SECONDS and not is_recorded(uri):
            clock, notes = 0.0, ("The clocks of the recordings differ; the live sensors are treated as equally late.",)
        pose, residual = found.pose, 100 * found.residual
        members.append(Member(uri, pose, clock))
        place = tuple(pose.position.tolist())
        summaries.append(
            SensorSummary(
                str(log), uri, place, pose.degrees, found.clock, residual, found.seconds, found.swapped, notes
            )
        )
    fused_file.write(output, members)
    return summaries
