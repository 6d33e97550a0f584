"""A performer's frames as the motions of a puppet's bones and the targets of its handles.

A frame is smoothed (`capture.smoothing`), mirrored if the puppet says so, and turned into character axes. Limbs take
the directions of the performer's (`solver.motion.limb_motion`). For the handles a frame is freed of the root's own
motion and scaled to the character (`solver.motion.retarget`); a character's trunk carries its handles.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture import body, orientations
from capture.skeleton import JOINT_INDEX, LIMBS, LOST, OPPOSITE, SkeletonFrame, mirrored, to_character_axes
from capture.smoothing import JointFilter
from engine_bridge.puppet.puppet import Puppet, axis_mask
from solver.model.bones import Bones
from solver.motion.arms import Arm, Arms
from solver.motion.deformer import Deformer
from solver.motion.feet import Feet, Leg
from solver.motion.limb_motion import LimbMotion
from solver.motion.limbs import Performer, parents_first
from solver.motion.motion_limits import limb_reach
from solver.motion.retarget import Fit, Retargeter, SmoothReturn
from solver.surface.mesh import SolverMesh


@dataclass(frozen=True, slots=True)
class Aim:
    """Where a performer wants a character's handles and bones.

    Attributes
    ----------
    targets : (h, 3) float64
        Mesh file's coordinates, without the root's motion.
    motions : (b, 4, 3) float64
        Motions of the bones for row vectors, mesh file's coordinates, without the root's motion.
    root : (3,) float64
        Translation of the whole character, mesh file's coordinates; zero where the puppet has no root.
    joints : (20, 3) float64
        The smoothed joints, metres, sensor frame.
    """

    targets: NDArray[np.float64]
    motions: NDArray[np.float64]
    root: NDArray[np.float64]
    joints: NDArray[np.float64]


PERFORMER = Performer(
    hips=(JOINT_INDEX["hip_left"], JOINT_INDEX["hip_right"]),
    shoulders=(JOINT_INDEX["shoulder_left"], JOINT_INDEX["shoulder_right"]),
    opposite=OPPOSITE.astype(np.int64),
)


class Retargeting:
    """A puppet's handles and limbs, moved by one performer.

    Parameters
    ----------
    puppet : Puppet
    mesh : SolverMesh
        Of the puppet's character.
    deformer : Deformer
        Of that mesh and the puppet's handles and bones; tried out for their reach, and not moved.
    rest : (20, 3) float64
        The performer's joints in the pose that stands for the character's rest pose; sensor frame, NaN where unknown.
    """

    def __init__(self, puppet: Puppet, mesh: SolverMesh, deformer: Deformer, rest: NDArray[np.float64]) -> None:
        self._puppet = puppet
        self._basis = puppet.character.basis
        self._filter = JointFilter(puppet.smoothing.parameters)
        self._rest = self._to_character(rest)
        self.fit = fit_sizes(puppet, deformer, mesh, rest)
        legs = legs_of(puppet)
        self.root_scale = _root_scale(puppet, mesh, rest, legs, deformer.bones)
        self._feet = Feet(deformer.bones, legs, self.root_scale, self._basis) if legs else None
        self._limbs = LimbMotion(puppet.limbs, PERFORMER, self._rest, self._basis, turns=puppet.turns)
        self._arms = arms_of(puppet, deformer.bones, rest)
        calibration = self._rest
        if self._limbs.trunk is not None:
            at_rest = LimbMotion(puppet.limbs, PERFORMER, self._rest, self._basis, turns=puppet.turns)
            known = np.asarray(np.isfinite(self._rest).all(axis=1), dtype=np.float32)
            calibration = self._against_trunk(self._rest, at_rest.step(0.0, self._rest, known))
        self._retargeter = Retargeter(deformer.handles, puppet.mapping, self.fit, calibration, self._basis)
        self._root = JOINT_INDEX[puppet.root.joint] if puppet.root else 0
        self._root_return = SmoothReturn(1)
        self._with_root = np.full_like(self._rest, np.nan)  # all joints when the root was last known

    def step(self, frame: SkeletonFrame) -> Aim:
        """Take the next frame, later than the one before."""
        joints = self._filter.step(frame.time, frame.positions, frame.confidence)
        positions = self._to_character(joints)
        confidence = frame.confidence[OPPOSITE] if self._puppet.retarget.mirror else frame.confidence
        moved = np.zeros(3)
        if self._puppet.root is not None:
            displacement = self._root_displacement(positions - self._rest, confidence > LOST)
            moved = self._root_return.step(frame.time, displacement[None], np.ones(1, dtype=bool))[0]
            moved = moved * axis_mask(self._puppet.root.axes)
        motions = self._limbs.step(frame.time, positions, confidence, orientations=self._orientations(frame))
        if self._arms is not None:
            self._arms.step(frame.time, positions, confidence, motions, self._limbs.heading)
        trunk = self._limbs.trunk
        if trunk is None:
            targets = self._retargeter.step(frame.time, positions - moved, confidence)
        else:
            targets = self._retargeter.step(frame.time, self._against_trunk(positions, motions), confidence)
            targets = targets @ motions[trunk, :3] + motions[trunk, 3]
        root = self.root_scale * moved @ self._basis
        if self._feet is not None:
            self._feet.step(frame.time, positions, confidence, motions, root)
        return Aim(targets, motions, root, joints)

    @property
    def standing(self) -> NDArray[np.float64]:
        """(l, 3) float64: where the character's feet are held, mesh file's coordinates; NaN where they are not."""
        return np.empty((0, 3)) if self._feet is None else self._feet.places

    def stand(self, places: NDArray[np.float64]) -> None:
        """Hold feet from the first frame on, as `standing` of another one of the same puppet says; others are not."""
        if self._feet is not None and places.shape == self.standing.shape:
            self._feet.hold(places)

    def _against_trunk(self, positions: NDArray[np.float64], motions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return joints (20, 3) from the hips and in the axes of a trunk that has moved."""
        turn = self._basis @ motions[self._limbs.trunk, :3] @ self._basis.T
        return (positions - positions[JOINT_INDEX["hip_center"]]) @ turn.T

    def _root_displacement(self, displacement: NDArray[np.float64], known: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return where the root has moved to (3,); while its joint is lost it goes on with the median of the others.

        NaN where nothing is known.
        """
        known = known & np.isfinite(displacement).all(axis=1)
        if known[self._root]:
            self._with_root = np.where(known[:, None], displacement, np.nan)
            return displacement[self._root]
        since = (displacement - self._with_root)[known]
        since = since[np.isfinite(since).all(axis=1)]
        return self._with_root[self._root] + (np.median(since, axis=0) if len(since) else np.nan)

    def _to_character(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        return to_character_axes(mirrored(positions) if self._puppet.retarget.mirror else positions)

    def _orientations(self, frame: SkeletonFrame) -> NDArray[np.float64] | None:
        """Return how the performer's bones are turned (20, 4), character axes, where the frame says so."""
        if frame.orientations is None:
            return None
        mirror = self._puppet.retarget.mirror
        return orientations.to_character_axes(
            orientations.mirrored(frame.orientations) if mirror else frame.orientations
        )


def fit_sizes(puppet: Puppet, deformer: Deformer, mesh: SolverMesh, rest: NDArray[np.float64]) -> Fit:
    """Set the performer's size against the character's (the paper's Eq. 5, for want of a window).

    With ``scale = "auto"`` a limb of the performer that is stretched out fully takes its handles to the end of their
    reach, found by trying the deformation; a number is used as it stands, without limits.

    Parameters
    ----------
    puppet : Puppet
    deformer : Deformer
        Of the puppet's character and handles.
    mesh : SolverMesh
        The character.
    rest : (20, 3) float64
        The performer, sensor frame.
    """
    mapping = puppet.mapping
    if puppet.units_a_metre is not None or not puppet.handle:
        count, units = len(puppet.handle), puppet.units_a_metre or 1.0
        return Fit(np.full(count, units), np.full((count, 3, 2), np.inf))
    arm = mapping.matrix @ body.reach(mirrored(rest) if puppet.retarget.mirror else rest)
    limbs, of_handle = _limbs(puppet, arm)
    reach = limb_reach(deformer, mesh, limbs)[of_handle]
    # the directions of the mesh in which the handle's joints may move it at all
    used = mapping.axes @ np.abs(puppet.character.basis)
    typical = np.einsum("has,ha->h", reach, used) / np.maximum(2 * used.sum(axis=1), 1)
    share = np.abs(limbs[of_handle, np.arange(len(arm))])
    longest = np.where(share > 0, arm / np.maximum(share, 1e-9), 1.0)
    return Fit(typical / longest, np.maximum(share, 1e-9)[:, None, None] * reach)


def _limbs(puppet: Puppet, arm: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Sort handles by the limb of the performer that moves them.

    A handle moved by several limbs, or by none, is one by itself. Where the trunk goes, the arms go too.

    Returns
    -------
    limbs : (l, h) float64
        Each handle's share of a limb's motion, as `limb_reach` wants it.
    of_handle : (h,) int64
        The limb of each handle.
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


def legs_of(puppet: Puppet) -> tuple[Leg, ...]:
    """Return the two legs whose feet are held on the floor; none for other characters, or if the puppet says so."""
    if puppet.root is None or puppet.root.feet == "free":
        return ()
    legs = [leg for side in ("left", "right") if (leg := _leg(puppet, side)) is not None]
    return tuple(legs) if len(legs) == 2 else ()


def _leg(puppet: Puppet, side: str) -> Leg | None:
    """Find the bones that point where a performer's thigh and shin do, and the one after them."""
    found = _chain(puppet, "hip", "knee", "ankle", side)
    if found is None:
        return None
    thigh, last, _ = found
    return Leg(thigh, thigh + 1, thigh + 2 if last > thigh + 1 else -1, JOINT_INDEX[f"ankle_{side}"])


def arms_of(puppet: Puppet, bones: Bones, rest: NDArray[np.float64]) -> Arms | None:
    """Return what moves the arms of a body that is built otherwise; None without two arms that follow directions.

    Parameters
    ----------
    puppet : Puppet
    bones : Bones
        Of its limbs.
    rest : (20, 3) float64
        The performer, NaN where unknown.
    """
    arms = []
    for side in ("left", "right"):
        found = _chain(puppet, "shoulder", "elbow", "wrist", side)
        if found is None or len(found[2]) > 1:
            return None
        upper, last, (joint,) = found
        arms.append(Arm(upper, upper + 1, last, joint))
    lengths = body.bone_lengths(rest)
    performers = np.mean([lengths[f"elbow_{side}"] + lengths[f"wrist_{side}"] for side in ("left", "right")])
    space, meet = math.radians(puppet.retarget.arm_space), puppet.retarget.hands_meet
    left, right = arms
    return Arms(bones, left, right, float(performers), puppet.character.basis, space=space, meet=meet)


def _chain(puppet: Puppet, *names: str) -> tuple[int, int, tuple[int, ...]] | None:
    """Find a limb that points where three joints of one side do.

    Parameters
    ----------
    puppet : Puppet
    names : str
        Three joints and the side.

    Returns
    -------
    tuple of int, int and tuple of int, or None
        The bone between the first two, the limb's last bone, and the joints at its tip.
    """
    *joints, side = names
    chain, first = tuple((JOINT_INDEX[f"{joint}_{side}"],) for joint in joints), 0
    for limb in parents_first(puppet.limbs):
        last = first + len(limb.points) - 2
        for k in range(len(limb.joints) - 2):
            if limb.follow == "direction" and limb.joints[k : k + 3] == chain:
                return first + k, last, limb.joints[-1]
        first = last + 1
    return None


def _root_scale(
    puppet: Puppet, mesh: SolverMesh, rest: NDArray[np.float64], legs: tuple[Leg, ...], bones: Bones
) -> float:
    """Return mesh units per metre of the root: the number given, or the character's size to the performer's.

    A character that stands on its feet is measured by its legs, so that a step is as long as the legs make it; any
    other by its height.
    """
    if puppet.units_a_metre is not None:
        return puppet.units_a_metre
    if legs:
        performers = body.bone_lengths(rest)
        length = np.mean([performers[f"{bone}_{side}"] for bone in ("knee", "ankle") for side in ("left", "right")])
        return float(np.mean([bones.lengths[[leg.thigh, leg.shin]] for leg in legs]) / length)
    up = puppet.character.basis[1]
    return float(np.ptp(mesh.vertices @ up) / body.height(rest))
