"""Where the limbs of a skeleton begin and end, for bodies of any kind."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_equal

from engine_bridge.puppet.rig_limbs import limbs_of_joints

from .skeletons import FRONT, UP, assert_stands, joints_at, points_of

FISH = """
Tail   -      0   0  -2     0.4 0 -1.2  -0.4 0 -1.2  0.4 0 -3  -0.4 0 -3
Spine  Tail   0   0  -1
Chest  Spine  0   0   0
Head   Chest  0   0   1     0 0 3
fin.{S} Chest 0.3 0   0.3   1.6 -0.3 -0.4
"""


@pytest.mark.parametrize("back", ["Tail", "spine2"])
def test_a_fish_whose_joints_hang_on_its_tail_has_a_tail_and_fins(back):
    """The vertices of the last joint are all around it; a spine that leads on beyond the trunk is a tail as well."""
    found = limbs_of_joints(joints_at(FISH.replace("Tail", back)))
    assert_stands(found)
    points = found.limbs.points
    assert not any("leg" in name for name in points)
    assert_allclose([points["tail"][-1], points["head"][-1]], [(0, 0, -3), (0, 0, 3)], atol=1e-12)


def test_small_fins_on_the_back_of_a_fish_are_no_legs():
    points = points_of("""
    Root     -      0   0  0
    Face     Root   0   0  0.4    0 0 1
    Spine1   Root   0   0 -0.2
    Bone.{n} Spine1 0.1 0 -0.3    0.3 -0.2 -0.4
    Spine2   Spine1 0   0 -1
    Tail     Spine2 0   0 -2      0 0 -3
    """)
    assert {"trunk", "head", "tail"} <= points.keys()
    assert not any("leg" in name for name in points)


@pytest.mark.parametrize("name", ["leg_{row}_1", "Bone{row}"])
def test_the_legs_of_one_side_may_hang_on_one_joint(name):
    table, places = "body - 0 1 0\nhead body 0 1 1  0 1 1.6\nanchor_{s} body 0.1 1 0", (1.2, 0.5, -0.2, -0.9)
    for row, z in zip("abcd", places, strict=True):
        own = name.replace("{row}", row)
        table += f"""
        {own}_{{s}}     anchor_{{s}}    0.3 1   {z / 2}
        {own}_up_{{s}}  {own}_{{s}}     0.9 1.4 {z}
        {own}_low_{{s}} {own}_up_{{s}}  1.4 0.5 {z}    1.6 0 {z}"""
    found = limbs_of_joints(joints_at(table))
    assert_stands(found)
    for number, z in enumerate(places, 1):
        for side, x in (("left", 1.6), ("right", -1.6)):
            assert_allclose(found.limbs.points[f"{side} leg {number}"][-1], (x, 0, z), atol=1e-9)


FOUR_LEGS = """
pelvis       -            0   1    0
chest        pelvis       0   1    1
neck         chest        0   1.2  1.2
head         neck         0   1.6  1.6    0 1.6 2
hip_{S}      pelvis       0.2 0.9  0
knee_{S}     hip_{S}      0.2 0.5  0.1
ankle_{S}    knee_{S}     0.2 0.2 -0.1    0.2 0 0
scapula_{S}  chest        0.2 1.1  1
shoulder_{S} scapula_{S}  0.2 0.9  1
elbow_{S}    shoulder_{S} 0.2 0.6  0.9
wrist_{S}    elbow_{S}    0.2 0.35 1      0.2 0.2 1
fingers1_{S} wrist_{S}    0.2 0.15 1
fingers2_{S} fingers1_{S} 0.2 0.1  1      0.2 0 1
"""


def test_a_front_leg_named_as_an_arm_ends_on_the_ground():
    points = points_of(FOUR_LEGS)
    assert_allclose(
        [points[f"{side} front leg"][-1] for side in ("left", "right")], [(0.2, 0, 1), (-0.2, 0, 1)], atol=0.011
    )


def test_a_wing_ends_at_its_tip_and_not_at_the_middle_of_its_membrane():
    points = points_of(f"""{FOUR_LEGS}
    wing1_{{S}} chest       0.2 1.2 0.9
    wing2_{{S}} wing1_{{S}} 1.6 1.2 0.9    1.6 1.2 0.9  3 1.2 0.9  0.3 1.2 -0.6  2.8 1.2 0
    """)
    assert_allclose(points["left wing"][-1], (3, 1.2, 0.9), atol=0.1)


def test_the_head_of_a_winged_body_that_lies_is_at_its_front():
    """Against the usual front, and against toes, as those of a turtle that swims."""
    table = """
    Spine1          -               0    0    0
    Spine2          Spine1          0    0   -1
    head            Spine2          0    0   -2      0 0 -3
    flipper1_{side} Spine2         -0.3  0   -1
    flipper2_{side} flipper1_{side} -0.9 0   -1.4   -1.6 0.2 -1.8
    hind1_{side}    Spine1         -0.3 -0.2  0.1
    hind2_{side}    hind1_{side}   -0.6 -0.3  0.3
    hind3_{side}    hind2_{side}   -0.8 -0.4  0.5   -0.8 -0.45 0.9
    """
    assert_stands(limbs_of_joints(joints_at(table)), UP, -FRONT)


def test_joints_at_one_place_are_no_trunk():
    limbs = limbs_of_joints(joints_at("""
    head      -         0 0  2      0 0 2  0 0 1.5  0 0 0.2
    tail1     head      0 0  0
    tail2     tail1     0 0 -1      0 0 -2
    wing1.{S} head      0 0  1e-6
    wing2.{S} wing1.{S} 1 0  0      2 0 0
    """)).limbs  # fmt: skip
    assert (limbs.chains, len(limbs.notes)) == ((), 1)


PERSON = """
hips         -            0    1    0
chest        hips         0    1.4  0
head         chest        0    1.6  0    0 1.9 0
arm_{s}      chest        0.2  1.4  0
forearm_{s}  arm_{s}      0.5  1.4  0
hand_{s}     forearm_{s}  0.75 1.4  0    0.9 1.4 0
thigh_{s}    hips         0.1  0.95 0
shin_{s}     thigh_{s}    0.1  0.5  0
foot_{s}     shin_{s}     0.1  0.1  0    0.1 0 0.2
"""


def test_hair_and_skirts_are_no_limbs():
    ornaments = """
    Skirt_{n} hips       0.25  0.9 -0.1
    Bone.{n}  Skirt_{n}  0.25  0.5 -0.2    0.25 0.5 -0.2  0.3 0.1 -0.2
    hair.{n}  head       0.075 1.8 -0.1    0.075 1.8 -0.1  0.25 1.2 -0.3
    """
    assert_equal(points_of(PERSON + ornaments), points_of(PERSON))


def test_a_body_with_the_name_of_an_ornament_carries_its_legs():
    assert "left hind leg" in points_of(FOUR_LEGS.replace("pelvis", "wool"))


@pytest.mark.parametrize("seed", range(3))
def test_parts_of_a_limb_that_all_hang_on_the_root_are_one_limb(seed):
    """As in exports of Auto-Rig Pro, whose stretched joints have no parents but a control. A hand may hold a weapon."""
    joints = [
        replace(joint, vertices=np.tile(joint.place, (41, 1))) if joint.name == "forearm_r" else joint
        for joint in joints_at("~c_traj - 0 0 0" + PERSON.replace("hips         -", "hips c_traj"))
    ]
    flat = {f"{name}_{side}" for name in ("forearm", "shin", "foot") for side in "lr"}
    order = np.random.default_rng(seed).permutation(len(joints)).tolist()
    place = {old: new for new, old in enumerate(order)} | {-1: -1}
    mixed = []
    for old in order:
        joint = joints[old]
        around = {joint.parent, *(k for k, other in enumerate(joints) if other.parent == old)} - {-1}
        mixed.append(
            replace(
                joint,
                name=joint.name.replace("_", "_stretch_", 1) if joint.parent > 0 else joint.name,
                parent=place[0 if joint.name in flat else joint.parent],
                contacts={place[k]: 9 for k in around},
            )
        )
    assert_equal(points_of(mixed), points_of(PERSON))


def test_a_head_without_a_joint_is_what_is_above_the_shoulders():
    headless = [line for line in PERSON.splitlines() if not line.startswith("head")]
    table = "\n".join(headless).replace("chest        hips         0    1.4  0", "chest hips 0 1.4 0  0 1.4 0  0 1.9 0")
    assert_allclose(points_of(table)["head"], [[0, 1.4, 0], [0, 1.9, 0]])


def test_the_trunk_of_a_body_that_floats_ends_in_it_and_not_at_the_root_on_the_floor():
    upper = PERSON.partition("thigh")[0].replace("hips         -", "hips Root").replace("hips", "body")
    assert_allclose(points_of("~Root - 0 0 0" + upper)["trunk"][0], (0, 1, 0))


BOX_PERSON = """
Bone    -     0   1   0      0 1 0  0 1.5 0
Bone.1  Bone  0   1.5 0      0 1.5 0  0 1.8 0
Bone.2{s} Bone     0   1.5 0    0.1 1.5 0   0.1 1.2 0
Bone.3{s} Bone.2{s} 0.3 1.5 0    0.3 1.5 0   0.3 1.2 0
Bone.4{s} Bone.3{s} 0.3 1.2 0    0.3 1.2 0   0.3 0.9 0
~Bone.5{s} -       0   1   0
Bone.6{s} Bone.5{s} 0.1 1   0    0.1 1 0  0.1 0.5 0
Bone.7{s} Bone.6{s} 0.1 0.5 0    0.1 0.5 0  0.1 0 0  0.1 0 0.2
"""
"""A person whose arms and legs hang on bones that begin in the middle; some are tops of trees of their own."""


def test_bones_from_the_middle_of_a_body_to_its_limbs_are_of_the_trunk():
    found = limbs_of_joints(joints_at(BOX_PERSON)).limbs
    assert found.points.keys() == {"trunk", "head", "left arm", "right arm", "left leg", "right leg"}
    nodes = {chain.name: chain.points[0] for chain in found.chains}
    assert_allclose(nodes["left arm"], (0.3, 1.5, 0))
    assert_allclose(nodes["left leg"], (0.1, 1, 0))
    assert_allclose(nodes["right arm"], (-0.3, 1.5, 0))
    assert_allclose(found.points["trunk"][[0, -1]], [(0, 1, 0), (0, 1.5, 0)])
    assert_allclose(found.points["head"][-1], (0, 1.8, 0), atol=0.02)


def test_a_limb_of_one_joint_begins_where_its_vertices_do():
    """As arms of boxes that turn about the neck."""
    table = """
    body  -     0 1 0    0 1 0  0 1.5 0
    head  body  0 1.5 0  0 1.5 0  0 1.8 0
    arm.{S} body 0 1.5 0   0.25 1.5 0  1 1.5 0
    leg.{S} body 0.1 1 0   0.1 1 0  0.1 0 0
    """
    found = points_of(table)
    assert_allclose(found["left arm"][0], (0.25, 1.5, 0))
    assert_allclose(found["left leg"][0], (0.1, 1, 0))


def test_a_joint_at_the_end_of_a_hand_is_no_wrist():
    table = """
    body  -     0 1 0    0 1 0  0 1.5 0
    head  body  0 1.5 0  0 1.5 0  0 1.8 0
    arm.{S}     body        0.2 1.5 0   0.2 1.5 0  0.5 1.5 0
    forearm.{S} arm.{S}     0.5 1.5 0   0.5 1.5 0  0.8 1.5 0
    hand.{S}    forearm.{S} 0.95 1.5 0  0.8 1.5 0  0.95 1.5 0
    leg.{S} body 0.1 1 0   0.1 1 0  0.1 0 0
    """
    at = points_of(table)["left arm"] @ (1.0, 0, 0)
    assert_allclose(at[[0, 1, 3]], (0.2, 0.5, 0.95))
    assert 0.8 <= at[2] < 0.85


def test_a_beard_does_not_count_for_the_size_of_a_head():
    body = """
    body  -     0 1 0    0 1 0  0 1.5 0
    head  body  0 1.5 0  0 1.5 0  0 1.8 0
    Bone  head  0 1.5 0.1  0 1.5 0.1  0 0.9 0.1
    arm.{S} body 0.2 1.5 0   0.2 1.5 0  1 1.5 0
    leg.{S} body 0.1 1 0   0.1 1 0  0.1 0 0
    """
    assert_allclose(points_of(body)["head"][-1], (0, 1.8, 0), atol=0.02)
