"""Recorded skeletons on a timeline, and the motion of a character that follows them."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.clip import SkeletonClip
from capture.sensors.recorded_video import read_recording
from capture.skeleton import JOINTS, LOST
from capture.timeline import Timeline, choose, resample
from engine_bridge.performance.animals import of_animal
from engine_bridge.performance.calibration import TakeCalibration, of_performer
from engine_bridge.performance.channels import with_voice
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.motion import SolvedMotion
from engine_bridge.performance.pose import Pose
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet.puppet import Puppet
from puppetline.errors import SkeletonLogError, at
from solver.model.batch import BatchBinding
from solver.model.stretch import EdgeStretch
from solver.surface.contacts import PartSeparation

REST_SECONDS = 0.5
"""Time over which the median pose is the performer's rest pose, in seconds."""

MIN_MEASURED_FRAMES, MAX_MEASURED_STRIDE = 600, 3
"""Minimum number of frames with which the stretch of a long clip is measured, and their maximum interval in frames."""

MIN_CLIP_FRAMES = 2
"""Minimum number of frames of an animation."""


@dataclass(frozen=True)
class TakeTimeline(Timeline):
    """A performer's frames in a take, with the calibrations of the take.

    Attributes
    ----------
    mirror : bool or None
        Whether the performer's left moves the character's right; None for the puppet's setting.
    later : dict
        By number of the frame from which they are used: calibration poses (20, 3) in the coordinates of the positions,
        and whether to mirror.
    """

    mirror: bool | None = None
    later: Mapping[int, tuple[NDArray[np.float64], bool | None]] = field(default_factory=dict)


Progress = Callable[[str, float], None]
"""Callback that receives the name of a step and the share of it that is done."""


@dataclass(frozen=True)
class Clip:
    """A solved clip, before it is written.

    Attributes
    ----------
    motion : SolvedMotion
    positions : (F, 20, 3) float64
        The performer's joints in each frame, see `Timeline`.
    stretch : tuple of float
        Edge stretch over the clip: 1st, 50th and 99th percentile. In a long clip, only every second or third frame is
        measured.
    parts_apart : float or None
        Maximum separation of parts that touch at rest, as a fraction of the diagonal; None for a character of one part.
    notes : tuple of str
        Sentences for the user about the recording.
    """

    motion: SolvedMotion
    positions: NDArray[np.float64]
    stretch: tuple[float, ...]
    parts_apart: float | None
    notes: tuple[str, ...]


def load_timeline(log: Path, settings: Settings, *, animals: bool = False) -> tuple[Timeline, tuple[str, ...]]:
    """Read a recording, of a person or perhaps an animal, and resample the chosen performer to an even frame rate.

    Returns
    -------
    timeline : Timeline
    notes : tuple of str
        Sentences about assumptions, skipped data and held joints.

    Raises
    ------
    SkeletonLogError
    """
    return timeline_of(read_recording(log, replace(settings.log, animals=animals)), log, settings)


