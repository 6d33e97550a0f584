"""Conversion of a recording and a puppet to a glTF animation."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from capture.timeline import Timeline
from engine_bridge.character.document import Document
from engine_bridge.character.evaluation import Evaluation
from engine_bridge.export import frames_animation
from engine_bridge.export.motion_export import export_motion
from engine_bridge.performance.clip import Clip, Progress, load_timeline, perform
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared
from engine_bridge.performance.settings import Form, Settings
from puppetline.files import check_writable
from solver.model.stretch import EdgeStretch
from solver.surface.contacts import PartSeparation
from solver.surface.mesh import SolverMesh

MAX_MEASURED_FRAMES = 60
"""Maximum number of frames in which the surface of a file with its own skeleton is measured."""


@dataclass(frozen=True)
class Summary:
    """Result of `convert`.

    `error` and `rms` are the maximum and the root mean square distance of vertices from the solver's positions, over
    all vertices and keyframes, as fractions of the diagonal. For a rig that was made, a long clip is compared in some
    of its frames. If the file's own skeleton is animated, `error` is the maximum distance of a joint from its bone, and
    `rms` is None; `stretch_p1`, `stretch_p50`, `stretch_p99` and `parts_apart` are then measured on the surface that
    the file shows, in some of its frames.

    `keyframes` is the number of frames in the file, which is lower than `frames` if others are interpolated. `bones` is
    the number of joints with keyframes, and `following` that of joints that move with their parents.
    """

    output: str
    form: Form
    frames: int
    seconds: float
    keyframes: int
    targets: int
    bones: int
    following: int
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


def write(clip: Clip, output: Path, name: str, settings: Settings, progress: Progress) -> Summary:
    """Write a solved clip as a .glb.

    Raises
    ------
    OutputError
    """
    document, result = export_motion(clip.motion, name, settings, progress)
    document.save(output)
    of_solver = settings.form != "rig" or result.rms is not None
    (p1, p50, p99), parts_apart = (clip.stretch, clip.parts_apart) if of_solver else _measured(clip, document)
    return Summary(
        output=str(output),
        form=settings.form or "morph",
        frames=len(clip.motion),
        seconds=float(clip.motion.times[-1]),
        keyframes=len(clip.motion) if result.keyframes is None else result.keyframes,
        targets=result.targets,
        bones=result.bones,
        following=result.following,
        error=result.error,
        rms=result.rms,
        tolerance=settings.max_error,
        stretch_p1=p1,
        stretch_p50=p50,
        stretch_p99=p99,
        parts_apart=parts_apart,
        bytes=output.stat().st_size,
        repairs=tuple(clip.motion.prepared.mesh.repairs.describe()) if of_solver else (),
        notes=(*clip.motion.prepared.character.document.notes, *result.notes, *clip.notes),
    )


def _measured(clip: Clip, document: Document) -> tuple[tuple[float, ...], float | None]:
    """Return the edge stretch and the separation of parts of a clip, on the surface that a document shows."""
    mesh = clip.motion.prepared.mesh
    count = int(mesh.of_render.max()) + 1
    if count < len(mesh.vertices):  # it was refined, and the file's surface is coarse
        faces = mesh.of_render[clip.motion.prepared.character.triangles]
        distinct = np.diff(np.sort(faces, axis=1), axis=1).all(axis=1)
        mesh = SolverMesh(mesh.vertices[:count], faces[distinct], mesh.of_render)
    shown = np.empty(len(mesh.vertices), np.int64)  # a vertex of the file for each of the solver's
    shown[mesh.of_render] = np.arange(len(mesh.of_render))
    stretch, separation = EdgeStretch(mesh), PartSeparation(mesh) if mesh.parts > 1 else None
    times = clip.motion.times[:: -(-len(clip.motion) // MAX_MEASURED_FRAMES)]
    for places in Evaluation(document, clip.motion.prepared.character.parts).positions(times):
        # relative to the middle, where edge lengths are precise
        vertices = (places[shown] - clip.motion.prepared.model.center).astype(np.float32)[:, :, None]
        stretch.add(vertices)
        if separation is not None:
            separation.add(vertices)
    return stretch.percentiles(1, 50, 99), None if separation is None else separation.largest


def convert(
    log: Path, puppet: Path, output: Path, settings: Settings, progress: Progress = lambda _stage, _share: None
) -> tuple[Clip, Summary]:
    """Convert a recording and a puppet file to an animated .glb.

    Parameters
    ----------
    log, puppet, output : Path
    settings : Settings
    progress : callable, optional

    Returns
    -------
    clip : Clip
        Solved clip, for images.
    summary : Summary

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_writable(output, ".glb", inputs=(log, puppet))
    timeline, notes = load_timeline(log, settings, animals=True)
    progress("Preparing the character", 0.0)
    prepared = load_prepared(puppet)
    check_writable(output, ".glb", inputs=(Path(prepared.character.document.name),))
    progress("Preparing the character", 1.0)
    return convert_timeline(prepared, timeline, output, log.stem, settings, notes, progress)


