"""A rig for a puppet's character: a skeleton, and weights fitted to the surface of its reduced model."""

from collections.abc import Callable
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from engine_bridge.performance.exercise import random_poses
from engine_bridge.performance.rig import Rig
from engine_bridge.rigging.joint_weights import joint_weights
from engine_bridge.rigging.skeleton import Skeleton
from solver.motion.handle_motion import HandleMotions
from solver.skinning import weights as skin_weights
from solver.skinning.weights import Weights

POSES = 160
"""Number of random poses to which weights are fitted."""


@dataclass(frozen=True, eq=False)
class MadeRig:
    """A skeleton and skin weights.

    Attributes
    ----------
    skeleton : Skeleton
        Axes along the bones, mesh file's coordinates.
    weights : Weights
        Weights of the joints, for the solver's vertices.
    """

    skeleton: Skeleton
    weights: Weights


_MADE: WeakKeyDictionary[Rig, MadeRig] = WeakKeyDictionary()
"""Rigs that were made, for the next clips of the same characters."""


def made_rig(rig: Rig, progress: Callable[[float], None] = lambda _share: None) -> MadeRig:
    """Return the rig of a puppet with at most 4 joints per vertex, which is made once."""
    if rig not in _MADE:
        _MADE[rig] = make_rig(rig, progress=progress)
    return _MADE[rig]


def make_rig(
    rig: Rig, influences: int = skin_weights.MAX_INFLUENCES, progress: Callable[[float], None] = lambda _share: None
) -> MadeRig:
    """Make a skeleton along the limbs of a puppet, with a joint for each handle, and fit its weights.

    Parameters
    ----------
    rig : Rig
    influences : int, optional
        Maximum number of joints per vertex.
    progress : callable, optional
        Receives the share of the work that is done.
    """
    skeleton = Skeleton.along_bones(rig.puppet)
    progress(0.0)
    controls, motions = random_poses(rig, POSES)
    progress(0.5)
    weights = skin_weights.fit(
        rig.model, rig.mesh, controls, with_handles(rig, controls, motions), influences=influences
    )
    progress(1.0)
    return MadeRig(skeleton, joint_weights(weights, skeleton.joints, rig.mesh.vertices))


def with_handles(rig: Rig, controls: NDArray[np.floating], motions: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the motions of bones and handles (F, b + h, 4, 3) for controls (F, 4m, 3) and motions (F, b, 4, 3)."""
    if not rig.puppet.handle:
        return motions.astype(np.float64)
    handles = HandleMotions(rig.model, rig.mesh, rig.puppet.handle_positions)
    return np.concatenate([motions, handles.of(controls)], axis=1)
