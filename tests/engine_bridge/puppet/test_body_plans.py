import numpy as np
import pytest

from engine_bridge.puppet.body_plans import PLANS, fits, plan_of
from engine_bridge.puppet.limb_proposal import limb_tables
from engine_bridge.puppet.puppet import CharacterTable
from solver.anatomy.limb_chain import LimbChain, Limbs

UP = np.array([0, 1.0, 0])
CHARACTER = CharacterTable(mesh="any.glb")


def chain(*points):
    return np.array(points, dtype=float)


def legs(*names, points=4):
    way = np.linspace([0.1, 0.6, 0], [0.1, 0, 0], points)
    return {f"{side} {name}": way * [sign, 1, 1] + [0, 0, 0.1 * k] for k, name in enumerate(names)
            for side, sign in (("left", 1), ("right", -1))}  # fmt: skip


LYING = {"trunk": chain([0, 0.6, -0.5], [0, 0.6, 0], [0, 0.6, 0.5]), "head": chain([0, 0.6, 0.5], [0, 0.8, 0.9])}
ARMS = {f"{side} arm": chain([x, 1.4, 0], [x, 1.1, 0], [x, 0.8, 0], [x, 0.7, 0])
        for side, x in (("left", 0.2), ("right", -0.2))}  # fmt: skip
STANDING = {"trunk": chain([0, 0.8, 0], [0, 1.1, 0], [0, 1.4, 0]), "head": chain([0, 1.5, 0], [0, 1.8, 0])}


@pytest.mark.parametrize(
    ("points", "plan"),
    [
        (STANDING | ARMS | legs("leg"), "upright"),
        (LYING | ARMS | legs("leg"), "two legs"),
        (LYING | legs("hind leg", "front leg"), "four legs"),
        (LYING | legs("leg 3", "leg 2", "leg 1"), "many legs"),
        (LYING | legs("hind leg", "front leg") | {"left wing": chain([0, 1, 0], [1, 1, 0])}, "wings"),
        (LYING | {"tail": chain([0, 0.6, -0.5], [0, 0.6, -1])}, "no legs"),
    ],
)
def test_the_plan_of_a_body_follows_from_its_limbs(points, plan):
    assert plan_of(points, UP) == plan


def tables(points, plan=None):
    found = limb_tables(Limbs(tuple(LimbChain(name, each) for name, each in points.items())), CHARACTER, plan)
    return {table.name: table for table in found}


def test_legs_of_animals_stand_and_those_of_people_point_as_the_performers():
    animal, person = tables(LYING | legs("hind leg", "front leg")), tables(STANDING | ARMS | legs("leg"))

    assert {name for name, table in animal.items() if table.stands} == legs("hind leg", "front leg").keys()
    assert all(table.follow == "turn" for table in animal.values())
    assert not any(table.stands for table in person.values())
    assert all(table.follow == "direction" for table in person.values())


def test_a_chosen_plan_makes_the_legs_of_a_person_step_by_themselves():
    found = tables(STANDING | ARMS | legs("leg"), "two legs")

    assert found["left leg"].stands
    assert found["left arm"].follow == "turn"


def test_a_leg_with_more_bends_than_the_performers_repeats_the_last_joint():
    leg = tables(LYING | legs("hind leg", "front leg", points=6))["left hind leg"]

    assert leg.joints == ("hip_left", "knee_left", "ankle_left", "foot_left", "foot_left", "foot_left")


def test_the_first_of_many_legs_follow_the_arms_and_every_second_row_the_legs():
    found = tables(LYING | legs("leg 3", "leg 2", "leg 1"))

    assert [found[f"right leg {row}"].joints[0] for row in (1, 2, 3)] == [
        "shoulder_right",
        "hip_right",
        "shoulder_right",
    ]


def test_tails_follow_late():
    tail = tables(LYING | legs("hind leg", "front leg") | {"tail": np.linspace([0, 0.6, -0.5], [0, 0.6, -1], 4)})[
        "tail"
    ]

    assert (tail.delay, tail.gain) == (0.25, -0.7)


def test_a_plan_fits_a_body_that_has_its_limbs():
    assert fits("four legs", legs("hind leg", "front leg"))
    assert not fits("upright", LYING | legs("hind leg", "front leg"))
    assert not fits("two legs", LYING)
    assert all(fits("no legs", points) for points in (LYING, STANDING))


def test_each_plan_says_in_a_sentence_what_it_does():
    assert all(plan.about.endswith(".") for plan in PLANS.values())
