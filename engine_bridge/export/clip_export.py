"""Export of a clip in each form: morph targets, one target per keyframe, or joints."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.document import Document
from engine_bridge.export import frames_animation, morph_basis
from engine_bridge.export.animation import ExportResult, Keyframes, animate
from engine_bridge.export.rig_export import export_rig
from engine_bridge.performance.channels import morph_weights
from engine_bridge.performance.clip import Clip, Progress
from engine_bridge.performance.settings import Settings


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
    form = settings.for_puppet(clip.rig.puppet).form
    if form == "rig":
        no_weights = np.zeros((len(clip.frames), 0), dtype=np.float32)
        return export_rig(clip, _keyframes(clip, name, no_weights), settings, progress)
    return _as_frames(clip, name, progress) if form == "frames" else _as_morph(clip, name, settings, progress)


def _keyframes(clip: Clip, name: str, weights: NDArray[np.float32]) -> Keyframes:
    root = None if clip.rig.puppet.root is None else clip.root
    own = morph_weights(clip.rig.puppet, clip.timeline.channels)
    return Keyframes(name, clip.timeline.times.astype(np.float32), weights, root, own)


def _as_morph(clip: Clip, name: str, settings: Settings, progress: Progress) -> tuple[Document, ExportResult]:
    rig = clip.rig
    basis = morph_basis.fit_rig(rig, clip.frames, settings, progress)
    displacements = morph_basis.displacements(rig.character, rig.mesh, rig.model, clip.frames, basis)
    keyframes = _keyframes(clip, name, basis.weights)
    document = animate(rig.character, keyframes, displacements)
    return document, ExportResult(error=basis.error / float(rig.model.diagonal), targets=basis.unit_weights.count)


def _as_frames(clip: Clip, name: str, progress: Progress) -> tuple[Document, ExportResult]:
    rig, count = clip.rig, len(clip.frames)
    displacements = frames_animation.displacements(rig.character, rig.mesh, rig.model, clip.frames)
    progress("Making keyframes", 1.0)
    keyframes = _keyframes(clip, name, np.eye(count, dtype=np.float32))  # hat functions with linear interpolation
    document = animate(rig.character, keyframes, displacements)
    return document, ExportResult(error=0.0, targets=count)
