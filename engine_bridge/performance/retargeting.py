"""Retargeting of a performer's frames to motions of a puppet's bones and targets of its handles.

A frame is smoothed (`capture.smoothing`), mirrored if the puppet requires it, and converted to character axes. Limbs
follow the directions of the performer's (`solver.motion.limb_motion`). For the handles, the root's motion is removed
and the rest is scaled to the character (`solver.motion.retarget`); handles move with a character's trunk.
"""

import math
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from capture import body, orientations
from capture.cuts import is_cut
from capture.skeleton import JOINT_INDEX, LIMBS, LOST, OPPOSITE, SkeletonFrame, mirrored, to_character_axes
from capture.smoothing import JointFilter
from engine_bridge.performance.grounding import SIDES, Grounding, chain_of, grounding_of
from engine_bridge.performance.pose import TargetPose
from engine_bridge.puppet.puppet import Puppet, axis_mask
from solver.model.bones import Bones
from solver.motion.arms import Arm, Arms
from solver.motion.deformer import Deformer
from solver.motion.floor import Floor
from solver.motion.late_limbs import LateLimbs
from solver.motion.limb_motion import LimbMotion
from solver.motion.limbs import Performer
from solver.motion.motion_limits import limb_reach
from solver.motion.retarget import Fit, Retargeter, SmoothReturn
from solver.surface.mesh import SolverMesh

PERFORMER = Performer(
    hips=(JOINT_INDEX["hip_left"], JOINT_INDEX["hip_right"]),
    shoulders=(JOINT_INDEX["shoulder_left"], JOINT_INDEX["shoulder_right"]),
    opposite=OPPOSITE.astype(np.int64),
)


@dataclass
class _Followers:
    """What follows a performer over time, with its state between frames.

    `with_root` (20, 3) are the displacements of all joints when the root was last known.
    """

    smoothing: JointFilter
    limbs: LimbMotion
    arms: Arms | None
    retargeter: Retargeter
    root_return: SmoothReturn
    grounding: Grounding | None
    late: LateLimbs
    with_root: NDArray[np.float64]


