"""Another body plan for the limbs of an existing puppet."""

import numpy as np

from engine_bridge.puppet.body_plans import PLANS, BodyPlan, fits, is_leg
from engine_bridge.puppet.limb_proposal import LIMB_JOINTS, MIDDLE_JOINTS, limb_tables
from engine_bridge.puppet.puppet import Puppet
from puppetline.errors import PuppetError
from solver.anatomy.limb_chain import LimbChain, Limbs

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
    if not fits(plan, names):
        raise PuppetError(
            f"the body plan {plan!r}",
            found=f"a character with these limbs: {', '.join(names) or 'none'}",
            expected="trunk, head, arms and legs" if plan == "upright" else "at least one leg",
            fix="Choose another plan, or add the missing limbs.",
        )
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
    return name in MIDDLE_JOINTS or name.partition(" ")[2] in LIMB_JOINTS or is_leg(name)


def plan_in(puppet: Puppet) -> BodyPlan | None:
    """Return the body plan that the limbs of a puppet follow; None if they follow none, or there are no limbs."""
    names = [limb.name for limb in puppet.limb]
    return next(
        (plan for plan in PLANS if names and fits(plan, names) and with_plan(puppet, plan).limb == puppet.limb), None
    )