def timeline_of(clips: list[SkeletonClip], log: Path, settings: Settings) -> tuple[Timeline, tuple[str, ...]]:
    """Resample the chosen performer of a recording that has been read; see `load_timeline`."""
    try:
        clip, chosen = choose(clips, settings.user)
        found, about_rest = ((), ()) if settings.rest_at is not None else of_performer(clips, clip)
        if len(clips) == len(clip.times) == 1:
            clip = _held(clip, MIN_CLIP_FRAMES / settings.fps)
        timeline = resample(_levelled(clip, found), settings.fps, settings.max_gap)
        if found:
            timeline = _calibrated(timeline, clip, found)
        timeline, about_sound = with_voice(timeline, clip, log)
    except SkeletonLogError as error:  # these errors do not name the file
        where = at(log, field=error.where)
        raise SkeletonLogError(where, found=error.found, expected=error.expected, fix=error.fix) from error
    if len(timeline.positions) < MIN_CLIP_FRAMES:
        raise SkeletonLogError(
            log,
            found=f"a recording with a single frame at {settings.fps:g} frames per second",
            expected=f"at least {MIN_CLIP_FRAMES} frames",
            fix="Use a longer recording, or raise --fps.",
        )
    if settings.rest_at is not None and settings.rest_at > timeline.times[-1]:
        raise SkeletonLogError(
            log,
            found=f"a recording of {timeline.times[-1]:.2f} s",
            expected=f"a recording that contains the time of the rest pose, {settings.rest_at:g} s",
            fix="Choose an earlier time with --rest-at.",
        )
    end = timeline.times[-1] if settings.stop is None else min(settings.stop, timeline.times[-1])
    if (end - settings.start) * timeline.fps < MIN_CLIP_FRAMES - 1.5:
        raise SkeletonLogError(
            log,
            found=f"{max(end - settings.start, 0.0):.2f} s from second {settings.start:g} on",
            expected=f"at least {MIN_CLIP_FRAMES} frames in the part to animate, of {timeline.times[-1]:.2f} s",
            fix="Choose an earlier start or a later stop.",
        )
    others = (chosen,) if len(clips) > 1 else ()
    return timeline, (
        *clip.notes,
        *others,
        *about_rest,
        *about_sound,
        *((timeline.summary(),) if timeline.held else ()),
    )


def _held(clip: SkeletonClip, seconds: float) -> SkeletonClip:
    """Return a clip of one pose as one that holds it for some time."""
    return replace(
        clip,
        times=np.array([clip.times[0], clip.times[0] + seconds]),
        positions=np.repeat(clip.positions, 2, axis=0),
        confidence=np.repeat(clip.confidence, 2, axis=0),
        orientations=None if clip.orientations is None else np.repeat(clip.orientations, 2, axis=0),
        channels=None if clip.channels is None else {name: np.repeat(each, 2) for name, each in clip.channels.items()},
        notes=(*clip.notes, "The recording is a single pose, which is held."),
    )


def _levelled(clip: SkeletonClip, found: Sequence[TakeCalibration]) -> SkeletonClip:
    """Return a clip whose frames are corrected by the position of the sensor in the calibration in use."""
    if not found:
        return clip
    parts = [each.calibration.sensor.levelled(clip) for each in found]
    number = np.searchsorted([each.time for each in found[1:]], clip.times, side="right")
    rows = np.arange(len(clip.times))
    orientations = [each.orientations for each in parts if each.orientations is not None]
    return replace(
        clip,
        positions=np.stack([each.positions for each in parts])[number, rows],
        orientations=np.stack(orientations)[number, rows] if orientations else None,
    )


def _calibrated(timeline: Timeline, clip: SkeletonClip, found: Sequence[TakeCalibration]) -> TakeTimeline:
    """Return a timeline with the calibrations of a take."""
    start = clip.times[(clip.confidence > LOST).any(axis=1)][0]
    poses = [each.calibration.sensor.upright(each.calibration.rest) for each in found]
    later = {
        math.ceil((each.time - start) * timeline.fps): (pose, each.mirror)
        for each, pose in zip(found[1:], poses[1:], strict=True)
    }
    kept: dict[str, Any] = {each.name: getattr(timeline, each.name) for each in fields(Timeline)} | {"rest": poses[0]}
    return TakeTimeline(**kept, mirror=found[0].mirror, later=later)


def resting_pose(timeline: Timeline, settings: Settings) -> NDArray[np.float64]:
    """Return the performer's calibration pose (20, 3), which corresponds to the character's rest pose."""
    if settings.rest_at is None and timeline.rest is not None:
        return timeline.rest
    first = int((settings.rest_at or 0.0) * timeline.fps)
    count = max(1, round(REST_SECONDS * timeline.fps))
    return body.resting_pose(timeline.positions, timeline.confidence, first=first, count=count)


def reference_pose(puppet: Puppet, timeline: Timeline, settings: Settings) -> NDArray[np.float64]:
    """Return the pose (20, 3) that corresponds to the character's rest pose.

    It is the calibration pose; limbs that turn are compared with an upright stand unless somebody calibrated, because
    recordings begin in mid step.
    """
    pose = resting_pose(timeline, settings)
    calibrated = settings.rest_at is not None or isinstance(timeline, TakeTimeline)
    turns = any(limb.follow == "turn" for limb in puppet.limbs)
    return body.upright(pose) if turns and not calibrated else pose


