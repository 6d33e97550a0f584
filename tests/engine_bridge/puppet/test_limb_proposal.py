from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.puppet.limb_proposal import end_handles, limb_tables, plan_in, with_plan
from engine_bridge.puppet.puppet import CharacterTable, HandleTable, LimbTable, Puppet
from puppetline.errors import PuppetError
from solver.anatomy.limb_chain import LimbChain, Limbs
from solver.surface.mesh import SolverMesh

from ..bones import points
from ..refusals import refused
from .test_proposal import ARM, LEG, PERSON

CHARACTER = CharacterTable(mesh="a.glb")


def chains(**named):
    """Return limbs by their names, with "_" for spaces; points are a text or coordinates."""
    places = {name: points(each) if isinstance(each, str) else np.array(each, float) for name, each in named.items()}
    return Limbs(tuple(LimbChain(name.replace("_", " "), each) for name, each in places.items()))


def tables_of(character=CHARACTER, **named):
    """Return the tables of limbs, given as for `chains`, by their names."""
    return {limb.name: limb for limb in limb_tables(chains(**named), character)}


UPRIGHT = {
    "trunk": "0 1 0, 0 1.2 0, 0 1.4 0",
    "head": "0 1.4 0, 0 1.7 0",
    "left_arm": "0.2 1.4 0, 0.5 1.4 0, 0.8 1.4 0, 0.9 1.4 0",
    "right_arm": "-0.2 1.4 0, -0.5 1.4 0, -0.8 1.4 0, -0.9 1.4 0",
    "left_leg": "0.1 1 0, 0.1 0.5 0, 0.1 0.1 0, 0.1 0 0.2",
    "right_leg": "-0.1 1 0, -0.1 0.5 0, -0.1 0.1 0, -0.1 0 0.2",
}


def test_joints_at_the_same_place_are_one_point_and_a_limb_at_one_place_is_none():
    together = {"trunk": "0 1 0, 0 1.4 0, 0 1.4 0", "head": "0 1.4 0, 0 1.4 0"}
    tables = tables_of(**UPRIGHT | together)
    assert tables.keys() == PERSON.keys() - {"head"}
    assert tables["trunk"].points == ((0, 1, 0), (0, 1.4, 0))
    assert tables["trunk"].driven_by == (("hip_center",), ("shoulder_center",))


def test_the_voice_opens_a_jaw_downwards():
    """An animal that looks along -x has a jaw whose tip turns down, which is -z."""
    turned = {
        name: [(-z, x, y) for x, y, z in points(text)]
        for name, text in (UPRIGHT | {"head": "0 1.4 0, 0 1.5 0.3", "jaw": "0 1.45 0.1, 0 1.45 0.3"}).items()
    }
    tables = tables_of(CharacterTable(mesh="a", up="z", front="-x"), **turned)
    jaw = tables.pop("jaw")
    assert (jaw.bend.channel, jaw.bend.degrees) == ("voice", 20)
    tip = np.subtract(jaw.points[1], jaw.points[0])
    assert Rotation.from_rotvec(jaw.bend.turn).apply(tip) @ [0, 0, 1] < -0.05
    assert all(limb.bend is None for limb in tables.values())


def stubs(shin):
    """Two straight legs, mirrored, with a vector from hip to ankle."""
    side, down, front = shin
    return {
        f"{name}_leg": [(sign * (0.1 + share * side), 1 + share * down, share * front) for share in (0, 0.5, 1, 1.2)]
        for name, sign in (("left", 1), ("right", -1))
    }


@pytest.mark.parametrize(
    ("changed", "turning"),
    [
        ({"trunk": "0 1 -1, 0 1.1 -0.5, 0 1.2 0"}, set(PERSON)),
        ({"head": "0 1.4 0, 0 1.5 0.3"}, {"head"}),
        ({"head": "0 1.4 0, 0 1.7 -0.08"}, {"head"}),
        ({"head": "0 1.4 0, 0 1.7 0.05"}, set()),
        ({"left_leg": "0.1 1 0, 0.1 0.6 0.5, 0.1 0.1 0, 0.1 0 0.2"}, set()),
        (stubs((0.1, -0.05, 0.1)), {"left leg", "right leg"}),
        (stubs((0.0, -0.15, 0.0)), set()),
        (stubs((0.1, -0.4, 0.5)), set()),
    ],
    ids=["lying", "looking forward", "ponytail", "chin", "crouching", "stubs forward", "stubs down", "sitting"],
)
def test_limbs_that_point_unlike_the_performers_follow_by_turn(changed, turning):
    assert {name for name, limb in tables_of(**UPRIGHT | changed).items() if limb.follow == "turn"} == turning


