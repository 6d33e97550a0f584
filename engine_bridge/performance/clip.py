"""Solves recorded skeletons for a character."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.clip import SkeletonClip
from capture.formats import read_log
from capture.skeleton import JOINTS, LOST
from capture.timeline import Timeline, choose, resample
from engine_bridge.performance.calibration import TakeCalibration, of_performer
from engine_bridge.performance.channels import sided, with_voice
from engine_bridge.performance.easing import TargetPose
from engine_bridge.performance.frame_store import FrameStore
from engine_bridge.performance.performance import Performance, Pose, mirrored
from engine_bridge.performance.rig import Rig
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet.puppet import Puppet
from puppetline.errors import SkeletonLogError, at
from solver.model.batch import BatchBinding
from solver.model.stretch import EdgeStretch
from solver.motion.limbs import bones_of
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
    rig : Rig
    timeline : Timeline
        Its channels are those of the character, see `channels_of`.
    frames : FrameStore
        (F, 4m, 3) float32: control variables, model units.
    root : (F, 3) float32
        Translation, mesh file's coordinates.
    motions : FrameStore
        (F, b, 4, 3) float32: motions of the bones for row vectors, mesh file's coordinates, without the root's. Empty
        unless the file's own skeleton is animated.
    stretch : tuple of float
        Edge stretch over the clip: 1st, 50th and 99th percentile. In a long clip, only every second or third frame is
        measured.
    parts_apart : float or None
        Maximum separation of parts that touch at rest, as a fraction of the diagonal; None for a character of one part.
    notes : tuple of str
        Sentences for the user about the recording.
    """

    rig: Rig
    timeline: Timeline
    frames: FrameStore
    root: NDArray[np.float32]
    motions: FrameStore
    stretch: tuple[float, ...]
    parts_apart: float | None
    notes: tuple[str, ...]


def load_timeline(log: Path, settings: Settings) -> tuple[Timeline, tuple[str, ...]]:
    """Read a recording and resample the chosen performer to an even frame rate.

    Returns
    -------
    timeline : Timeline
    notes : tuple of str
        Sentences about assumptions, skipped data and held joints.

    Raises
    ------
    SkeletonLogError
    """
    return timeline_of(read_log(log, settings.log), log, settings)


def timeline_of(clips: list[SkeletonClip], log: Path, settings: Settings) -> tuple[Timeline, tuple[str, ...]]:
    """Resample the chosen performer of a recording that has been read; see `load_timeline`."""
    try:
        clip, chosen = choose(clips, settings.user)
        found, about_rest = ((), ()) if settings.rest_at is not None else of_performer(clips, clip)
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
    calibrated = settings.rest_at is not None or timeline.rest is not None
    turns = any(limb.follow == "turn" for limb in puppet.limbs)
    return body.upright(pose) if turns and not calibrated else pose


def performance_of(rig: Rig, timeline: Timeline, settings: Settings) -> Performance:
    """Return the performance of a timeline before its first frame, mirrored as the take was."""
    mirror = timeline.mirror if isinstance(timeline, TakeTimeline) else None
    rest = reference_pose(rig.puppet, timeline, settings)
    return Performance(mirrored(rig.puppet, mirror), rig.mesh, rig.model, rest)


def channels_of(rig: Rig, timeline: Timeline) -> dict[str, NDArray[np.float32]]:
    """Return the channels (T,) of a timeline as the character has them, mirrored while the take mirrors."""
    channels, mirror = timeline.channels or {}, rig.puppet.retarget.mirror
    if not isinstance(timeline, TakeTimeline):
        return dict(sided(channels, mirror) or {})
    first = mirror if timeline.mirror is None else timeline.mirror
    mirrors = np.full(len(timeline.positions), first)
    for number, (_, later) in sorted(timeline.later.items()):
        mirrors[max(number, 0) :] = mirrors[number - 1] if later is None else later
    other, still = sided(channels, True) or {}, np.zeros(len(mirrors), np.float32)
    names = [*channels, *(name for name in other if name not in channels)]
    return {name: np.where(mirrors, other.get(name, still), channels.get(name, still)) for name in names}


