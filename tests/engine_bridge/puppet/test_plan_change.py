import pytest

from engine_bridge.puppet.limb_proposal import limb_tables
from engine_bridge.puppet.plan_change import plan_in, with_plan
from engine_bridge.puppet.puppet import CharacterTable, HandleTable, LimbTable, Puppet
from puppetline.errors import PuppetError

from .test_limb_proposal import UPRIGHT, chains

CHARACTER = CharacterTable(mesh="a.glb")


def puppet_with(plan, *more):
    handle = HandleTable(name="hat", position=(0, 2, 0), joint="head")
    return Puppet(character=CHARACTER, limb=(*limb_tables(chains(**UPRIGHT), CHARACTER, plan), *more), handle=(handle,))


def test_another_plan_gives_the_limbs_that_a_new_puppet_would_have():
    upright, walking = puppet_with("upright"), puppet_with("two legs")

    assert with_plan(upright, "two legs") == walking
    assert with_plan(walking, "upright") == upright
    assert (plan_in(upright), plan_in(walking)) == ("upright", "two legs")


def test_points_that_the_user_moved_and_unknown_limbs_are_kept():
    claw = LimbTable(name="claw", points=((0, 1, 0), (0, 1, 1)), joints=("elbow_left", "hand_left"), gain=2.0)
    puppet = puppet_with("upright", claw)
    moved = puppet.limb[0].model_copy(update={"points": ((0, 0.9, 0), (0, 1.2, 0), (0, 1.4, 0))})

    changed = with_plan(puppet.model_copy(update={"limb": (moved, *puppet.limb[1:])}), "no legs")

    assert changed.limb[0].points == moved.points
    assert changed.limb[-1] == claw
    assert not any(limb.stands for limb in changed.limb)


def test_own_settings_are_no_plan():
    puppet = puppet_with("upright")
    own = puppet.limb[2].model_copy(update={"gain": 0.3})

    assert plan_in(puppet.model_copy(update={"limb": (*puppet.limb[:2], own, *puppet.limb[3:])})) is None


def test_a_plan_without_its_limbs_is_refused():
    puppet = puppet_with("no legs")
    legless = puppet.model_copy(update={"limb": tuple(limb for limb in puppet.limb if "leg" not in limb.name)})

    with pytest.raises(PuppetError) as error:
        with_plan(legless, "four legs")

    assert str(error.value) == (
        "the body plan 'four legs': found a character with these limbs: trunk, head, left arm, right arm; "
        "expected at least one leg. Choose another plan, or add the missing limbs."
    )
