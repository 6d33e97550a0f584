"""Legs of a puppet that stand and step by themselves, and the performer's measures that they need."""

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.skeleton import JOINT_INDEX, LIMBS
from engine_bridge.puppet.puppet import Puppet
from solver.model.bones import Bones
from solver.motion.limbs import TRUNK, bone_ranges, parents_first
from solver.motion.step_plan import PerformersLegs, StandingLeg
from solver.motion.steps import Steps

SIDES = "left", "right"


def steps_of(puppet: Puppet, bones: Bones, rest: NDArray[np.float64]) -> Steps | None:
    """Return the steps of a puppet; None without legs that stand, without a root, or with free feet.

    Parameters
    ----------
    puppet : Puppet
    bones : Bones
        Bones of its limbs.
    rest : (20, 3) float64
        Performer's calibration pose, NaN for unknown joints.
    """
    legs, trunk = _legs_and_trunk(puppet)
    if not legs or puppet.root is None or puppet.root.feet == "free":
        return None
    performer = _performers_legs(rest)
    basis = puppet.character.basis
    metre = puppet.units_per_metre or _leg_length(legs, bones, basis) / performer.leg
    forward = puppet.root.walk == "forward"
    return Steps(bones, legs, trunk, performer, metre, basis, goes_forward=forward)


def _legs_and_trunk(puppet: Puppet) -> tuple[list[StandingLeg], list[int]]:
    """Return the legs that stand, and the bones of the trunk."""
    legs, ranges = [], bone_ranges(puppet.limbs)
    for limb in parents_first(puppet.limbs):
        if limb.stands and limb.name != TRUNK:
            arm = next((side for side in SIDES if _is_of(limb.joints, f"{side} arm")), None)
            hand, shoulder = (-1, -1) if arm is None else (limb.joints[-1][0], JOINT_INDEX[f"shoulder_{arm}"])
            legs.append(StandingLeg(tuple(ranges[limb.name]), hand, shoulder))
    return legs, list(ranges.get(TRUNK, ()))


def _is_of(joints: tuple[tuple[int, ...], ...], limb: str) -> bool:
    """Return whether the last of a limb's joints belongs to a limb of the performer."""
    return joints[-1][0] in {JOINT_INDEX[joint] for joint in LIMBS[limb]}


def _performers_legs(rest: NDArray[np.float64]) -> PerformersLegs:
    lengths = body.bone_lengths(rest)

    def mean(*bones: str) -> float:
        return float(sum(np.mean([lengths[f"{bone}_{side}"] for side in SIDES]) for bone in bones))

    return PerformersLegs(
        ankles=(JOINT_INDEX["ankle_left"], JOINT_INDEX["ankle_right"]),
        hips=(JOINT_INDEX["hip_left"], JOINT_INDEX["hip_right"]),
        leg=mean("knee", "ankle"),
        arm=mean("elbow", "wrist", "hand"),
    )


def _leg_length(legs: list[StandingLeg], bones: Bones, basis: NDArray[np.float64]) -> float:
    """Return the mean height of the hips over the ends of the legs."""
    return float(np.mean([(bones.heads[leg.bones[0]] - bones.tails[leg.bones[-1]]) @ basis[1] for leg in legs]))