def aim_at(performance: Performance, timeline: Timeline, number: int) -> TargetPose:
    """Return what the performance of a timeline aims at in its next frame, with the take's calibrations."""
    if isinstance(timeline, TakeTimeline) and number in timeline.later:
        performance.calibrate(number / timeline.fps, *timeline.later[number])
    return performance.aim(timeline.frame(number))


def solve(rig: Rig, timeline: Timeline, settings: Settings, chunk_size: int) -> Iterator[Pose]:
    """Solve all frames of a timeline.

    Yields
    ------
    Pose
        The next frames, at most `chunk_size`.
    """
    performance = performance_of(rig, timeline, settings)
    count = len(timeline.positions)
    bones = len(performance.deformer.bones)
    for start in range(0, count, chunk_size):
        numbers = range(start, min(start + chunk_size, count))
        R = np.empty((len(numbers), *rig.model.rest_controls.shape), dtype=np.float32)
        root = np.empty((len(numbers), 3), dtype=np.float32)
        motions = np.empty((len(numbers), bones, 4, 3), dtype=np.float32)
        for row, number in enumerate(numbers):
            aim = aim_at(performance, timeline, number)
            R[row], root[row], motions[row] = (
                performance.deformer.solve(aim.targets, aim.motions),
                aim.root,
                aim.motions,
            )
        yield Pose(R, root, motions)


def part_of(timeline: Timeline, settings: Settings) -> tuple[int, int]:
    """Return the number of the first frame to animate, and that of the frame after the last one."""
    last = len(timeline.positions) - 1
    if settings.stop is not None:
        last = min(round(settings.stop * timeline.fps), last)
    return min(round(settings.start * timeline.fps), last - MIN_CLIP_FRAMES + 1), last + 1


def _between(first: int, end: int, chunks: Iterator[Pose]) -> Iterator[Pose]:
    """Yield the frames from number `first` to the one before `end`."""
    number = 0
    for chunk in chunks:
        inside = slice(max(first - number, 0), end - number)
        number += len(chunk.R)
        if number > first:
            yield Pose(*(each[inside] for each in chunk))
        if number >= end:
            return


def perform(rig: Rig, timeline: Timeline, settings: Settings, notes: tuple[str, ...], progress: Progress) -> Clip:
    """Solve all frames of a timeline, and measure the deformation of the character."""
    surface, stretch = BatchBinding.of_solver_mesh(rig.model, rig.mesh), EdgeStretch(rig.mesh)
    separation = PartSeparation(rig.mesh) if rig.mesh.parts > 1 else None
    frames = FrameStore(rig.model.rest_controls.shape)
    motions = FrameStore((len(bones_of(rig.puppet.limbs)), 4, 3))
    first, end = part_of(timeline, settings)
    root = np.empty((end - first, 3), dtype=np.float32)

    def measure(vertices: NDArray[np.float32]) -> None:
        stretch.add(vertices)
        if separation is not None:
            separation.add(vertices)

    # percentiles of motion do not need every frame of a long clip; the largest separation does
    stride = 1 if separation else min(MAX_MEASURED_STRIDE, max(1, len(root) // MIN_MEASURED_FRAMES))
    for solved in _between(first, end, solve(rig, timeline, settings, stride * surface.batch_frames)):
        root[len(frames) : len(frames) + len(solved.R)] = solved.root
        frames.append(solved.R)
        if settings.form == "rig":
            motions.append(solved.motions)
        measure(surface.displacements(solved.R[::stride]))  # relative to the middle, where edge lengths are precise
        progress("Performing", len(frames) / len(root))
    mirror = timeline.mirror if isinstance(timeline, TakeTimeline) else None
    if mirror not in (None, rig.puppet.retarget.mirror):
        notes = (
            *notes,
            f"The take {'mirrors' if mirror else 'does not mirror'} the performer, unlike the puppet file.",
        )
    rest = resting_pose(timeline, settings)
    unknown = [joint for joint in rig.puppet.driven_by if np.isnan(rest[JOINTS.index(joint)]).any()]
    if unknown:
        notes = (
            *notes,
            f"The recording has no data for {', '.join(unknown)}; parts that only these joints move stay still.",
        )
    parts_apart = None if separation is None else separation.largest
    timeline = replace(timeline, channels=channels_of(rig, timeline))
    return Clip(
        rig, timeline.part(first, end), frames, root, motions, stretch.percentiles(1, 50, 99), parts_apart, notes
    )
