"""A recorded skeleton and a puppet become a glTF animation."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
from numpy.typing import NDArray

from capture import body
from capture.formats import read_log
from capture.formats.options import ReadOptions
from capture.skeleton import JOINTS, SkeletonFrame
from capture.timeline import Timeline, choose, resample
from engine_bridge import puppet as puppet_file
from engine_bridge.files import check_writable
from engine_bridge.gltf import morph_basis
from engine_bridge.gltf.animation import Take, animate
from engine_bridge.gltf.character import Character, load_character
from engine_bridge.gltf.morph_basis import MorphBasis
from engine_bridge.performance import Performance, check_handles
from engine_bridge.puppet import Puppet
from puppetline.errors import PuppetError, SkeletonLogError, at
from solver.binding import Binding
from solver.deformer import to_file_units
from solver.mesh import SolverMesh
from solver.parts import PartSeparation
from solver.reduced_model import ReducedModel, load_or_build
from solver.stretch import EdgeStretch

REST_SECONDS = 0.5
"""Length of the moment whose median pose is the performer's rest pose."""

SHORTEST_CLIP = 2
"""Frames; one alone is a pose and not an animation."""

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
    tolerance : float
        Largest error of the animation against the solver, as a fraction of the diagonal.
    targets : int or None
        A limit to the number of morph targets.
    log : ReadOptions
        What the log does not say itself.
    """

    user: int | None = None
    fps: float = 30.0
    max_gap: float = 0.4
    rest_at: float = 0.0
    tolerance: float = 0.0005
    targets: int | None = None
    log: ReadOptions = field(default_factory=ReadOptions)


@dataclass(frozen=True)
class Rig:
    """A puppet with all that is pre-computed for its character."""

    puppet: Puppet
    character: Character
    mesh: SolverMesh
    model: ReducedModel


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
    """What `convert` has to say about its result."""

    output: str
    frames: int
    seconds: float
    targets: int
    error: float
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


def cache_folder() -> Path:
    """Return where reduced models are kept between runs."""
    return platformdirs.user_cache_path("puppetline") / "models"


def load_rig(path: Path) -> Rig:
    """Load a puppet file and prepare its character, from the cache where that was done before.

    Raises
    ------
    PuppetlineError
    """
    puppet = puppet_file.load(path)
    file = path.parent / puppet.character.mesh
    if not file.is_file():
        raise PuppetError(
            at(path, field="[character], mesh"),
            found=f"{puppet.character.mesh!r}, and there is no file {file}",
            expected="a mesh file, its path relative to the puppet file",
            fix="Correct the path, or put the mesh there.",
        )
    rig = make_rig(puppet, load_character(file))
    check_handles(puppet.handle, rig.mesh, path)
    return rig


def make_rig(puppet: Puppet, character: Character) -> Rig:
    """Prepare a character for a puppet."""
    mesh = character.solver_mesh()
    model, _ = load_or_build(mesh, puppet.solver.parameters, cache_folder())
    return Rig(puppet, character, mesh, model)


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
    rig = clip.rig
    basis = morph_basis.fit(
        rig.model,
        Binding.of_solver_mesh(rig.model, rig.mesh),
        clip.frames,
        tolerance=settings.tolerance,
        most=settings.targets,
        progress=lambda share: progress("Fitting morph targets", share),
    )
    take = Take(
        name=name,
        times=clip.timeline.times.astype(np.float32),
        weights=basis.weights,
        root=None if rig.puppet.root is None else clip.root,
    )
    document = animate(rig.character, take, lambda part: _displacements(clip, basis, part))
    document.save(output)
    p1, p50, p99 = clip.stretch
    return Summary(
        output=str(output),
        frames=len(clip.frames),
        seconds=float(clip.timeline.times[-1]),
        targets=len(basis.directions),
        error=basis.error / float(rig.model.diagonal),
        tolerance=settings.tolerance,
        stretch_p1=p1,
        stretch_p50=p50,
        stretch_p99=p99,
        parts_apart=clip.parts_apart,
        bytes=output.stat().st_size,
        repairs=tuple(rig.mesh.repairs.describe()),
        notes=(*rig.character.document.notes, *clip.notes),
    )


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
    timeline, notes = load_timeline(log, settings)
    progress("Preparing the character", 0.0)
    rig = load_rig(puppet)
    check_writable(output, ".glb", inputs=(Path(rig.character.document.name),))
    progress("Preparing the character", 1.0)
    clip = perform(rig, timeline, settings, notes, progress)
    return clip, write(clip, output, log.stem, settings, progress)
