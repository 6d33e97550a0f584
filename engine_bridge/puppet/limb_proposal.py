"""Proposal of joints that drive a character's limbs by its body plan, or handles at their ends, and of another plan."""

import math
import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from engine_bridge.puppet.body_plans import (
    PLANS,
    TAIL_GAIN,
    BodyPlan,
    PlanSettings,
    check_plan,
    fits,
    is_leg,
    is_upright,
    plan_of,
)
from engine_bridge.puppet.puppet import BendTable, CharacterTable, HandleTable, LimbTable, Puppet
from solver.anatomy.limb_chain import LimbChain, Limbs
from solver.surface.mesh import SolverMesh

ARM, LEG = ("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot")
PERFORMER_JOINTS: dict[str, tuple[str, ...]] = {"arm": ARM, "leg": LEG, "front leg": ARM, "hind leg": LEG, "wing": ARM}
"""Joints that drive a limb of either side; arms drive front legs and wings."""

MIDDLE_JOINTS: dict[str, tuple[str | tuple[str, ...], ...]] = {
    "trunk": ("hip_center", "spine", "shoulder_center"),
    "neck": ("shoulder_center", ("shoulder_center", "head"), "head"),
    "head": ("shoulder_center", "head"),
    "tail": ("hip_center", "shoulder_center", ("shoulder_center", "head"), "head"),
    "jaw": ("shoulder_center", "head"),
    "left ear": ("shoulder_center", ("shoulder_center", "head"), "head"),
    "right ear": ("shoulder_center", ("shoulder_center", "head"), "head"),
}
"""Joints that drive a limb of the middle. A tail follows the head from its second bone on. Ears and jaw turn with the
head."""

ON_HEAD = ("jaw", "left ear", "right ear")
"""Limbs whose parent is the head. They cannot turn with a head that points as the performer's does."""

DELAYS = {"tail": 0.25, "ear": 0.15}
"""Times, in seconds, by which the tips of limbs follow late."""

JAW_DEGREES = 20.0
"""Angle by which the voice opens a jaw."""

MAX_STUB_SHARE = 0.25
"""Maximum length of a stub of a leg, from hip to ankle, as a share of that from the hips to the crown. A stub that does
not point down turns as the performer's leg does: pointing it down would twist the body around it."""

STRAIGHT_HEAD_COSINE = math.cos(math.radians(13))
"""Cosine of the largest angle between up and a head that points as the performer's does. Hair and hats move the end of
other heads: pointing them up would make the character look at the floor."""

MIN_BONE_SHARE = 1e-4
"""Minimum length of a bone, as a share of the longest in its limb; joints of a skeleton may be at the same place."""


def limb_tables(limbs: Limbs, character: CharacterTable, plan: BodyPlan | None = None) -> list[LimbTable]:
    """Choose the joints that drive each limb, and whether it follows their directions or their turns.

    Parameters
    ----------
    limbs : Limbs
    character : CharacterTable
        Gives the character's up and front.
    plan : BodyPlan or None
        None to choose it from the limbs.

    Returns
    -------
    list of LimbTable
        Empty for a character with a trunk and a head only. Without limbs whose points are all at the same place.
    """
    limbs = Limbs(tuple(chain for chain in map(_distinct, limbs.chains) if len(chain.points) > 1 + is_leg(chain.name)))
    points, up = limbs.points, character.basis[1]
    if not set(points) - {"trunk", "neck", "head"}:
        return []
    chosen = PLANS[plan or plan_of(points, up)]
    still = ON_HEAD if "head" not in points or _points(chosen, "head", points, up) else ()
    tables = [_limb(chain, chosen, points, up) for chain in limbs.chains if chain.name not in still]
    return [_opened(table, character) if table.name == "jaw" else table for table in tables]


