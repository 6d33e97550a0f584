"""A recorded skeleton and a puppet become a glTF animation."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.formats import read_log
from capture.formats.options import ReadOptions
from capture.skeleton import JOINTS, SkeletonFrame
from capture.timeline import Timeline, choose, resample
from engine_bridge import skinning
from engine_bridge.files import check_writable
from engine_bridge.gltf import frames_animation, morph_basis
from engine_bridge.gltf.animation import Take, animate
from engine_bridge.gltf.document import Document
from engine_bridge.gltf.morph_basis import MorphBasis
from engine_bridge.gltf.skin_animation import animate_skin
from engine_bridge.performance import Performance
from engine_bridge.puppet import Puppet
from engine_bridge.rig import Rig, load_rig
from puppetline.errors import SkeletonLogError, at
from solver.binding import Binding
from solver.deformer import to_file_units
from solver.parts import PartSeparation
from solver.stretch import EdgeStretch

REST_SECONDS = 0.5
"""Length of the moment whose median pose is the performer's rest pose."""

SHORTEST_CLIP = 2
"""Frames; one alone is a pose and not an animation."""

Form = Literal["morph", "skin", "frames"]

TOLERANCE: dict[Form, float] = {"morph": 0.0005, "skin": 0.002, "frames": 0.0}
"""Largest error as a fraction of the diagonal where the user does not say: a few rigid bones follow less closely."""

Progress = Callable[[str, float], None]
"""Told the name of a stage and the share of it that is done."""


@dataclass(frozen=True)
class Settings:
    """What a user may choose for one conversion.

    Attributes
    ----------
    user : int or None
        The performer; None for the longest tracked.
    fps : float
        Keyframes a second.
    max_gap : float
        Seconds without a joint that are bridged; over longer gaps it is held.
    rest_at : float
        Second of the log at which the performer stands as the character does at rest.
    form : {"morph", "skin", "frames"}
        What the animation is made of: a few morph targets, bones, or a morph target for each keyframe.
    tolerance : float or None
        Largest error of the animation against the solver, as a fraction of the diagonal; None for that of `TOLERANCE`.
    targets : int or None
        A limit to the number of morph targets.
    bones : int or None
        The number of bones.
    log : ReadOptions
        What the log does not say itself.
    """

    user: int | None = None
    fps: float = 30.0
    max_gap: float = 0.4
    rest_at: float = 0.0
    form: Form = "morph"
    tolerance: float | None = None
    targets: int | None = None
    bones: int | None = None
    log: ReadOptions = field(default_factory=ReadOptions)

    @property
    def allowed(self) -> float:
        """The tolerance that holds."""
        return TOLERANCE[self.form] if self.tolerance is None else self.tolerance