def convert_timeline(
    prepared: PreparedCharacter,
    timeline: Timeline,
    output: Path,
    name: str,
    settings: Settings,
    notes: tuple[str, ...],
    progress: Progress = lambda _stage, _share: None,
) -> tuple[Clip, Summary]:
    """Convert a resampled recording to an animated .glb.

    Parameters
    ----------
    prepared : PreparedCharacter
    timeline : Timeline
    output : Path
    name : str
        Name of the animation.
    settings : Settings
    notes : tuple of str
        Sentences for the user about the recording.
    progress : callable, optional

    Returns
    -------
    clip : Clip
    summary : Summary

    Raises
    ------
    PuppetlineError
    """
    settings = settings.for_puppet(prepared.puppet)
    if settings.form == "frames":
        frames_animation.check_size(output, prepared.character, len(timeline.positions), settings.fps)
    clip = perform(prepared, timeline, settings, notes, progress)
    return clip, write(clip, output, name, settings, progress)


def describe(summary: Summary) -> str:
    """Return the summary of a conversion as lines of text."""
    lines = [
        f"{summary.output}: {summary.frames:,} frames, {summary.seconds:.1f} s, {summary.bytes / 1e6:.1f} MB",
        _describe_form(summary),
    ]
    if summary.keyframes < summary.frames:
        lines.append(f"  keyframes      {summary.keyframes:,}; the other frames are interpolated within the tolerance")
    stretch = (summary.stretch_p1, summary.stretch_p50, summary.stretch_p99)
    lines.append(f"  edge stretch   {' / '.join(f'{each:.3f}' for each in stretch)} (1st, 50th, 99th percentile)")
    if summary.parts_apart is not None:
        lines.append(f"  parts apart    at most {summary.parts_apart:.2g} of the diagonal")
    if summary.repairs:
        lines.append(f"  solver's copy  {'; '.join(summary.repairs)}")
    lines += [f"  note: {note}" for note in summary.notes]
    return "\n".join(lines)


def _describe_form(summary: Summary) -> str:
    """Return what the animation consists of, and its error."""
    if summary.form == "frames" and not summary.error:
        return f"  morph targets  {summary.targets}, one for each keyframe, exactly as solved"
    if summary.form == "rig" and summary.rms is None:
        return (
            f"  joints         {summary.bones} animated, {summary.following} follow, of the file's own skeleton; "
            f"at most {summary.error:.2g} of the diagonal from where their bones take them"
        )
    if summary.form == "rig":
        return (
            f"  joints         {summary.bones} animated, {summary.following} follow, of a new skeleton; largest error "
            f"{summary.error:.2g} of the diagonal, root mean square {summary.rms:.2g}\n"
            "                 --as morph is closer to the solved surface, in a larger file without a skeleton"
        )
    over = "" if summary.error <= summary.tolerance else ": the closest with this number of targets"
    return (
        f"  morph targets  {summary.targets}, largest error {summary.error:.2g} of the diagonal "
        f"(tolerance {summary.tolerance:g}){over}"
    )
