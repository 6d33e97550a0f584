"""Proposal of joints that drive the limbs of a character."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from engine_bridge.puppet.puppet import CharacterTable, LimbTable
from solver.anatomy.limb_chain import LimbChain, Limbs

ARM, LEG = ("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot")
LIMB_JOINTS: dict[str, tuple[str, ...]] = {
    "arm": ARM,
    "leg": LEG,
    "front leg": ARM,
    "hind leg": LEG,
    "wing": ARM,
}
"""Joints that drive a limb of either side; arms drive front legs and wings."""

MIDDLE_JOINTS: dict[str, tuple[str | tuple[str, ...], ...]] = {
    "trunk": ("hip_center", "spine", "shoulder_center"),
    "neck": ("shoulder_center", ("shoulder_center", "head"), "head"),
    "head": ("shoulder_center", "head"),
    "tail": ("hip_center", "shoulder_center", ("shoulder_center", "head"), "head"),
}
"""Joints that drive a limb of the middle. A tail follows the head from its second bone on."""

LIMB_GAINS = {"neck": 0.5, "tail": -0.7, "left wing": 0.5, "right wing": 0.5}
"""Gains other than 1. A neck turns half as far as the head; a tail turns opposite to the head, and less. Wings that are
spread at rest would intersect the body if a raised arm moved them fully."""

DELAYS = {"tail": 0.25, "ear": 0.15}
"""Times, in seconds, by which the tips of limbs follow late."""

UPRIGHT_COSINE = np.cos(np.radians(40))
"""Cosine of the largest angle between up and the trunk, or the head, of an upright body."""

MAX_STUB_SHARE = 0.25
"""Maximum length of a stub of a leg, from hip to ankle, as a share of that from the hips to the crown. A stub that does
not point down turns as the performer's leg does: pointing it down would twist the body around it."""


def limb_tables(limbs: Limbs, character: CharacterTable) -> list[LimbTable]:
    """Choose the joints that drive each limb, and whether it follows their directions or their turns.

    Limbs of a person point in the directions of the performer's. Limbs of a body with another build turn by as much as
    the performer's: four legs, tails, necks and wings, and all limbs of a body that is not upright.

    Parameters
    ----------
    limbs : Limbs
    character : CharacterTable
        Gives the character's up and front.

    Returns
    -------
    list of LimbTable
        Empty for a character with a trunk and a head only.
    """
    points = limbs.points
    if not set(points) - {"trunk", "neck", "head"}:
        return []
    return [_limb(chain, _follow(chain.name, points, character.basis[1]), points) for chain in limbs.chains]


def _follow(name: str, points: Mapping[str, NDArray[np.float64]], up: NDArray[np.float64]) -> str:
    def is_upright(direction: NDArray[np.float64]) -> bool:
        return bool(direction @ up > UPRIGHT_COSINE * np.linalg.norm(direction))

    if not points.keys() >= {"trunk", "head", "left arm", "right arm", "left leg", "right leg"}:
        return "turn"
    trunk, head = (points[limb][-1] - points[limb][0] for limb in ("trunk", "head"))
    body = trunk if np.linalg.norm(trunk) > np.linalg.norm(head) else points["head"][-1] - points["trunk"][0]
    if not is_upright(body) or name in ("tail", "neck", "left wing", "right wing"):
        return "turn"
    if name.endswith("leg"):
        legs = np.mean([points[f"{side} leg"][0] - points[f"{side} leg"][2] for side in ("left", "right")], axis=0)
        size = np.linalg.norm(points["head"][-1] - points["trunk"][0])
        if np.linalg.norm(legs) < MAX_STUB_SHARE * size and not is_upright(legs):
            return "turn"
    return "turn" if name == "head" and not is_upright(head) else "direction"


def _limb(chain: LimbChain, follow: str, points: Mapping[str, NDArray[np.float64]]) -> LimbTable:
    side, _, limb = chain.name.partition(" ")
    joints = MIDDLE_JOINTS.get(chain.name) or tuple(f"{joint}_{side}" for joint in LIMB_JOINTS[limb])
    joints += joints[-1:] * (len(chain.points) - len(joints))  # a leg with more bends than the performer's
    size = max(float(np.ptp(np.concatenate(list(points.values())), axis=0).max()), 1e-12)
    table = {
        "name": chain.name,
        "points": [_rounded(point, size) for point in chain.points],
        "joints": joints,
        "follow": follow,
        "gain": LIMB_GAINS.get(chain.name, 1.0),
        "delay": DELAYS.get(limb or side, 0.0),
        "stands": limb.endswith("leg") and follow == "turn",
        "parent": "neck" if chain.name == "head" and "neck" in points else None,
    }
    return LimbTable.model_validate(table)


def _rounded(point: NDArray[np.float64], size: float) -> tuple[float, ...]:
    decimals = 5 - math.floor(math.log10(size))
    return tuple(round(float(value), decimals) for value in point)
