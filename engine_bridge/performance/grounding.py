"""How the feet of a character stay on the floor: held where the performer's stand, or by steps of its own.

`Feet` is for two legs that follow the directions of the performer's; `Steps` is for any legs that stand by themselves.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from capture import body
from capture.skeleton import JOINT_INDEX, LIMBS
from engine_bridge.puppet.puppet import Puppet
from solver.model.bones import Bones
from solver.motion.feet import Feet, Leg
from solver.motion.limbs import TRUNK, bone_ranges, parents_first
from solver.motion.step_plan import PerformersLegs, StandingLeg
from solver.motion.steps import Steps
from solver.surface.mesh import SolverMesh

SIDES = "left", "right"
"""The performer's sides."""


class Grounding(Protocol):
    """Puts a character's feet on the floor, frame by frame."""

    def step(
        self,
        time: float,
        positions: NDArray[np.float64],
        confidence: NDArray[np.float32],
        motions: NDArray[np.float64],
        root: NDArray[np.float64],
    ) -> None:
        """Change the motions of the bones (b, 4, 3) and the root (3,) of one frame."""

    @property
    def places(self) -> NDArray[np.float64]:
        """(l, 3) float64: where feet are held, mesh file's coordinates; NaN for others."""

    def hold(self, places: NDArray[np.float64]) -> None:
        """Hold feet from the first frame on, at the `places` of another instance."""


def grounding_of(
    puppet: Puppet, mesh: SolverMesh, bones: Bones, rest: NDArray[np.float64]
) -> tuple[Grounding | None, float]:
    """Return how feet are put on the floor, None for free feet, and mesh units per metre of the root's motion.

    Parameters
    ----------
    puppet : Puppet
    mesh : SolverMesh
    bones : Bones
        Bones of the puppet's limbs.
    rest : (20, 3) float64
        Performer's calibration pose, NaN for unknown joints.
    """
    steps = steps_of(puppet, bones, rest)
    if steps is not None:
        return steps, steps.metre
    legs = legs_of(puppet)
    scale = _root_scale(puppet, mesh, rest, legs, bones)
    if not legs:
        return None, scale
    return Feet(bones, legs, scale, puppet.character.basis, pelvis=_pelvis_of(puppet)), scale


def stands(puppet: Puppet) -> bool:
    """Return whether the feet of a puppet's character are held on the floor."""
    return bool(legs_of(puppet)) or any(limb.stands for limb in puppet.limb)


def legs_of(puppet: Puppet) -> tuple[Leg, ...]:
    """Return the two legs, of an animal's four, whose feet are held on the floor; none for others or with free feet."""
    if puppet.root is None or puppet.root.feet == "free":
        return ()
    chains = (("hip", "knee", "ankle"), ("shoulder", "elbow", "wrist"))[: 2 if _is_on_all_fours(puppet) else 1]
    legs = [leg for chain in chains for side in SIDES if (leg := _leg(puppet, side, *chain)) is not None]
    return tuple(legs) if len(legs) == 2 * len(chains) else ()


def _is_on_all_fours(puppet: Puppet) -> bool:
    """Return whether legs stand that point as an animal's do (`engine_bridge.performance.animals`), and do not step."""
    return any(limb.stands and limb.follow == "direction" for limb in puppet.limb)


def _leg(puppet: Puppet, side: str, *joints: str) -> Leg | None:
    """Return the bones that follow the directions of a performer's thigh and shin, and the bone after them."""
    found = chain_of(puppet, side, *joints)
    if found is None:
        return None
    thigh, last, _ = found
    return Leg(thigh, thigh + 1, thigh + 2 if last > thigh + 1 else -1, JOINT_INDEX[f"{joints[-1]}_{side}"])


def _pelvis_of(puppet: Puppet) -> int | None:
    """Return the first bone of the trunk if the trunk has several bones, else None."""
    bones = bone_ranges(puppet.limbs).get(TRUNK, range(0))
    return bones.start if len(bones) > 1 else None


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
    if not legs or puppet.root is None or puppet.root.feet == "free" or _is_on_all_fours(puppet):
        return None
    performer = _performers_legs(rest)
    basis = puppet.character.basis
    metre = puppet.units_per_metre or _leg_length(legs, bones, basis) / performer.leg
    forward = puppet.root.walk == "forward"
    return Steps(bones, legs, trunk, performer, metre, basis, goes_forward=forward)


def _legs_and_trunk(puppet: Puppet) -> tuple[list[StandingLeg], list[int]]:
    """Return the legs that stand, and the bones of the trunk."""
    legs, ranges = [], bone_ranges(puppet.limbs)
    arms = {side: {JOINT_INDEX[joint] for joint in LIMBS[f"{side} arm"]} for side in SIDES}
    for limb in parents_first(puppet.limbs):
        if limb.stands and limb.name != TRUNK:
            arm = next((side for side, joints in arms.items() if limb.joints[-1][0] in joints), None)
            hand, shoulder = (-1, -1) if arm is None else (limb.joints[-1][0], JOINT_INDEX[f"shoulder_{arm}"])
            legs.append(StandingLeg(tuple(ranges[limb.name]), hand, shoulder))
    return legs, list(ranges.get(TRUNK, ()))


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


def chain_of(puppet: Puppet, side: str, *joints: str) -> tuple[int, int, tuple[int, ...]] | None:
    """Find a limb that follows the directions between three joints of one side, which are given by name.

    Returns the bone between the first two joints, the limb's last bone, and the joints at its tip.
    """
    chain, ranges = tuple((JOINT_INDEX[f"{joint}_{side}"],) for joint in joints), bone_ranges(puppet.limbs)
    for limb in parents_first(puppet.limbs):
        for k, bone in enumerate(ranges[limb.name]):
            if limb.follow == "direction" and limb.joints[k : k + 3] == chain:
                return bone, ranges[limb.name][-1], limb.joints[-1]
    return None


def _root_scale(
    puppet: Puppet, mesh: SolverMesh, rest: NDArray[np.float64], legs: tuple[Leg, ...], bones: Bones
) -> float:
    """Return mesh units per metre of the root: the puppet's scale, or the ratio of character size to performer size.

    The size of a character whose feet are held is the length of its legs, which determines its steps; the size of any
    other is its height.
    """
    if puppet.units_per_metre is not None:
        return puppet.units_per_metre
    if legs:
        performers = body.bone_lengths(rest)
        length = np.mean([performers[f"{bone}_{side}"] for bone in ("knee", "ankle") for side in SIDES])
        return float(np.mean([bones.lengths[[leg.thigh, leg.shin]] for leg in legs]) / length)
    up = puppet.character.basis[1]
    return float(np.ptp(mesh.vertices @ up) / body.height(rest))
