"""Conversion of a recording to animations of its performers' own skeletons, without a character."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from capture.clip import SkeletonClip
from capture.sensor_tilt import SensorTilt, tilt_of_recording
from capture.sensors.recorded_video import read_recording
from capture.skeleton import JOINT_INDEX, JOINTS
from capture.timeline import Timeline, choose
from engine_bridge.export.performer.bvh import write_bvh
from engine_bridge.export.performer.gltf import skeleton_animation, vrm_animation
from engine_bridge.export.performer.motion import PerformerMotion, motion_of
from engine_bridge.performance.calibration import of_performer
from engine_bridge.performance.clip import Progress, part_of, timeline_of
from engine_bridge.performance.settings import PerformerFormat, Settings
from puppetline.errors import SkeletonLogError
from puppetline.files import check_one_of

ENDINGS = tuple(f".{each}" for each in get_args(PerformerFormat))
"""Endings of files that can have the animation of a performer."""


@dataclass(frozen=True)
class PerformerSummary:
    """A written animation of one performer.

    Attributes
    ----------
    output : str
    user : int
    frames : int
    seconds : float
        Time of the last frame.
    bones : int
        Number of joints with keyframes.
    height : float
        Metres from the floor to the top of the head in the T-pose.
    bytes : int
    notes : tuple of str
        Sentences for the user about the recording.
    """

    output: str
    user: int
    frames: int
    seconds: float
    bones: int
    height: float
    bytes: int
    notes: tuple[str, ...]


class UprightPerformers(NamedTuple):
    """The performers of a recording in upright coordinates.

    Attributes
    ----------
    clips : list of SkeletonClip
    origin : (3,) float64
        Hips of the performer who is tracked longest, when they are first known, sensor coordinates.
    notes : tuple of str
    """

    clips: list[SkeletonClip]
    origin: NDArray[np.float64]
    notes: tuple[str, ...]


def upright_performers(clips: list[SkeletonClip]) -> UprightPerformers:
    """Return the performers of a recording with the tilt of its sensor removed.

    Calibrations in a take have the tilt, and BVH files have a known up axis.
    """
    known = any(clip.format == "bvh" or bool(of_performer(clips, clip)[0]) for clip in clips)
    sensor = SensorTilt() if known else tilt_of_recording(clips)
    notes: tuple[str, ...] = ()
    if sensor.tilt:
        notes = (f"The sensor looks down by {sensor.tilt:.0f}°, from performers who stand upright; this is corrected.",)
    levelled = [sensor.levelled(clip) for clip in clips]
    hips = choose(levelled)[0].positions[:, JOINT_INDEX["hip_center"]] if clips else np.zeros((0, 3))
    seen = hips[np.isfinite(hips).all(axis=1)]
    return UprightPerformers(levelled, seen[0] if len(seen) else np.zeros(3), notes)


def check_output(output: Path, log: Path) -> None:
    """Check before the work that the animation of a performer can be written.

    Raises
    ------
    OutputError
    """
    expected = "'.bvh', '.vrma' or '.glb', for the performer's own skeleton"
    check_one_of(output, ENDINGS, expected, f"Call it {output.stem}.bvh, or name a character with --puppet.", (log,))


def convert_performers(
    log: Path, output: Path, settings: Settings, progress: Progress = lambda _stage, _share: None
) -> list[PerformerSummary]:
    """Convert a recording to the animation of its performer, or of each one to a file of its own.

    With several performers and none chosen, the files are named NAME.userN.ENDING. A performer who cannot be converted,
    because there is a single frame for example, is omitted with a note, unless there is no other.

    Parameters
    ----------
    log, output : Path
    settings : Settings
    progress : callable, optional

    Returns
    -------
    list of PerformerSummary
        At least one, in the order of the user numbers.

    Raises
    ------
    PuppetlineError
    """
    check_output(output, log)
    performers = upright_performers(read_recording(log, settings.log))
    if settings.user is not None or len(performers.clips) <= 1:
        return [convert_performer(performers, log, output, log.stem, settings, progress)]
    made, refused = [], []
    for user in sorted(clip.user for clip in performers.clips):
        own = output.with_name(f"{output.stem}.user{user}{output.suffix}")
        check_output(own, log)
        try:
            made.append(convert_performer(performers, log, own, log.stem, replace(settings, user=user), progress))
        except SkeletonLogError as error:
            refused.append((user, error))
    if not made:
        raise refused[0][1]
    omitted = tuple(f"User {user} is omitted: {error.found}." for user, error in refused)
    return [*made[:-1], replace(made[-1], notes=made[-1].notes + omitted)]


def convert_performer(
    performers: UprightPerformers,
    log: Path,
    output: Path,
    name: str,
    settings: Settings,
    progress: Progress = lambda _stage, _share: None,
) -> PerformerSummary:
    """Write the animation of one performer.

    Parameters
    ----------
    performers : UprightPerformers
    log : Path
        Recording, for error messages.
    output : Path
        Its ending is one of `ENDINGS`.
    name : str
        Name of the animation.
    settings : Settings
    progress : callable, optional

    Raises
    ------
    PuppetlineError
    """
    clip, chosen = choose(performers.clips, settings.user)
    timeline, notes = timeline_of(performers.clips, log, replace(settings, user=clip.user))
    if settings.user is not None:
        notes = tuple(note for note in notes if note != chosen)
    progress("Performing", 0.0)
    motion = motion_of(timeline, performers.origin).part(*part_of(timeline, settings))
    progress("Performing", 1.0)
    _write(motion, output, name)
    return PerformerSummary(
        output=str(output),
        user=clip.user,
        frames=len(motion.hips),
        seconds=(len(motion.hips) - 1) / motion.fps,
        bones=len(motion.body.skeleton.joints),
        height=motion.body.height,
        bytes=output.stat().st_size,
        notes=(*notes, *performers.notes, *_unknown(timeline), *_late(performers.clips, clip)),
    )


def _write(motion: PerformerMotion, output: Path, name: str) -> None:
    ending = output.suffix.lower()
    if ending == ".bvh":
        write_bvh(output, motion)
    elif ending == ".vrma":
        vrm_animation(motion, name).save(output)
    else:
        skeleton_animation(motion, name).save(output)


def _unknown(timeline: Timeline) -> tuple[str, ...]:
    """Return a note about joints that are lost in all frames."""
    lost = [joint for row, joint in enumerate(JOINTS) if np.isnan(timeline.positions[:, row]).all()]
    if not lost:
        return ()
    return (f"The recording has no data for {', '.join(lost)}; bones that end there keep their pose in the T-pose.",)


def _late(clips: Sequence[SkeletonClip], clip: SkeletonClip) -> tuple[str, ...]:
    """Return a note about the time at which a performer's animation begins, if another one begins earlier."""

    def begins(each: SkeletonClip) -> float:
        seen = each.times[(each.confidence > 0).any(axis=1)]
        return float(seen[0]) if len(seen) else np.inf

    late = begins(clip) - min(map(begins, clips))
    return (f"User {clip.user} appears {late:.2f} s after the first performer.",) if late > 0 else ()


def describe(summaries: Sequence[PerformerSummary]) -> str:
    """Return the summary of a conversion as lines of text."""
    lines = []
    for each in summaries:
        lines += [
            f"{each.output}: {each.frames:,} frames, {each.seconds:.1f} s, {each.bytes / 1e3:,.0f} kB",
            f"  performer      user {each.user}, {each.height:.2f} m tall, {each.bones} joints",
            *(f"  note: {note}" for note in each.notes),
        ]
    return "\n".join(lines)
