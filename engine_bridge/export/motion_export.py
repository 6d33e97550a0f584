"""Export of a motion in each form: morph targets, one target per keyframe, or joints."""

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.document import Document
from engine_bridge.export import frames_animation, morph_basis
from engine_bridge.export.animation import ExportResult, Keyframes, animate
from engine_bridge.export.rig_export import export_rig
from engine_bridge.performance.channels import morph_weights
from engine_bridge.performance.clip import Progress
from engine_bridge.performance.motion import SolvedMotion
from engine_bridge.performance.settings import Settings


def export_motion(
    motion: SolvedMotion, name: str, settings: Settings, progress: Progress
) -> tuple[Document, ExportResult]:
    """Animate a character in the form of the settings.

    Parameters
    ----------
    motion : SolvedMotion
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
    form = settings.for_puppet(motion.prepared.puppet).form
    if form == "rig":
        no_weights = np.zeros((len(motion.R), 0), dtype=np.float32)
        return export_rig(motion, _keyframes(motion, name, no_weights), settings, progress)
    return _as_frames(motion, name, progress) if form == "frames" else _as_morph(motion, name, settings, progress)


def _keyframes(motion: SolvedMotion, name: str, weights: NDArray[np.float32]) -> Keyframes:
    root = None if motion.prepared.puppet.root is None else motion.root[:]
    own = morph_weights(motion.prepared.puppet, motion.channels)
    return Keyframes(name, motion.times.astype(np.float32), weights, root, own)


def _as_morph(motion: SolvedMotion, name: str, settings: Settings, progress: Progress) -> tuple[Document, ExportResult]:
    prepared = motion.prepared
    basis = morph_basis.fit_rig(prepared, motion.R, settings, progress)
    displacements = morph_basis.displacements(prepared.character, prepared.mesh, prepared.model, motion.R, basis)
    keyframes = _keyframes(motion, name, basis.weights)
    document = animate(prepared.character, keyframes, displacements)
    return document, ExportResult(error=basis.error / float(prepared.model.diagonal), targets=basis.unit_weights.count)


def _as_frames(motion: SolvedMotion, name: str, progress: Progress) -> tuple[Document, ExportResult]:
    prepared, count = motion.prepared, len(motion.R)
    displacements = frames_animation.displacements(prepared.character, prepared.mesh, prepared.model, motion.R)
    progress("Making keyframes", 1.0)
    keyframes = _keyframes(motion, name, np.eye(count, dtype=np.float32))  # hat functions with linear interpolation
    document = animate(prepared.character, keyframes, displacements)
    return document, ExportResult(error=0.0, targets=count)