def _distinct(chain: LimbChain) -> LimbChain:
    """Return a limb without points that repeat the one before."""
    lengths = np.linalg.norm(np.diff(chain.points, axis=0), axis=1)
    return replace(chain, points=chain.points[np.append(True, lengths > MIN_BONE_SHARE * lengths.max())])


def _opened(jaw: LimbTable, character: CharacterTable) -> LimbTable:
    """Return a jaw that the voice opens: its tip turns down about the axis to the character's left."""
    left = character.basis[0]
    number = int(np.abs(left).argmax())
    bend = BendTable.model_validate(
        {"channel": "voice", "degrees": JAW_DEGREES, "axis": ("" if left[number] > 0 else "-") + "xyz"[number]}
    )
    return jaw.model_copy(update={"bend": bend})


def _points(plan: PlanSettings, name: str, points: Mapping[str, NDArray[np.float64]], up: NDArray[np.float64]) -> bool:
    """Return whether a limb points as the performer's does."""
    if not plan.points or {"tail", "neck", "wing"} & set(name.split()):
        return False
    if is_leg(name):
        legs = np.mean([points[f"{side} leg"][0] - points[f"{side} leg"][2] for side in ("left", "right")], axis=0)
        size = np.linalg.norm(points["head" if "head" in points else "trunk"][-1] - points["trunk"][0])
        return bool(np.linalg.norm(legs) >= MAX_STUB_SHARE * size or is_upright(legs, up))
    way = points[name][-1] - points[name][0]
    return name != "head" or bool(way @ up > STRAIGHT_HEAD_COSINE * np.linalg.norm(way))


def _limb(
    chain: LimbChain, plan: PlanSettings, points: Mapping[str, NDArray[np.float64]], up: NDArray[np.float64]
) -> LimbTable:
    side, _, limb = chain.name.partition(" ")
    joints, count = _joints(chain.name), len(chain.points)
    joints += joints[-1:] * (count - len(joints))  # a leg with more bends than the performer's
    # a trunk or a neck ends where the performer's does, with any number of bones
    joints = joints[: count - 1] + joints[-1 if chain.name in ("trunk", "neck") else count - 1 :][:1]
    size = max(float(np.ptp(np.concatenate(list(points.values())), axis=0).max()), 1e-12)
    table = {
        "name": chain.name,
        "nodes": chain.nodes or None,
        "points": [_rounded(point, size) for point in chain.points],
        "joints": joints,
        "follow": "direction" if _points(plan, chain.name, points, up) else "turn",
        "gain": plan.gains.get(_without_number(limb or side), 1.0),
        "delay": DELAYS.get(_without_number(limb or side), 0.0),
        "stands": plan.stands and is_leg(chain.name),
        "parent": "head" if chain.name in ON_HEAD else "neck" if chain.name == "head" and "neck" in points else None,
    }
    return LimbTable.model_validate(table)


def _joints(name: str) -> tuple[str | tuple[str, ...], ...]:
    """Return the joints that drive a limb; a leg in the middle follows the means of both sides."""
    if name in MIDDLE_JOINTS:
        return MIDDLE_JOINTS[name]
    side, _, limb = name.partition(" ")
    if side in ("left", "right"):
        return tuple(f"{joint}_{side}" for joint in _limb_joints(limb))
    return tuple((f"{joint}_left", f"{joint}_right") for joint in _limb_joints(name))


def _limb_joints(limb: str) -> tuple[str, ...]:
    """Return the joints that drive a limb of either side; odd rows of legs follow arms, other legs legs."""
    kind = _without_number(limb)
    row = limb.removeprefix(kind)
    return (LEG, ARM)[int(row) % 2] if row and kind == "leg" else PERFORMER_JOINTS.get(kind, LEG)


def _without_number(limb: str) -> str:
    """Return a limb's name without the number of its pair: "arm" for "arm 2"."""
    return re.sub(r" \d+$", "", limb)


def _rounded(point: NDArray[np.float64], size: float) -> tuple[float, ...]:
    decimals = 5 - math.floor(math.log10(size))
    return tuple(round(float(value), decimals) for value in point)


