"""Body plans: how the limbs of a kind of body follow a performer."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from puppetline.errors import PuppetError

BodyPlan = Literal["upright", "two legs", "four legs", "many legs", "wings", "no legs"]

UPRIGHT_COSINE = np.cos(np.radians(40))
"""Cosine of the largest angle between up and the trunk, or the head, of an upright body."""

PERSON = {"trunk", "left arm", "right arm", "left leg", "right leg"}
"""Limbs of an upright body, which may have no head of its own."""


@dataclass(frozen=True)
class PlanSettings:
    """How the limbs of a kind of body follow a performer.

    Attributes
    ----------
    about : str
        A sentence for the user.
    points : bool
        Whether limbs point in the performer's directions; they turn by as much as the performer's otherwise.
    stands : bool
        Whether legs stand and step by themselves.
    gains : mapping of str
        Gains of limbs by their name without the side; others are 1.
    """

    about: str
    points: bool = False
    stands: bool = True
    gains: Mapping[str, float] = field(default_factory=dict)


TAIL_GAIN = -0.7
"""Gain of a tail: it turns, or its handle moves, opposite to the head, and less."""

_MIDDLE = {"neck": 0.5, "tail": TAIL_GAIN}
"""A neck turns half as far as the head."""

_TURNED = _MIDDLE | {"arm": 0.6}
"""Arms that do not point as the performer's begin elsewhere, and would fold the chest if they turned as far."""

PLANS: dict[BodyPlan, PlanSettings] = {
    "upright": PlanSettings("Two legs and an upright body: limbs point as the performer's do.", True, False, _MIDDLE),
    "two legs": PlanSettings(
        "Two legs under a lying body: legs step by themselves, arms and head follow.", gains=_TURNED
    ),
    "four legs": PlanSettings("Four legs: they step by themselves, and a raised arm lifts a front leg.", gains=_TURNED),
    "many legs": PlanSettings(
        "Six legs or more: they step by themselves, and raised arms lift the first pair.", gains=_TURNED
    ),
    "wings": PlanSettings(
        "Wings beside legs: arms beat the wings, and legs step by themselves.", gains=_TURNED | {"wing": 0.5}
    ),
    "no legs": PlanSettings("No legs: the body glides and turns with the performer.", stands=False, gains=_TURNED),
}
"""Wings that are spread at rest would intersect the body if a raised arm moved them fully."""


def plan_of(points: Mapping[str, NDArray[np.float64]], up: NDArray[np.float64]) -> BodyPlan:
    """Choose the plan of a body.

    Parameters
    ----------
    points : mapping of str to (k, 3) float64
        Points of its limbs, by name.
    up : (3,) float64
    """
    legs = [name for name in points if is_leg(name)]
    if not legs:
        return "no legs"
    if is_person(points, up):
        return "upright"
    if "left wing" in points or "right wing" in points:
        return "wings"
    return "two legs" if len(legs) <= 2 else "four legs" if len(legs) <= 4 else "many legs"


def is_leg(name: str) -> bool:
    """Return whether a limb is a leg, by its name."""
    return "leg" in name.split()


def is_person(points: Mapping[str, NDArray[np.float64]], up: NDArray[np.float64]) -> bool:
    """Return whether a body has the limbs of a person, and is upright."""
    if not points.keys() >= PERSON:
        return False
    trunk, head = (points[limb][-1] - points[limb][0] for limb in ("trunk", "head" if "head" in points else "trunk"))
    body = trunk if np.linalg.norm(trunk) >= np.linalg.norm(head) else points["head"][-1] - points["trunk"][0]
    return is_upright(body, up)


def is_upright(direction: NDArray[np.float64], up: NDArray[np.float64]) -> bool:
    """Return whether a direction is that of an upright body."""
    return bool(direction @ up > UPRIGHT_COSINE * np.linalg.norm(direction))


def fits(plan: BodyPlan, limbs: Collection[str]) -> bool:
    """Return whether a body has the limbs that a plan needs."""
    return plan == "no legs" or (set(limbs) >= PERSON if plan == "upright" else any(is_leg(name) for name in limbs))


def check_plan(plan: BodyPlan, limbs: Collection[str], where: str, fix: str) -> None:
    """Refuse a plan for a body without the limbs that it needs.

    Raises
    ------
    PuppetError
    """
    if plan not in PLANS:
        raise PuppetError(where, found=repr(plan), expected=f"one of {', '.join(PLANS)}", fix="Correct the name.")
    if not fits(plan, limbs):
        raise PuppetError(
            where,
            found=f"a character with these limbs: {', '.join(limbs) or 'none'}",
            expected="trunk, arms and legs" if plan == "upright" else "at least one leg",
            fix=fix,
        )
