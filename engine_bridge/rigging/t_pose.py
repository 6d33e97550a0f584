"""A character in a T-pose: its arms, legs and trunk straightened by the reduced model."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from engine_bridge.performance.character_motion import make_deformer
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.rigging.joints import Joint
from engine_bridge.rigging.skeleton import Skeleton, along_bones, from_t_pose
from solver.motion.deformer import to_file_units

ITERATIONS = 40
"""Number of iterations of the deformation, which begins at rest."""


@dataclass(frozen=True, eq=False)
class BindPose:
    """A pose in which meshes are bound to joints.

    Attributes
    ----------
    motions : (b, 4, 3) float64
        Motions of the bones from rest for row vectors, mesh file's coordinates.
    R : (4m, 3) float64
        Control variables of the pose, model units.
    transforms : (n, 4, 4) float64
        Transforms of the solver's vertices from rest, for column vectors.
    """

    motions: NDArray[np.float64]
    R: NDArray[np.float64]
    transforms: NDArray[np.float64]

    def vertices(self, rest: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the positions of the vertices, given those at rest (n, 3)."""
        return np.einsum("nij,nj->ni", self.transforms[:, :3, :3], rest) + self.transforms[:, :3, 3]


def t_pose(prepared: PreparedCharacter, skeleton: Skeleton) -> BindPose:
    """Straighten a character.

    Each bone takes the rotation that undoes `from_t_pose`. Handles move with the first bone, as the trunk does.

    Parameters
    ----------
    prepared : PreparedCharacter
        With bones.
    skeleton : Skeleton
        Skeleton of its puppet.
    """
    deformer = make_deformer(prepared).another(ITERATIONS)
    basis, bones = prepared.puppet.character.basis, deformer.bones
    turns = np.tile(np.eye(3), (len(bones), 1, 1))
    for joint, turn in zip(skeleton.joints, from_t_pose(prepared.puppet, skeleton.joints), strict=True):
        if 0 <= joint.bone < len(bones):
            turns[joint.bone] = basis.T @ turn @ basis  # for row vectors: the inverse of the turn to rest
    motions = np.empty((len(bones), 4, 3))
    for bone, parent in enumerate(bones.parents):
        head = bones.heads[bone]
        place = head if parent < 0 else head @ motions[parent, :3] + motions[parent, 3]
        motions[bone, :3], motions[bone, 3] = turns[bone], place - head @ turns[bone]
    R = deformer.solve(deformer.handles @ motions[0, :3] + motions[0, 3], motions)
    shares = prepared.model.position_matrix(prepared.mesh.vertices)[:, 3::4]
    controls = to_file_units(R, prepared.model).astype(np.float64)
    blended = (shares @ controls.reshape(len(controls), 12)).reshape(-1, 3, 4)
    transforms = np.tile(np.eye(4), (len(blended), 1, 1))
    transforms[:, :3] = blended
    return BindPose(motions, R, transforms)


def posed(skeleton: Skeleton, motions: NDArray[np.float64], basis: NDArray[np.float64]) -> Skeleton:
    """Return a skeleton whose rest pose is that after some motions of its bones and handles (b, 4, 3)."""

    def moved(joint: Joint, point: NDArray[np.float64]) -> NDArray[np.float64]:
        if joint.bone < 0:
            return point
        return np.asarray(point @ motions[joint.bone, :3] + motions[joint.bone, 3])

    joints = tuple(
        replace(joint, head=moved(joint, joint.head), tail=moved(joint, joint.tail)) for joint in skeleton.joints
    )
    return replace(skeleton, joints=joints, axes=along_bones(joints, basis))