@dataclass(frozen=True)
class Clip:
    """A solved clip, before it is written.

    Attributes
    ----------
    rig : Rig
    timeline : Timeline
    frames : (F, 4m, 3) float32
        Control variables, model units.
    root : (F, 3) float32
        Translation, mesh file's coordinates.
    stretch : tuple of float
        Edge stretch over the clip: 1st, 50th and 99th percentile.
    parts_apart : float or None
        How far parts that touched at rest came apart, as a fraction of the diagonal; None for a character of one part.
    notes : tuple of str
        What the user should know about the log.
    """

    rig: Rig
    timeline: Timeline
    frames: NDArray[np.float32]
    root: NDArray[np.float32]
    stretch: tuple[float, ...]
    parts_apart: float | None
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Summary:
    """What `convert` has to say about its result.

    `error` and `rms` are distances of vertices from where the solver puts them, over all vertices and keyframes, as
    fractions of the diagonal.
    """

    output: str
    form: Form
    frames: int
    seconds: float
    targets: int
    bones: int
    error: float
    rms: float | None
    tolerance: float
    stretch_p1: float
    stretch_p50: float
    stretch_p99: float
    parts_apart: float | None
    bytes: int
    repairs: tuple[str, ...]
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values for JSON."""
        return asdict(self)


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


def perform(rig: Rig, timeline: Timeline, settings: Settings, notes: tuple[str, ...], progress: Progress) -> Clip:
    """Run the performance over a whole timeline."""
    rest = body.resting_pose(
        timeline.positions,
        timeline.confidence,
        first=int(settings.rest_at * timeline.fps),
        count=max(1, round(REST_SECONDS * timeline.fps)),
    )
    performance = Performance(rig.puppet, rig.mesh, rig.model, rest)
    binding = Binding.of_solver_mesh(rig.model, rig.mesh)
    stretch, separation = EdgeStretch(rig.mesh), PartSeparation(rig.mesh)
    count = len(timeline.positions)
    frames = np.empty((count, *rig.model.rest_controls.shape), dtype=np.float32)
    root = np.empty((count, 3), dtype=np.float32)
    for index, time in enumerate(timeline.times):
        frame = SkeletonFrame(time, 0, timeline.positions[index], timeline.confidence[index])
        pose = performance.step(frame)
        frames[index], root[index] = pose.R, pose.root
        vertices = binding.vertices(to_file_units(pose.R, rig.model))
        stretch.add(vertices)
        separation.add(vertices)
        progress("Performing", (index + 1) / count)
    unknown = [joint for joint in _joints_used(rig.puppet) if np.isnan(rest[JOINTS.index(joint)]).any()]
    if unknown:
        notes = (*notes, f"The log never knows {', '.join(unknown)}: what only they move stays still.")
    parts_apart = separation.worst if rig.mesh.parts > 1 else None
    return Clip(rig, timeline, frames, root, stretch.percentiles(1, 50, 99), parts_apart, notes)


def _joints_used(puppet: Puppet) -> list[str]:
    used = {joint for handle in puppet.handle for joint in handle.driven_by}
    if puppet.root is not None:
        used.add(puppet.root.joint)
    return [joint for joint in JOINTS if joint in used]


def write(clip: Clip, output: Path, name: str, settings: Settings, progress: Progress) -> Summary:
    """Write a solved clip as a .glb.

    Raises
    ------
    OutputError
    """
    document, made = _FORMS[settings.form](clip, name, settings, progress)
    document.save(output)
    p1, p50, p99 = clip.stretch
    return Summary(
        output=str(output),
        form=settings.form,
        frames=len(clip.frames),
        seconds=float(clip.timeline.times[-1]),
        targets=made.targets,
        bones=made.bones,
        error=made.error,
        rms=made.rms,
        tolerance=settings.allowed,
        stretch_p1=p1,
        stretch_p50=p50,
        stretch_p99=p99,
        parts_apart=clip.parts_apart,
        bytes=output.stat().st_size,
        repairs=tuple(clip.rig.mesh.repairs.describe()),
        notes=(*clip.rig.character.document.notes, *made.notes, *clip.notes),
    )


@dataclass(frozen=True)
class _Made:
    """What became of a clip: see `Summary`."""

    error: float
    rms: float | None = None
    targets: int = 0
    bones: int = 0
    notes: tuple[str, ...] = ()


def _take(clip: Clip, name: str, weights: NDArray[np.float32]) -> Take:
    root = None if clip.rig.puppet.root is None else clip.root
    return Take(name, clip.timeline.times.astype(np.float32), weights, root)


def _as_morph(clip: Clip, name: str, settings: Settings, progress: Progress) -> tuple[Document, _Made]:
    rig = clip.rig
    basis = morph_basis.fit(
        rig.model,
        Binding.of_solver_mesh(rig.model, rig.mesh),
        clip.frames,
        tolerance=settings.allowed,
        most=settings.targets,
        progress=lambda share: progress("Fitting morph targets", share),
    )
    document = animate(rig.character, _take(clip, name, basis.weights), lambda part: _displacements(clip, basis, part))
    return document, _Made(error=basis.error / float(rig.model.diagonal), targets=len(basis.directions))


def _as_skin(clip: Clip, name: str, settings: Settings, progress: Progress) -> tuple[Document, _Made]:
    rig, diagonal = clip.rig, float(clip.rig.model.diagonal)
    skin = skinning.fit(
        rig.model,
        rig.mesh,
        clip.frames,
        tolerance=settings.allowed,
        bones=settings.bones,
        progress=lambda share: progress("Fitting bones", share),
    )
    no_weights = np.zeros((len(clip.frames), 0), dtype=np.float32)
    document, notes = animate_skin(rig.character, _take(clip, name, no_weights), skin, rig.mesh.of_render)
    return document, _Made(skin.error / diagonal, skin.rms / diagonal, bones=len(skin.joints), notes=notes)


def _as_frames(clip: Clip, name: str, _settings: Settings, progress: Progress) -> tuple[Document, _Made]:
    rig, count = clip.rig, len(clip.frames)
    made = frames_animation.displacements(rig.character, rig.mesh, rig.model, clip.frames)
    progress("Making keyframes", 1.0)
    document = animate(rig.character, _take(clip, name, frames_animation.weights(count)), made.__getitem__)
    return document, _Made(error=0.0, targets=count)


_FORMS: dict[Form, Callable[[Clip, str, Settings, Progress], tuple[Document, _Made]]] = {
    "morph": _as_morph,
    "skin": _as_skin,
    "frames": _as_frames,
}


def _displacements(
    clip: Clip, basis: MorphBasis, number: int
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Return one part's position and normal displacements."""
    rig = clip.rig
    start = sum(len(part.vertices) for part in rig.character.parts[:number])
    part = rig.character.parts[number]
    follows = rig.mesh.of_render[start : start + len(part.vertices)]
    positions = basis.targets(rig.model, Binding(rig.model, part.vertices, follows))
    if part.normals is None:
        return positions, None
    return positions, morph_basis.normal_targets(rig.model, rig.mesh, follows, part.normals, clip.frames, basis.weights)


def convert(
    log: Path, puppet: Path, output: Path, settings: Settings, progress: Progress = lambda _stage, _share: None
) -> tuple[Clip, Summary]:
    """Turn a skeleton log and a puppet file into an animated .glb.

    Parameters
    ----------
    log, puppet, output : Path
    settings : Settings
    progress : callable, optional

    Returns
    -------
    clip : Clip
        For pictures.
    summary : Summary

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_writable(output, ".glb", inputs=(log, puppet))
    if settings.form == "skin":
        skinning.require_dem_bones()
    timeline, notes = load_timeline(log, settings)
    progress("Preparing the character", 0.0)
    rig = load_rig(puppet)
    if settings.form == "frames":
        frames_animation.check_size(output, rig.character, len(timeline.positions), settings.fps)
    check_writable(output, ".glb", inputs=(Path(rig.character.document.name),))
    progress("Preparing the character", 1.0)
    clip = perform(rig, timeline, settings, notes, progress)
    return clip, write(clip, output, log.stem, settings, progress)
