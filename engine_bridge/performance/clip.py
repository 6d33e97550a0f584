"""A recorded skeleton, performed by a character."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.formats import read_log
from capture.skeleton import JOINTS
from capture.timeline import Timeline, choose, resample
from engine_bridge.performance.frame_store import FrameStore
from engine_bridge.performance.performance import Performance
from engine_bridge.performance.rig import Rig
from engine_bridge.performance.settings import Settings
from puppetline.errors import SkeletonLogError, at
from solver.model.batch import BatchBinding
from solver.model.stretch import EdgeStretch
from solver.motion.limbs import bones_of
from solver.surface.contacts import PartSeparation

REST_SECONDS = 0.5
"""Length of the moment whose median pose is the performer's rest pose."""

SHORTEST_CLIP = 2
"""Frames; one alone is a pose and not an animation."""

Progress = Callable[[str, float], None]
"""Told the name of a stage and the share of it that is done."""


@dataclass(frozen=True)
class Clip:
    """A solved clip, before it is written.

    Attributes
    ----------
    rig : Rig
    timeline : Timeline
    frames : FrameStore
        (F, 4m, 3) float32: control variables, model units.
    root : (F, 3) float32
        Translation, mesh file's coordinates.
    motions : FrameStore
        (F, b, 4, 3) float32: motions of the bones for row vectors, mesh file's coordinates, without the root's. Empty
        for the forms that are not made of them.
    stretch : tuple of float
        Edge stretch over the clip: 1st, 50th and 99th percentile.
    parts_apart : float or None
        How far parts that touched at rest came apart, as a fraction of the diagonal; None for a character of one part.
    notes : tuple of str
        What the user should know about the log.
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
    """Read a log and put the chosen performer on an even clock.

    Returns
    -------
    timeline : Timeline
    notes : tuple of str
        What was assumed, dropped and held.

    Raises
    ------
    SkeletonLogError
    """
    clips = read_log(log, settings.log)
    try:
        clip, chosen = choose(clips, settings.user)
        timeline = resample(clip, settings.fps, settings.max_gap)
    except SkeletonLogError as error:  # these know clips, not files
        where = at(log, field=error.where)
        raise SkeletonLogError(where, found=error.found, expected=error.expected, fix=error.fix) from error
    if len(timeline.positions) < SHORTEST_CLIP:
        raise SkeletonLogError(
            log,
            found=f"a clip that gives a single frame at {settings.fps:g} a second",
            expected=f"at least {SHORTEST_CLIP} frames",
            fix="Take a longer recording, or raise --fps.",
        )
    if settings.rest_at > timeline.times[-1]:
        raise SkeletonLogError(
            log,
            found=f"a clip of {timeline.times[-1]:.2f} s",
            expected=f"one that reaches second {settings.rest_at:g}, where the rest pose is to be",
            fix="Choose an earlier moment with --rest-at.",
        )
    others = (chosen,) if len(clips) > 1 else ()
    return timeline, (*clip.notes, *others, *((timeline.summary(),) if timeline.held else ()))


def resting_pose(timeline: Timeline, settings: Settings) -> NDArray[np.float64]:
    """Return the performer's joints (20, 3) in the pose that stands for the character's rest pose."""
    return body.resting_pose(
        timeline.positions,
        timeline.confidence,
        first=int(settings.rest_at * timeline.fps),
        count=max(1, round(REST_SECONDS * timeline.fps)),
    )


class Solved(NamedTuple):
    """Some frames of a performance.

    Attributes
    ----------
    R : (f, 4m, 3) float32
        Control variables, model units.
    root : (f, 3) float32
        Translation, mesh file's coordinates.
    motions : (f, b, 4, 3) float32
        Of the bones for row vectors, mesh file's coordinates, without the root's.
    """

    R: NDArray[np.float32]
    root: NDArray[np.float32]
    motions: NDArray[np.float32]


def solve(rig: Rig, timeline: Timeline, settings: Settings, at_a_time: int) -> Iterator[Solved]:
    """Run the performance over a whole timeline.

    Yields
    ------
    Solved
        The next frames, at most `at_a_time`.
    """
    performance = Performance(rig.puppet, rig.mesh, rig.model, resting_pose(timeline, settings))
    count = len(timeline.positions)
    bones = len(performance.deformer.bones)
    for start in range(0, count, at_a_time):
        numbers = range(start, min(start + at_a_time, count))
        R = np.empty((len(numbers), *rig.model.rest_controls.shape), dtype=np.float32)
        root = np.empty((len(numbers), 3), dtype=np.float32)
        motions = np.empty((len(numbers), bones, 4, 3), dtype=np.float32)
        for row, number in enumerate(numbers):
            pose = performance.step(timeline.frame(number))
            R[row], root[row], motions[row] = pose.R, pose.root, pose.motions
        yield Solved(R, root, motions)


def perform(rig: Rig, timeline: Timeline, settings: Settings, notes: tuple[str, ...], progress: Progress) -> Clip:
    """Run the performance over a whole timeline, and look at what it does to the character."""
    surface, stretch = BatchBinding.of_solver_mesh(rig.model, rig.mesh), EdgeStretch(rig.mesh)
    separation = PartSeparation(rig.mesh) if rig.mesh.parts > 1 else None
    frames = FrameStore(rig.model.rest_controls.shape)
    motions = FrameStore((len(bones_of(rig.puppet.limbs)), 4, 3))
    root = np.empty((len(timeline.positions), 3), dtype=np.float32)

    def look_at(vertices: NDArray[np.float32]) -> None:
        stretch.add(vertices)
        if separation is not None:
            separation.add(vertices)

    for solved in solve(rig, timeline, settings, surface.batch_frames):
        root[len(frames) : len(frames) + len(solved.R)] = solved.root
        frames.append(solved.R)
        if settings.form == "rig":
            motions.append(solved.motions)
        look_at(surface.displacements(solved.R))  # from the middle: lengths of edges are precise anywhere
        progress("Performing", len(frames) / len(root))
    rest = resting_pose(timeline, settings)
    unknown = [joint for joint in rig.puppet.driven_by if np.isnan(rest[JOINTS.index(joint)]).any()]
    if unknown:
        notes = (*notes, f"The log never knows {', '.join(unknown)}: what only they move stays still.")
    parts_apart = None if separation is None else separation.largest
    return Clip(rig, timeline, frames, root, motions, stretch.percentiles(1, 50, 99), parts_apart, notes)
