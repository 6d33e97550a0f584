"""Export of a motion as an animation of named joints, of the file's own skeleton or of a rig that is made."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from engine_bridge.character.document import Document
from engine_bridge.export.animation import ExportResult, Keyframes, hold_targets
from engine_bridge.export.finger_animation import bend_fingers
from engine_bridge.export.motion_thinning import thin_motion
from engine_bridge.export.own_skeleton import OwnSkeleton, own_skeleton
from engine_bridge.export.rig_animation import RigAnimation, animate_rig
from engine_bridge.performance.clip import Progress
from engine_bridge.performance.motion import SolvedMotion
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet.rig_bones import RigBones
from engine_bridge.rigging.made_rig import made_rig, with_handles
from engine_bridge.rigging.rig_document import rigged_document
from engine_bridge.rigging.skeleton import Skeleton
from engine_bridge.rigging.surface_distance import distances
from solver.skinning.weights import Weights

MAX_COMPARED_FRAMES = 400
"""Approximate maximum number of frames in which a made rig is compared with the solver's surface."""


def export_rig(
    motion: SolvedMotion, keyframes: Keyframes, settings: Settings, progress: Progress
) -> tuple[Document, ExportResult]:
    """Animate the joints of the file's own skeleton, or of a new one if that cannot move all limbs of the puppet.

    Parameters
    ----------
    motion : SolvedMotion
    keyframes : Keyframes
        Keyframes, whose weights are ignored.
    settings : Settings
    progress : callable
    """
    own = own_skeleton(motion.prepared) if settings.keep_skin else OwnSkeleton(None)
    if own.usable is not None:
        document, result = _of_own(motion, keyframes, own.usable)
    else:
        document, result = _of_made(motion, keyframes, progress)
        result = replace(result, notes=(*own.notes, *result.notes))
    if settings.max_error and document.gltf["animations"]:
        diagonal = float(motion.prepared.model.diagonal)
        count, more = thin_motion(document, settings.max_error * diagonal)
        result = replace(result, keyframes=count, error=result.error + more / diagonal)
    progress("Turning joints", 1.0)
    return document, result


def _of_own(motion: SolvedMotion, keyframes: Keyframes, bones: RigBones) -> tuple[Document, ExportResult]:
    """Animate the file's own skeleton."""
    document, moved = animate_rig(motion.prepared.character.document, keyframes, bones, motion.bones)
    if keyframes.own:
        hold_targets(document, keyframes, motion.prepared.character)
    channels = motion.channels
    if channels and document.gltf["animations"]:
        bend_fingers(document, channels)
    notes = []
    if bones.missing:
        notes.append(
            f"The skeleton has no joint for {', '.join(bones.missing)}; parts that only these limbs move stay still."
        )
    if bones.loose:
        notes.append(f"Without a joint above them, {', '.join(bones.loose)} follow the nearest bones.")
    if moved.uneven:
        notes.append(
            f"The scale above {', '.join(moved.uneven)} differs by axis, so that the rotation of these joints is "
            "approximate. Use --as morph for the exact motion."
        )
    return document, _result(motion, moved, 0.0, None, notes)


def _of_made(motion: SolvedMotion, keyframes: Keyframes, progress: Progress) -> tuple[Document, ExportResult]:
    """Rig the character, and animate the rig."""
    prepared = motion.prepared
    made = made_rig(prepared, lambda share: progress("Fitting skin weights", share))
    rigged, nodes, notes = rigged_document(prepared.character, made, prepared.mesh.of_render)
    motions = motion.bones[:]
    if prepared.puppet.handle:
        motions = with_handles(prepared, motion.R[:], motions).astype(np.float32)
    document, moved = animate_rig(rigged, keyframes, bones_of_joints(made.skeleton, nodes, motions.shape[1]), motions)
    hold_targets(document, keyframes, prepared.character)
    stride = -(-len(motions) // MAX_COMPARED_FRAMES)
    of_bones = Weights(made.weights.weights, made.skeleton.bones[made.weights.bones].astype(np.uint16))
    rms, error = distances(prepared, of_bones, prepared.mesh.vertices, motion.R[::stride], motions[::stride])
    return document, _result(motion, moved, error, rms, notes)


def _result(
    motion: SolvedMotion, moved: RigAnimation, error: float, rms: float | None, notes: Sequence[str]
) -> ExportResult:
    """Return the numbers of an animation, whose joints may be away from where their bones take them."""
    error += moved.error / float(motion.prepared.model.diagonal)
    return ExportResult(error, rms, 0, moved.animated, moved.following, len(motion.R), tuple(notes))


def bones_of_joints(skeleton: Skeleton, nodes: list[int], bones: int) -> RigBones:
    """Return the bones that the joints of a made rig follow; joints of handles and those without a parent are placed.

    Parameters
    ----------
    skeleton : Skeleton
    nodes : list of int
        Nodes of the joints.
    bones : int
        Number of bones and handles.
    """
    of_joint = skeleton.bones
    shares = np.zeros((len(nodes), bones))
    moved = of_joint >= 0
    shares[moved, of_joint[moved]] = 1
    return RigBones(np.array(nodes), skeleton.parents, shares, skeleton.travelling, (), ())
