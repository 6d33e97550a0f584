"""Conversion of a recording and a puppet to a glTF animation."""

from dataclasses import dataclass
from pathlib import Path

from engine_bridge.character.meshopt_codec import require_meshoptimizer
from engine_bridge.export import frames_animation, skinning
from engine_bridge.export.clip_export import export_clip
from engine_bridge.performance.clip import Clip, Progress, load_timeline, perform
from engine_bridge.performance.rig import load_rig
from engine_bridge.performance.settings import Form, Settings
from engine_bridge.puppet.rig_bones import require_joints
from puppetline.files import check_writable


@dataclass(frozen=True)
class Summary:
    """Result of `convert`.

    `error` and `rms` are the maximum and the root mean square distance of vertices from the solver's positions, over
    all vertices and keyframes, as fractions of the diagonal. If the file's own skeleton is animated, `error` is the
    maximum distance of a joint from its bone, and `rms`, `stretch_p1`, `stretch_p50`, `stretch_p99` and `parts_apart`,
    which describe the surface, are None.

    `keyframes` is the number of frames in the file, which is lower than `frames` if others are interpolated. `bones` is
    the number of bones of a skin, or of joints with keyframes; `following` joints move with their parents.
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
    stretch_p1: float | None
    stretch_p50: float | None
    stretch_p99: float | None
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
    document, result = export_clip(clip, name, settings, progress)
    document.save(output)
    of_solver = settings.form != "rig"
    p1, p50, p99 = clip.stretch if of_solver else (None, None, None)
    return Summary(
        output=str(output),
        form=settings.form,
        frames=len(clip.frames),
        seconds=float(clip.timeline.times[-1]),
        keyframes=len(clip.frames) if result.keyframes is None else result.keyframes,
        targets=result.targets,
        bones=result.bones,
        following=result.following,
        error=result.error,
        rms=result.rms,
        tolerance=settings.max_error,
        stretch_p1=p1,
        stretch_p50=p50,
        stretch_p99=p99,
        parts_apart=clip.parts_apart if of_solver else None,
        bytes=output.stat().st_size,
        repairs=tuple(clip.rig.mesh.repairs.describe()) if of_solver else (),
        notes=(*clip.rig.character.document.notes, *result.notes, *clip.notes),
    )


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
        Solved clip, for pictures.
    summary : Summary

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_writable(output, ".glb", inputs=(log, puppet))
    if settings.form == "skin":
        skinning.require_dem_bones()
    if settings.meshopt:
        require_meshoptimizer()
    timeline, notes = load_timeline(log, settings)
    progress("Preparing the character", 0.0)
    rig = load_rig(puppet)
    if settings.form == "rig":
        require_joints(rig.character, rig.puppet.limbs, puppet)
    if settings.form == "frames":
        frames_animation.check_size(output, rig.character, len(timeline.positions), settings.fps)
    check_writable(output, ".glb", inputs=(Path(rig.character.document.name),))
    progress("Preparing the character", 1.0)
    clip = perform(rig, timeline, settings, notes, progress)
    return clip, write(clip, output, log.stem, settings, progress)
