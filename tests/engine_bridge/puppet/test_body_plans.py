import numpy as np
import pytest

from engine_bridge.puppet.body_plans import plan_of
from engine_bridge.puppet.limb_proposal import limb_tables
from engine_bridge.puppet.puppet import CharacterTable
from solver.anatomy.limb_chain import LimbChain, Limbs

from ..bones import points

UP = np.array([0, 1.0, 0])


def legs(*names, count=4):
    way = np.linspace([0.1, 0.6, 0], [0.1, 0, 0], count)
    return {f"{side} {name}": way * [sign, 1, 1] + [0, 0, 0.1 * k] for k, name in enumerate(names)
            for side, sign in (("left", 1), ("right", -1))}  # fmt: skip


LYING = {"trunk": points("0 0.6 -0.5, 0 0.6 0, 0 0.6 0.5"), "head": points("0 0.6 0.5, 0 0.8 0.9")}
ARMS = {f"{side} arm": points(f"{x} 1.4 0, {x} 1.1 0, {x} 0.8 0, {x} 0.7 0")
        for side, x in (("left", 0.2), ("right", -0.2))}  # fmt: skip
STANDING = {"trunk": points("0 0.8 0, 0 1.1 0, 0 1.4 0"), "head": points("0 1.5 0, 0 1.8 0")}


@pytest.mark.parametrize(
    ("limbs", "plan"),
    [
        (STANDING | ARMS | legs("leg"), "upright"),
        ({"trunk": STANDING["trunk"]} | ARMS | legs("leg"), "upright"),
        (LYING | ARMS | legs("leg"), "two legs"),
        (LYING | legs("hind leg", "front leg"), "four legs"),
        (LYING | legs("leg 3", "leg 2", "leg 1"), "many legs"),
        (LYING | legs("hind leg", "front leg") | {"left wing": points("0 1 0, 1 1 0")}, "wings"),
        (LYING | {"tail": points("0 0.6 -0.5, 0 0.6 -1")}, "no legs"),
    ],
)
def test_the_plan_of_a_body_follows_from_its_limbs(limbs, plan):
    assert plan_of(limbs, UP) == plan


def tables(limbs):
    found = limb_tables(Limbs(tuple(LimbChain(name, each) for name, each in limbs.items())), CharacterTable(mesh="a"))
    return {table.name: table for table in found}


def test_a_leg_with_more_bends_than_the_performers_repeats_the_last_joint_and_rows_follow_arms_and_legs_by_turns():
    found = tables(LYING | legs("leg 3", "leg 2", "leg 1", count=6))
    first = [found[f"right leg {row}"].joints[0] for row in (1, 2, 3)]
    assert first == ["shoulder_right", "hip_right", "shoulder_right"]
    assert found["left leg 2"].joints == ("hip_left", "knee_left", "ankle_left", *["foot_left"] * 3)