class Retargeting:
    """Retargeting of one performer to a puppet's handles and limbs.

    Parameters
    ----------
    puppet : Puppet
    mesh : SolverMesh
        Mesh of the puppet's character.
    deformer : Deformer
        Deformer of that mesh, used to find the reach of the handles and bones; it is not changed.
    rest : (20, 3) float64
        Performer's calibration pose, sensor coordinates, NaN for unknown joints.

    Attributes
    ----------
    joints : (20, 3) float64
        Smoothed joints of the performer in the last frame, sensor coordinates, NaN for unknown joints.
    has_cut : bool
        Whether the performer cannot have moved from the frame before the last one to the last one.
    """

    def __init__(self, puppet: Puppet, mesh: SolverMesh, deformer: Deformer, rest: NDArray[np.float64]) -> None:
        self.joints = rest
        self._puppet = puppet
        self._basis = puppet.character.basis
        self._rest = self._to_character(rest)
        self._root = JOINT_INDEX[puppet.root.joint] if puppet.root else 0
        self.fit = fit_sizes(puppet, deformer, mesh, rest)
        grounding, self.root_scale = grounding_of(puppet, mesh, deformer.bones, rest)
        limbs = LimbMotion(puppet.limbs, PERFORMER, self._rest, self._basis, turns=puppet.turns)
        calibration = self._rest
        if limbs.trunk is not None:
            known = np.asarray(np.isfinite(self._rest).all(axis=1), dtype=np.float32)
            at_rest = limbs.restarted().step(0.0, self._rest, known)
            calibration = self._against_trunk(self._rest, at_rest, limbs.trunk)
        self._first = _Followers(
            JointFilter(puppet.smoothing.parameters),
            limbs,
            arms_of(puppet, deformer.bones, rest),
            Retargeter(deformer.handles, puppet.mapping, self.fit, calibration, self._basis),
            SmoothReturn(1),
            grounding,
            LateLimbs(limbs.limbs, deformer.bones),
            np.full_like(self._rest, np.nan),
        )
        self._floor = None
        if grounding is not None:
            owner = deformer.model.regions.owner
            self._floor = Floor(limbs.limbs, deformer.bones, mesh.vertices, owner, self._basis)
        self._now = deepcopy(self._first)
        self._last: SkeletonFrame | None = None  # in which a joint was known
        self.has_cut = False

    def _begin(self) -> None:
        """Follow the performer from the next frame on as from the first one; bones keep their axes."""
        limbs = self._now.limbs.restarted()
        self._now = replace(deepcopy(self._first), limbs=limbs)

    def step(self, frame: SkeletonFrame) -> TargetPose:
        """Retarget the next frame, which is later than the previous one; after a cut, everything begins again."""
        last = self._last
        self.has_cut = last is not None and bool(
            is_cut(last.positions, last.confidence, frame.positions, frame.confidence, frame.time - last.time)
        )
        if self.has_cut:
            self._begin()
        if (frame.confidence > LOST).any():
            self._last = frame
        now = self._now
        self.joints = now.smoothing.step(frame.time, frame.positions, frame.confidence)
        positions = self._to_character(self.joints)
        confidence = frame.confidence[OPPOSITE] if self._puppet.retarget.mirror else frame.confidence
        moved = np.zeros(3)
        if self._puppet.root is not None:
            displacement = self._root_displacement(positions - self._rest, confidence > LOST)
            moved = now.root_return.step(frame.time, displacement[None], np.ones(1, dtype=bool))[0]
            moved = moved * axis_mask(self._puppet.root.axes)
        motions = now.limbs.step(frame.time, positions, confidence, orientations=self._orientations(frame))
        if now.arms is not None:
            now.arms.step(frame.time, positions, confidence, motions, now.limbs.heading)
        trunk = now.limbs.trunk
        if trunk is None:
            targets = now.retargeter.step(frame.time, positions - moved, confidence)
        else:
            targets = now.retargeter.step(frame.time, self._against_trunk(positions, motions, trunk), confidence)
            targets = targets @ motions[trunk, :3] + motions[trunk, 3]
        root = self.root_scale * moved @ self._basis
        if now.grounding is not None:
            now.grounding.step(frame.time, positions, confidence, motions, root)
        now.late.step(frame.time, motions, root)
        if self._floor is not None:
            self._floor.step(motions, root)
        return TargetPose(targets, motions, root)

    @property
    def mirrors(self) -> bool:
        """Whether the performer's left moves the character's right."""
        return self._puppet.retarget.mirror

    @property
    def standing(self) -> NDArray[np.float64]:
        """Positions (l, 3) float64 where the character's feet are held, mesh file's coordinates; NaN for free feet."""
        grounding = self._now.grounding
        return np.empty((0, 3)) if grounding is None else grounding.places

    def stand(self, places: NDArray[np.float64]) -> None:
        """Hold the feet at the positions `standing` of a previous retargeting of the same puppet."""
        grounding = self._now.grounding
        if grounding is not None and places.shape == self.standing.shape:
            grounding.hold(places)

    def _against_trunk(
        self, positions: NDArray[np.float64], motions: NDArray[np.float64], trunk: int
    ) -> NDArray[np.float64]:
        """Return joints (20, 3) relative to the hips and to the axes of the moved trunk."""
        turn = self._basis @ motions[trunk, :3] @ self._basis.T
        return (positions - positions[JOINT_INDEX["hip_center"]]) @ turn.T

    def _root_displacement(self, displacement: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the displacement (3,) of the root; a lost joint moves with the median of the others.

        It is NaN if no joint is known.
        """
        known = known & np.isfinite(displacement).all(axis=1)
        if known[self._root]:
            self._now.with_root = np.where(known[:, None], displacement, np.nan)
            return displacement[self._root]
        since = (displacement - self._now.with_root)[known]
        since = since[np.isfinite(since).all(axis=1)]
        return self._now.with_root[self._root] + (np.median(since, axis=0) if len(since) else np.nan)

    def _to_character(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        return to_character_axes(mirrored(positions) if self._puppet.retarget.mirror else positions)

    def _orientations(self, frame: SkeletonFrame) -> NDArray[np.float64] | None:
        """Return the rotations (20, 4) of the performer's bones, character axes, if the frame has them."""
        if frame.orientations is None:
            return None
        mirror = self._puppet.retarget.mirror
        return orientations.to_character_axes(
            orientations.mirrored(frame.orientations) if mirror else frame.orientations
        )


def fit_sizes(puppet: Puppet, deformer: Deformer, mesh: SolverMesh, rest: NDArray[np.float64]) -> Fit:
    """Find the scale from the performer to the character (the paper's Eq. 5, without its window).

    With ``scale = "auto"``, a fully stretched limb of the performer moves its handles by their reach, which test
    deformations determine. If the scale is a number, it is used without limits.

    Parameters
    ----------
    puppet : Puppet
    deformer : Deformer
        Deformer of the puppet's character and handles.
    mesh : SolverMesh
        Mesh of the character.
    rest : (20, 3) float64
        Performer's calibration pose, sensor coordinates.
    """
    mapping = puppet.mapping
    if puppet.units_per_metre is not None or not puppet.handle:
        count, units = len(puppet.handle), puppet.units_per_metre or 1.0
        return Fit(np.full(count, units), np.full((count, 3, 2), np.inf))
    arm = mapping.matrix @ body.reach(mirrored(rest) if puppet.retarget.mirror else rest)
    limbs, of_handle = _limbs(puppet, arm)
    reach = limb_reach(deformer, mesh, limbs)[of_handle]
    # directions of the mesh in which the joints can move each handle
    used = mapping.axes @ np.abs(puppet.character.basis)
    typical = np.einsum("has,ha->h", reach, used) / np.maximum(2 * used.sum(axis=1), 1)
    share = np.abs(limbs[of_handle, np.arange(len(arm))])
    longest = np.where(share > 0, arm / np.maximum(share, 1e-9), 1.0)
    return Fit(typical / longest, np.maximum(share, 1e-9)[:, None, None] * reach)


def _limbs(puppet: Puppet, arm: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Group handles by the limb of the performer that moves them.

    A handle that several limbs move, or none, is a group of its own. The arms belong to the trunk's group too.

    Returns
    -------
    limbs : (l, h) float64
        Share of each handle in a limb's motion, for `limb_reach`.
    of_handle : (h,) int64
        Limb of each handle.
    """
    names = []
    for number, handle in enumerate(puppet.handle):
        moved_by = {limb for limb, joints in LIMBS.items() if not set(handle.driven_by).isdisjoint(joints)}
        names.append(moved_by.pop() if len(moved_by) == 1 else f"handle {number}")
    distinct = list(dict.fromkeys(names))
    of_handle = np.array([distinct.index(name) for name in names])
    limbs = (of_handle == np.arange(len(distinct))[:, None]) * arm
    limbs /= np.maximum(limbs.max(axis=1, keepdims=True), 1e-9)
    if "trunk" in distinct:
        limbs[distinct.index("trunk")] += [name.endswith("arm") for name in names]
    return limbs * np.sign(puppet.mapping.gain), of_handle


def arms_of(puppet: Puppet, bones: Bones, rest: NDArray[np.float64]) -> Arms | None:
    """Return the correction of arms for different proportions; None without two arms that follow directions.

    Parameters
    ----------
    puppet : Puppet
    bones : Bones
        Bones of its limbs.
    rest : (20, 3) float64
        Performer's calibration pose, NaN for unknown joints.
    """
    arms = []
    for side in SIDES:
        found = chain_of(puppet, side, "shoulder", "elbow", "wrist")
        if found is None or len(found[2]) > 1:
            return None
        upper, last, (joint,) = found
        arms.append(Arm(upper, upper + 1, last, joint))
    lengths = body.bone_lengths(rest)
    performers = np.mean([lengths[f"elbow_{side}"] + lengths[f"wrist_{side}"] for side in SIDES])
    space, meet = math.radians(puppet.retarget.arm_space), puppet.retarget.hands_meet
    left, right = arms
    return Arms(bones, left, right, float(performers), puppet.character.basis, space=space, meet=meet)