def poses(prepared: PreparedCharacter, timeline: Timeline, settings: Settings) -> Iterator[Pose]:
    """Yield the poses of a character for the frames of a timeline, with the calibrations of the take."""
    take = timeline if isinstance(timeline, TakeTimeline) else None
    if timeline.legs > 2:
        prepared = replace(prepared, puppet=of_animal(prepared.puppet))
    rest = reference_pose(prepared.puppet, timeline, settings)
    motion = CharacterMotion(prepared, rest, mirror=None if take is None else take.mirror)
    for number in range(len(timeline.positions)):
        if take is not None and number in take.later:
            rest, mirror = take.later[number]
            motion.mirror = motion.mirror if mirror is None else mirror
            motion.follow(number / timeline.fps, motion.retargeting(rest))
        yield motion.step(timeline.frame(number))


def solve(
    prepared: PreparedCharacter,
    timeline: Timeline,
    settings: Settings,
    progress: Callable[[float], None] = lambda _share: None,
) -> SolvedMotion:
    """Return the motion of a character for the frames of a timeline, or for the part of it that the settings name.

    Parameters
    ----------
    prepared : PreparedCharacter
    timeline : Timeline
    settings : Settings
    progress : callable, optional
        Receives the share of the frames that are solved.
    """
    first, end = part_of(timeline, settings)
    motion = SolvedMotion(prepared, timeline.fps)
    for pose in islice(poses(prepared, timeline, settings), first, end):
        motion.append(pose)
        progress(len(motion) / (end - first))
    return motion


def part_of(timeline: Timeline, settings: Settings) -> tuple[int, int]:
    """Return the number of the first frame to animate, and that of the frame after the last one."""
    last = len(timeline.positions) - 1
    if settings.stop is not None:
        last = min(round(settings.stop * timeline.fps), last)
    return min(round(settings.start * timeline.fps), last - MIN_CLIP_FRAMES + 1), last + 1


def perform(
    prepared: PreparedCharacter, timeline: Timeline, settings: Settings, notes: tuple[str, ...], progress: Progress
) -> Clip:
    """Solve a timeline, and measure the deformation of the character."""
    motion = solve(prepared, timeline, settings, partial(progress, "Performing"))
    surface, stretch = BatchBinding.of_solver_mesh(prepared.model, prepared.mesh), EdgeStretch(prepared.mesh)
    separation = PartSeparation(prepared.mesh) if prepared.mesh.parts > 1 else None
    # percentiles of motion do not need every frame of a long clip; the largest separation does
    stride = 1 if separation else min(MAX_MEASURED_STRIDE, max(1, len(motion) // MIN_MEASURED_FRAMES))
    chunk = stride * surface.batch_frames
    for start in range(0, len(motion), chunk):
        vertices = surface.displacements(motion.R[start : start + chunk][::stride])  # precise near the middle
        stretch.add(vertices)
        if separation is not None:
            separation.add(vertices)
    mirror = timeline.mirror if isinstance(timeline, TakeTimeline) else None
    if mirror not in (None, prepared.puppet.retarget.mirror):
        notes = (
            *notes,
            f"The take {'mirrors' if mirror else 'does not mirror'} the performer, unlike the puppet file.",
        )
    rest = resting_pose(timeline, settings)
    unknown = [joint for joint in prepared.puppet.driven_by if np.isnan(rest[JOINTS.index(joint)]).any()]
    if unknown:
        notes = (
            *notes,
            f"The recording has no data for {', '.join(unknown)}; parts that only these joints move stay still.",
        )
    parts_apart = None if separation is None else separation.largest
    shown = timeline.part(*part_of(timeline, settings)).positions
    return Clip(motion, shown, stretch.percentiles(1, 50, 99), parts_apart, notes)
