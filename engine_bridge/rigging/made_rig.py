"""A rig for a puppet's character: a skeleton, and weights fitted to the surface of its reduced model."""

from collections.abc import Callable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from engine_bridge.performance.exercise import random_poses
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.rigging.joint_weights import joint_weights
from engine_bridge.rigging.skeleton import Skeleton
from engine_bridge.rigging.surface_distance import distances
from engine_bridge.rigging.t_pose import BindPose, posed, t_pose
from solver.motion.handle_motion import HandleMotions
from solver.motion.limbs import parents_first
from solver.skinning import weights as skin_weights
from solver.skinning.symmetry import mirror_images, symmetric
from solver.skinning.weights import Weights

POSES = 160
"""Number of random poses to which weights are fitted."""

COMPARED_STRIDE = 8
"""Interval of the poses in which the fitted weights are compared with the surface."""

MIN_SYMMETRIC_SHARE = 0.9
"""Smallest share of vertices with a mirror image with which the weights are made symmetric."""


@dataclass(frozen=True, eq=False)
class MadeRig:
    """A skeleton and skin weights.

    Attributes
    ----------
    skeleton : Skeleton
        In the bind pose: axes along the bones, mesh file's coordinates.
    weights : Weights
        Weights of the joints, for the solver's vertices.
    bind : BindPose or None
        Pose in which the mesh is bound to the joints; None for the rest pose.
    rms, error : float
        Root mean square and maximum distance of vertices from the reduced model's surface in the random poses, as
        fractions of the diagonal.
    """

    skeleton: Skeleton
    weights: Weights
    bind: BindPose | None
    rms: float
    error: float


_MADE: WeakKeyDictionary[PreparedCharacter, MadeRig] = WeakKeyDictionary()
"""Rigs that were made, for the next clips of the same characters."""


def made_rig(prepared: PreparedCharacter, progress: Callable[[float], None] = lambda _share: None) -> MadeRig:
    """Return the rig of a puppet in its rest pose with at most 4 joints per vertex, which is made once."""
    if prepared not in _MADE:
        _MADE[prepared] = make_rig(prepared, progress=progress)
    return _MADE[prepared]


def make_rig(
    prepared: PreparedCharacter,
    *,
    in_t_pose: bool = False,
    influences: int = skin_weights.MAX_INFLUENCES,
    progress: Callable[[float], None] = lambda _share: None,
) -> MadeRig:
    """Make a skeleton along the limbs of a puppet, with a joint for each handle, and fit its weights.

    Parameters
    ----------
    prepared : PreparedCharacter
    in_t_pose : bool, optional
        Whether the mesh is bound in a T-pose; requires bones.
    influences : int, optional
        Maximum number of joints per vertex.
    progress : callable, optional
        Receives the share of the work that is done.
    """
    skeleton, basis = Skeleton.along_bones(prepared.puppet), prepared.puppet.character.basis
    progress(0.0)
    controls, motions = random_poses(prepared, POSES)
    motions = with_handles(prepared, controls, motions)
    progress(0.5)
    bind, vertices = None, prepared.mesh.vertices
    if in_t_pose:
        bind = t_pose(prepared, skeleton)
        vertices = bind.vertices(vertices)
        start = with_handles(prepared, bind.R[None], bind.motions[None])[0]
        skeleton, motions = posed(skeleton, start, basis), _since(motions, start)
    weights = skin_weights.fit(prepared.model, prepared.mesh, controls, motions, rest=vertices, influences=influences)
    images = mirror_images(vertices, basis[0])
    if (images >= 0).mean() >= MIN_SYMMETRIC_SHARE:
        weights = symmetric(weights, images, _opposite(prepared, motions.shape[1]))
    rms, error = distances(prepared, weights, vertices, controls[::COMPARED_STRIDE], motions[::COMPARED_STRIDE])
    progress(1.0)
    return MadeRig(skeleton, joint_weights(weights, skeleton.joints, vertices), bind, rms, error)


def with_handles(
    prepared: PreparedCharacter, controls: NDArray[np.floating], motions: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Return the motions of bones and handles (F, b + h, 4, 3) for controls (F, 4m, 3) and motions (F, b, 4, 3)."""
    if not prepared.puppet.handle:
        return motions.astype(np.float64)
    handles = HandleMotions(prepared.model, prepared.mesh, prepared.puppet.handle_positions)
    return np.concatenate([motions, handles.of(controls)], axis=1)


def _since(motions: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return motions (F, b, 4, 3) as motions from the pose that other motions (b, 4, 3) lead to."""
    back = start[:, :3].swapaxes(1, 2)
    turns = back @ motions[:, :, :3]
    offsets = motions[:, :, 3] - np.einsum("bi,fbij->fbj", start[:, 3], turns)
    return np.concatenate([turns, offsets[:, :, None]], axis=2)


def _opposite(prepared: PreparedCharacter, count: int) -> NDArray[np.int64]:
    """Return the bone or handle (count,) on the other side for each one: that of the limb or handle with its name."""
    names = [
        (limb.name, number) for limb in parents_first(prepared.puppet.limbs) for number in range(len(limb.points) - 1)
    ]
    names += [(handle.name, -1) for handle in prepared.puppet.handle]
    swapped = {"left": "right", "right": "left"}
    rows = {key: row for row, key in enumerate(names)}
    opposite = np.arange(count)
    for row, (name, number) in enumerate(names):
        other = " ".join(swapped.get(word, word) for word in name.split(" "))
        opposite[row] = rows.get((other, number), row)
    return opposite