def test_arms_drive_front_legs_and_wings_and_the_head_drives_neck_and_tail():
    leg = points("0.2 1 0, 0.2 0.5 0, 0.2 0.1 0, 0.2 0 0.1")
    tables = tables_of(
        trunk="0 1 -1, 0 1 0, 0 1 1",
        neck="0 1 1, 0 1.2 1.2, 0 1.4 1.4",
        head="0 1.4 1.4, 0 1.4 1.8",
        left_front_leg=np.add(leg, (0, 0, 1)),
        left_hind_leg=np.add(leg, (0, 0, -1)),
        left_wing="0.2 1.2 0, 0.5 1.5 0, 0.8 1.8 0, 1 2 0",
        left_ear=[(0.1, y, 1.5) for y in (1.5, 1.6, 1.7)],
        tail="0 1 -1, 0 1 -1.2, 0 1 -1.4, 0 1 -1.6",
    )
    assert {limb.follow for limb in tables.values()} == {"turn"}
    assert tables["left front leg"].driven_by == tables["left wing"].driven_by == ARM
    assert tables["left hind leg"].driven_by == LEG
    gains = {name: limb.gain for name, limb in tables.items() if limb.gain != 1}
    assert gains == {"neck": 0.5, "tail": -0.7, "left wing": 0.5}
    assert {name: limb.parent for name, limb in tables.items() if limb.parent} == {"head": "neck", "left ear": "head"}
    assert {name for name, limb in tables.items() if limb.delay} == {"left ear", "tail"}
    assert {name for name, limb in tables.items() if limb.stands} == {"left front leg", "left hind leg"}
    assert tables["neck"].driven_by == (("shoulder_center",), ("shoulder_center", "head"), ("head",))
    assert tables["tail"].driven_by == (("hip_center",), ("shoulder_center",), ("shoulder_center", "head"), ("head",))


def test_a_trunk_and_a_head_alone_are_no_limbs_and_an_ear_on_a_head_that_points_is_none():
    assert tables_of(trunk=UPRIGHT["trunk"], head=UPRIGHT["head"]) == {}
    assert "left ear" not in tables_of(**UPRIGHT, left_ear=[(0.1, y, 0) for y in (1.7, 1.8, 1.9)])


def test_a_leg_in_the_middle_follows_both_legs_of_the_performer():
    body = {"trunk": "0 1 -1, 0 1 0, 0 1 1", "head": "0 1 1, 0 1.4 1.5"}
    table = tables_of(**body, hind_leg=UPRIGHT["left_leg"])["hind leg"]
    assert table.stands
    assert table.driven_by == tuple((f"{joint}_left", f"{joint}_right") for joint in ("hip", "knee", "ankle", "foot"))


def test_a_leg_with_more_bends_than_the_performers_repeats_the_last_joint_and_rows_follow_arms_and_legs_by_turns():
    leg = np.linspace((0.1, 0.6, 0), (0.1, 0, 0), 6)
    tables = tables_of(trunk=UPRIGHT["trunk"], **{f"right_leg_{row}": leg for row in (1, 2, 3)})
    first = [tables[f"right leg {row}"].joints[0] for row in (1, 2, 3)]
    assert first == ["shoulder_right", "hip_right", "shoulder_right"]
    assert tables["right leg 2"].joints == ("hip_right", "knee_right", "ankle_right", *["foot_right"] * 3)


def puppet_with(plan, *more):
    handle = HandleTable(name="hat", position=(0, 2, 0), joint="head")
    return Puppet(character=CHARACTER, limb=(*limb_tables(chains(**UPRIGHT), CHARACTER, plan), *more), handle=(handle,))


