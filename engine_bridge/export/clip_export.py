"""Export of a clip in each form: morph targets, one target per keyframe, or joints."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character import meshopt
from engine_bridge.character.document import Document
from engine_bridge.export import frames_animation, morph_basis, quantized_targets
from engine_bridge.export.animation import Displacements, FloatTargets, Keyframes, animate
from engine_bridge.export.compact_document import animate_compact
from engine_bridge.export.rig_export import export_rig
from engine_bridge.performance.channels import morph_weights
from engine_bridge.performance.clip import Clip, Progress
from engine_bridge.performance.settings import Form, Settings
from solver.model.batch import BatchBinding

TARGETS_SHARE = 0.8
"""Share of the tolerance for the number of morph targets; quantisation may use the rest."""

FRAMES_THINNING_SHARE = 0.6
"""Share of the tolerance for omitted keyframes in the form "frames", where each saves a whole target."""


@dataclass(frozen=True)
class ExportResult:
    """Numbers about an exported clip, see `engine_bridge.export.convert.Summary`."""

    error: float
    rms: float | None = None
    targets: int = 0
    bones: int = 0
    following: int = 0
    keyframes: int | None = None
    notes: tuple[str, ...] = ()


def export_clip(clip: Clip, name: str, settings: Settings, progress: Progress) -> tuple[Document, ExportResult]:
    """Animate a character in the form of the settings.

    Parameters
    ----------
    clip : Clip
    name : str
        Name of the animation.
    settings : Settings
    progress : callable

    Returns
    -------
    document : Document
        Animated document.
    result : ExportResult
    """
    document, result = _EXPORTERS[settings.for_puppet(clip.rig.puppet).form or "morph"](clip, name, settings, progress)
    if settings.meshopt:
        meshopt.compress(document)
    return document, result


def _keyframes(clip: Clip, name: str, weights: NDArray[np.float32]) -> Keyframes:
    root = None if clip.rig.puppet.root is None else clip.root
    own = morph_weights(clip.rig.puppet, clip.timeline.channels)
    return Keyframes(name, clip.timeline.times.astype(np.float32), weights, root, own)


def _as_morph(clip: Clip, name: str, settings: Settings, progress: Progress) -> tuple[Document, ExportResult]:
    rig = clip.rig
    basis = morph_basis.fit(
        rig.model,
        BatchBinding.of_solver_mesh(rig.model, rig.mesh),
        clip.frames,
        tolerance=settings.max_error * (TARGETS_SHARE if settings.compact else 1),
        max_targets=settings.targets,
        progress=lambda share: progress("Fitting morph targets", share),
    )
    displacements = morph_basis.displacements(rig.character, rig.mesh, rig.model, clip.frames, basis)
    keyframes = _keyframes(clip, name, basis.weights)
    if settings.compact:
        opposite = basis.unit_weights.opposite
        return _compact(clip, keyframes, displacements, settings, progress, basis.error, opposite=opposite)
    document = animate(rig.character, keyframes, FloatTargets(rig.character, displacements))
    return document, ExportResult(error=basis.error / float(rig.model.diagonal), targets=basis.unit_weights.count)


def _compact(
    clip: Clip,
    keyframes: Keyframes,
    displacements: Displacements,
    settings: Settings,
    progress: Progress,
    error: float,
    **options: Any,
) -> tuple[Document, ExportResult]:
    """Quantise targets that have an error of their own, in mesh units; options are those of `quantized_targets.fit`."""
    rig, diagonal = clip.rig, float(clip.rig.model.diagonal)
    places = rig.character.vertex_slices
    bindings = [
        BatchBinding(rig.model, part.vertices, rig.mesh.of_render[place])
        for part, place in zip(rig.character.parts, places, strict=True)
    ]

    def solved(part: int, frames: NDArray[np.int64]) -> NDArray[np.float32]:
        return bindings[part].displacements(clip.frames[frames] - rig.model.rest_controls)

    progress("Rounding morph targets", 0.0)
    tolerance = max(settings.max_error * diagonal, error / TARGETS_SHARE)
    targets = quantized_targets.fit(rig.character, keyframes, displacements, solved, tolerance, **options)
    document = animate_compact(rig.character, targets, for_meshopt=settings.meshopt)
    progress("Rounding morph targets", 1.0)
    return document, ExportResult(
        error=targets.error / diagonal,
        targets=targets.keyframes.weights.shape[1],
        keyframes=len(targets.keyframes.times),
    )


def _as_frames(clip: Clip, name: str, settings: Settings, progress: Progress) -> tuple[Document, ExportResult]:
    rig, count = clip.rig, len(clip.frames)
    displacements = frames_animation.displacements(rig.character, rig.mesh, rig.model, clip.frames)
    progress("Making keyframes", 1.0)
    keyframes = _keyframes(clip, name, np.eye(count, dtype=np.float32))  # hat functions with linear interpolation
    if settings.compact:
        return _compact(clip, keyframes, displacements, settings, progress, 0.0, thinning=FRAMES_THINNING_SHARE)
    document = animate(rig.character, keyframes, FloatTargets(rig.character, displacements))
    return document, ExportResult(error=0.0, targets=count)


def _as_rig(clip: Clip, name: str, settings: Settings, progress: Progress) -> tuple[Document, ExportResult]:
    no_weights = np.zeros((len(clip.frames), 0), dtype=np.float32)
    exported = export_rig(clip, _keyframes(clip, name, no_weights), settings, progress)
    diagonal = float(clip.rig.model.diagonal)
    return exported.document, ExportResult(
        exported.error / diagonal,
        None if exported.rms is None else exported.rms / diagonal,
        bones=exported.joints.animated,
        following=exported.joints.following,
        keyframes=exported.keyframes,
        notes=exported.notes,
    )


_EXPORTERS: dict[Form, Callable[[Clip, str, Settings, Progress], tuple[Document, ExportResult]]] = {
    "morph": _as_morph,
    "frames": _as_frames,
    "rig": _as_rig,
}