def end_handles(limbs: Limbs, mesh: SolverMesh, character: CharacterTable) -> list[HandleTable]:
    """Put handles on the vertices nearest to the ends of limbs, and on a shape without limbs.

    Trunk, neck, ears and jaw get none. A handle follows the last joint that drives the limb; that of a wing follows the
    elbow. A shape without limbs gets hands at its sides. One without feet gets a handle that stays in place below, and
    one on four legs without a tail gets it behind.

    Parameters
    ----------
    limbs : Limbs
        With a head at least.
    mesh : SolverMesh
    character : CharacterTable
        Gives the character's up and front.
    """
    middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
    left, up, front = ((mesh.vertices - middle) @ character.basis.T).T
    ends = {chain.name: chain.points[-1] for chain in limbs.chains if chain.name not in ("trunk", "neck", *ON_HEAD)}
    chosen: dict[str, tuple[str | tuple[str, ...] | None, NDArray[np.float64]]] = {
        limb.replace("arm", "hand").replace("leg", "foot"): (
            _joints(limb)[1 if "wing" in limb else -1],
            np.linalg.norm(mesh.vertices - end, axis=1),
        )
        for limb, end in ends.items()
    }
    legs = [limb for limb in ends if is_leg(limb)]
    if not ends.keys() - {"head"}:
        chosen["left hand"] = "hand_left", np.abs(up) + np.abs(front) - left
        chosen["right hand"] = "hand_right", np.abs(up) + np.abs(front) + left
    if not legs:
        chosen["base"] = None, up + np.hypot(left, front)
    elif len(legs) > 2 and "tail" not in ends:
        chosen["rump"] = None, front + np.abs(left)
    handles: dict[int, HandleTable] = {}  # by vertex: ends on a coarse mesh may be at the same one
    for name, (joint, distance) in chosen.items():
        place = _rounded(mesh.vertices[distance.argmin()], mesh.diagonal)
        values: dict[str, object] = {"name": name, "position": place}
        values |= {"joints" if isinstance(joint, tuple) else "joint": joint}
        values |= {"gain": TAIL_GAIN} if name == "tail" else {}
        handles.setdefault(int(distance.argmin()), HandleTable.model_validate(values))
    return list(handles.values())


PLANNED = ("joints", "follow", "gain", "delay", "stands")
"""Keys of a limb that a body plan determines."""


def with_plan(puppet: Puppet, plan: BodyPlan) -> Puppet:
    """Return a puppet whose limbs follow the performer as a body plan says.

    Names, points and parents of limbs are kept, and so are limbs whose names no plan knows, handles and settings.

    Raises
    ------
    PuppetError
        The body lacks the limbs that the plan needs.
    """
    names = [limb.name for limb in puppet.limb]
    check_plan(plan, names, f"the body plan {plan!r}", "Choose another plan, or add the missing limbs.")
    chains = tuple(LimbChain(limb.name, np.array(limb.points)) for limb in puppet.limb if _is_known(limb.name))
    planned = {table.name: table for table in limb_tables(Limbs(chains), puppet.character, plan)}
    limbs = tuple(
        limb.model_copy(update={key: getattr(planned[limb.name], key) for key in PLANNED})
        if limb.name in planned
        else limb
        for limb in puppet.limb
    )
    return puppet.model_copy(update={"limb": limbs})


def _is_known(name: str) -> bool:
    return name in MIDDLE_JOINTS or _without_number(name.partition(" ")[2]) in PERFORMER_JOINTS or is_leg(name)


def plan_in(puppet: Puppet) -> BodyPlan | None:
    """Return the body plan that the limbs of a puppet follow; None if they follow none, or there are no limbs."""
    names = [limb.name for limb in puppet.limb]
    return next(
        (plan for plan in PLANS if names and fits(plan, names) and with_plan(puppet, plan).limb == puppet.limb), None
    )