def test_another_plan_gives_the_limbs_that_a_new_puppet_would_have():
    upright, walking = puppet_with("upright"), puppet_with("two legs")

    assert with_plan(upright, "two legs") == walking
    assert with_plan(walking, "upright") == upright
    assert (plan_in(upright), plan_in(walking)) == ("upright", "two legs")


def test_points_that_the_user_moved_and_unknown_limbs_are_kept_and_own_settings_are_no_plan():
    claw = LimbTable(name="claw", points=((0, 1, 0), (0, 1, 1)), joints=("elbow_left", "hand_left"), gain=2.0)
    puppet = puppet_with("upright", claw)
    moved = puppet.limb[0].model_copy(update={"points": ((0, 0.9, 0), (0, 1.2, 0), (0, 1.4, 0))})
    changed = with_plan(puppet.model_copy(update={"limb": (moved, *puppet.limb[1:])}), "no legs")
    assert changed.limb[0].points == moved.points
    assert changed.limb[-1] == claw
    assert not any(limb.stands for limb in changed.limb)
    own = moved.model_copy(update={"gain": 0.3})
    assert plan_in(puppet.model_copy(update={"limb": (own, *puppet.limb[1:])})) is None


def test_a_plan_without_its_limbs_is_refused():
    puppet = puppet_with("no legs")
    legless = puppet.model_copy(update={"limb": tuple(limb for limb in puppet.limb if "leg" not in limb.name)})
    refused(PuppetError, with_plan, legless, "four legs")


LATTICE = np.array(list(product((-2, -1, 0, 1, 2), repeat=3)), dtype=np.float64)
TRUNK_AND_HEAD = {"trunk": "0 0 0, 0 1 0", "neck": "0 1 0, 0 1.5 0", "head": "0 1.5 0, 0.1 1.9 0.8"}
HANDLES = """
head             0  2  1   head
left hand        2  0  0   hand_left
left front foot  1 -2  2   hand_left
right hind foot -1 -2 -2   foot_right
foot             0 -2  0   foot_left,foot_right
right foot 2    -1 -2  0   foot_right
left wing        2  2  0   elbow_left
tail             0  0 -2   head
base             0 -2  0   -
rump             0 -2 -2   -
right hand      -2  0  0   hand_right
"""
ROWS = {row[:15].strip(): row[15:].split() for row in HANDLES.strip().splitlines()}


@pytest.mark.parametrize(
    ("limbs", "names"),
    [
        ({}, "head, left hand, right hand, base"),
        ({"left arm": "left hand"}, "head, left hand, base"),
        ({"left wing": "left wing", "tail": "tail", "left leg": "head", "jaw": "tail"}, "head, left wing, tail"),
        (
            {"left front leg": "left front foot", "right hind leg": "right hind foot", "leg": "foot"},
            "head, left front foot, right hind foot, foot, rump",
        ),
        ({"right leg 2": "right foot 2"}, "head, right foot 2"),
    ],
)
@pytest.mark.parametrize("turned", [False, True])
def test_handles_are_at_the_ends_of_limbs_and_hold_what_has_none(limbs, names, turned):
    """Each limb ends a little beside the place of a handle; a leg that ends where the head does has no handle."""
    character = CharacterTable(mesh="a", up="z", front="-x") if turned else CHARACTER
    at = {name: np.array(place, float) for name, (*place, _) in ROWS.items()}
    made = {name: points(text) for name, text in TRUNK_AND_HEAD.items()}
    made |= {name: np.outer([0.5, 1.05], at[end]) for name, end in limbs.items()}
    given = chains(**{name: each @ character.basis for name, each in made.items()})
    mesh = SolverMesh(LATTICE @ character.basis, np.zeros((0, 3), int), np.arange(len(LATTICE)))
    found = {handle.name: handle for handle in end_handles(given, mesh, character)}
    assert list(found) == names.split(", ")
    for name, handle in found.items():
        assert (np.array(handle.position) == at[name] @ character.basis).all()
        assert ",".join(handle.driven_by) or ROWS[name][-1] == "-"
        assert handle.gain == (-0.7 if name == "tail" else 1)
