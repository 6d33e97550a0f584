"""Where the limbs of a skeleton begin and end, for bodies of any kind."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from engine_bridge.puppet.rig_limbs import limbs_of_joints
from engine_bridge.puppet.skin_joints import Joint

FRONT = np.array([0.0, 0.0, 1.0])

NO_VERTICES = np.zeros((0, 3))


def assert_stands(found, up, front):
    body = found.bodies[0][1]
    assert_array_equal([body.up, body.front], [up, front])


def joints_at(rows):
    """Make joints from rows of name, parent, place and, if vertices follow them, other places."""
    names = [row.split()[0] for row in rows]
    made = []
    for row in rows:
        name, parent, *numbers = row.split()
        place, *held = np.array(numbers, dtype=float).reshape(-1, 3)
        made.append(Joint(name, names.index(parent) if parent in names else -1, place, np.array([place, *held])))
    return made


@pytest.mark.parametrize("back", ["Tail", "spine2"])
def test_a_fish_whose_joints_hang_on_its_tail_has_a_tail_and_fins(back):
    """The vertices of the last joint are all around it; a spine that leads on beyond the trunk is a tail as well."""
    rows = [
        f"{back} - 0 0 -2  0.4 0 -1.2  -0.4 0 -1.2  0.4 0 -3  -0.4 0 -3",
        f"Spine {back} 0 0 -1",
        "Chest Spine 0 0 0",
        "Head Chest 0 0 1  0 0 3",
        "fin.L Chest 0.3 0 0.3  1.6 -0.3 -0.4",
        "fin.R Chest -0.3 0 0.3  -1.6 -0.3 -0.4",
    ]
    found = limbs_of_joints(joints_at(rows))
    assert_stands(found, (0, 1, 0), FRONT)
    assert not any("leg" in name for name in found.limbs.points)
    assert_allclose(found.limbs.points["tail"][-1], (0, 0, -3), atol=1e-12)
    assert_allclose(found.limbs.points["head"][-1], (0, 0, 3), atol=0.11)


def test_small_fins_on_the_back_of_a_fish_are_no_legs():
    rows = [
        "Root - 0 0 0",
        "Face Root 0 0 0.4  0 0 1",
        "Spine1 Root 0 0 -0.2",
        "Bone Spine1 0.1 0 -0.3  0.3 -0.2 -0.4",
        "Bone.001 Spine1 -0.1 0 -0.3  -0.3 -0.2 -0.4",
        "Spine2 Spine1 0 0 -1",
        "Tail Spine2 0 0 -2  0 0 -3",
    ]
    points = limbs_of_joints(joints_at(rows)).limbs.points
    assert {"trunk", "head", "tail"} <= points.keys()
    assert not any("leg" in name for name in points)


@pytest.mark.parametrize("name", ["leg_{row}_1", "Bone{row}"])
def test_the_legs_of_one_side_may_hang_on_one_joint(name):
    rows = ["body - 0 1 0", "head body 0 1 1  0 1 1.6"]
    for side, x in (("l", 1), ("r", -1)):
        rows.append(f"anchor_{side} body {0.1 * x} 1 0")
        for row, z in zip("abcd", (1.2, 0.5, -0.2, -0.9), strict=True):
            own = name.format(row=row)
            rows += [
                f"{own}_{side} anchor_{side} {0.3 * x} 1 {z / 2}",
                f"{own}_up_{side} {own}_{side} {0.9 * x} 1.4 {z}",
                f"{own}_low_{side} {own}_up_{side} {1.4 * x} 0.5 {z}  {1.6 * x} 0 {z}",
            ]
    found = limbs_of_joints(joints_at(rows))
    assert_stands(found, (0, 1, 0), FRONT)
    for number, z in enumerate((1.2, 0.5, -0.2, -0.9), 1):
        assert_allclose(found.limbs.points[f"left leg {number}"][-1], (1.6, 0, z), atol=0.05)
        assert_allclose(found.limbs.points[f"right leg {number}"][-1], (-1.6, 0, z), atol=0.05)


FOUR_LEGS = [
    "pelvis - 0 1 0",
    "chest pelvis 0 1 1",
    "neck chest 0 1.2 1.2",
    "head neck 0 1.6 1.6  0 1.6 2",
    *(
        row
        for side, x in (("L", 0.2), ("R", -0.2))
        for row in (
            f"hip_{side} pelvis {x} 0.9 0",
            f"knee_{side} hip_{side} {x} 0.5 0.1",
            f"ankle_{side} knee_{side} {x} 0.2 -0.1  {x} 0 0",
            f"scapula_{side} chest {x} 1.1 1",
            f"shoulder_{side} scapula_{side} {x} 0.9 1",
            f"elbow_{side} shoulder_{side} {x} 0.6 0.9",
            f"wrist_{side} elbow_{side} {x} 0.35 1  {x} 0.2 1",
            f"fingers1_{side} wrist_{side} {x} 0.15 1",
            f"fingers2_{side} fingers1_{side} {x} 0.1 1  {x} 0 1",
        )
    ),
]


def test_a_front_leg_named_as_an_arm_ends_on_the_ground():
    points = limbs_of_joints(joints_at(FOUR_LEGS)).limbs.points
    for side, x in (("left", 0.2), ("right", -0.2)):
        assert_allclose(points[f"{side} front leg"][-1], (x, 0, 1), atol=0.011)


def test_a_wing_ends_at_its_tip_and_not_at_the_middle_of_its_membrane():
    rows = [*FOUR_LEGS]
    for side, x in (("L", 1), ("R", -1)):
        rows.append(f"wing1_{side} chest {0.2 * x} 1.2 0.9")
        membrane = f"{3 * x} 1.2 0.9  {0.3 * x} 1.2 -0.6  {2.8 * x} 1.2 0"
        rows.append(f"wing2_{side} wing1_{side} {1.6 * x} 1.2 0.9  {membrane}")
    points = limbs_of_joints(joints_at(rows)).limbs.points
    assert_allclose(points["left wing"][-1], (3, 1.2, 0.9), atol=0.1)


def test_the_head_of_a_winged_body_that_lies_is_at_its_front():
    """Against the usual front, and against toes, as those of a turtle that swims."""
    rows = ["Spine1 - 0 0 0", "Spine2 Spine1 0 0 -1", "head Spine2 0 0 -2  0 0 -3"]
    for side, x in (("left", -1), ("right", 1)):
        rows += [
            f"flipper1_{side} Spine2 {0.3 * x} 0 -1",
            f"flipper2_{side} flipper1_{side} {0.9 * x} 0 -1.4  {1.6 * x} 0.2 -1.8",
            f"hind1_{side} Spine1 {0.3 * x} -0.2 0.1",
            f"hind2_{side} hind1_{side} {0.6 * x} -0.3 0.3",
            f"hind3_{side} hind2_{side} {0.8 * x} -0.4 0.5  {0.8 * x} -0.45 0.9",
        ]
    assert_stands(limbs_of_joints(joints_at(rows)), (0, 1, 0), -FRONT)


def test_joints_at_one_place_are_no_trunk():
    rows = ["head - 0 0 2  0 0 1.5  0 0 0.2", "tail1 head 0 0 0", "tail2 tail1 0 0 -1  0 0 -2"]
    for side, x in (("L", 1), ("R", -1)):
        rows += [f"wing1.{side} head 0 0 1e-6", f"wing2.{side} wing1.{side} {x} 0 0  {2 * x} 0 0"]
    limbs = limbs_of_joints(joints_at(rows)).limbs
    assert (limbs.chains, len(limbs.notes)) == ((), 1)


def person_rows():
    """Return rows for `joints_at` of a person whose joints have places that follow them."""
    rows = ["hips - 0 1 0", "chest hips 0 1.4 0", "head chest 0 1.6 0  0 1.9 0"]
    for side, x in (("l", 1), ("r", -1)):
        rows += [
            f"arm_{side} chest {0.2 * x} 1.4 0",
            f"forearm_{side} arm_{side} {0.5 * x} 1.4 0",
            f"hand_{side} forearm_{side} {0.75 * x} 1.4 0  {0.9 * x} 1.4 0",
            f"thigh_{side} hips {0.1 * x} 0.95 0",
            f"shin_{side} thigh_{side} {0.1 * x} 0.5 0",
            f"foot_{side} shin_{side} {0.1 * x} 0.1 0  {0.1 * x} 0 0.2",
        ]
    return rows


def test_hair_and_skirts_are_no_limbs():
    rows = person_rows()
    expected = limbs_of_joints(joints_at(rows)).limbs.points
    for number, x in enumerate((0.25, -0.25)):
        rows += [
            f"Skirt_{number} hips {x} 0.9 -0.1  {x} 0.9 -0.1",
            f"Bone.{number} Skirt_{number} {x} 0.5 -0.2  {1.2 * x} 0.1 -0.2",
            f"hair.{number} head {0.3 * x} 1.8 -0.1  {x} 1.2 -0.3",
        ]
    found = limbs_of_joints(joints_at(rows)).limbs.points
    assert found.keys() == expected.keys()
    for name, line in expected.items():
        assert_allclose(found[name], line)


def test_a_body_with_the_name_of_an_ornament_carries_its_legs():
    assert (
        "left hind leg" in limbs_of_joints(joints_at([row.replace("pelvis", "wool") for row in FOUR_LEGS])).limbs.points
    )


@pytest.mark.parametrize("seed", range(3))
def test_parts_of_a_limb_that_all_hang_on_the_root_are_one_limb(seed):
    """As in exports of Auto-Rig Pro, whose stretched joints have no parents but a control. A hand may hold a weapon."""
    person = [row + 40 * " -0.5 1.4 0" if row.startswith("forearm_r") else row for row in person_rows()]
    expected = limbs_of_joints(joints_at(person)).limbs.points
    rows = ["c_traj - 0 0 0", *person]
    joints = joints_at([row.replace("hips - ", "hips c_traj ") for row in rows])
    flat = {f"{name}_{side}" for name in ("forearm", "shin", "foot") for side in "lr"}
    made = [
        replace(
            joint,
            name=joint.name.replace("_", "_stretch_", 1) if joint.parent > 0 else joint.name,
            parent=0 if joint.name in flat else joint.parent,
            contacts={joint.parent: 9} | {k: 9 for k, other in enumerate(joints) if other.parent == number},
        )
        for number, joint in enumerate(joints)
    ]
    made[0] = replace(made[0], vertices=NO_VERTICES)
    order = np.random.default_rng(seed).permutation(len(made))
    place = {int(old): new for new, old in enumerate(order)}
    mixed = [
        replace(
            made[old],
            parent=place.get(made[old].parent, -1),
            contacts={place[k]: n for k, n in made[old].contacts.items() if k in place},
        )
        for old in order.tolist()
    ]
    found = limbs_of_joints(mixed).limbs.points
    assert found.keys() == expected.keys()
    for name, line in expected.items():
        assert_allclose(found[name], line)


def test_a_head_without_a_joint_is_what_is_above_the_shoulders():
    rows = [row for row in person_rows() if not row.startswith("head")]
    rows[1] += "  0 1.9 0"
    points = limbs_of_joints(joints_at(rows)).limbs.points
    assert_allclose(points["head"], [[0, 1.4, 0], [0, 1.9, 0]])


def test_the_trunk_of_a_body_that_floats_ends_in_it_and_not_at_the_root_on_the_floor():
    rows = ["Root - 0 0 0", *(row.replace("hips - ", "body Root ").replace("hips", "body") for row in person_rows())]
    rows = [row for row in rows if not row.startswith(("thigh", "shin", "foot"))]
    joints = joints_at(rows)
    joints[0] = replace(joints[0], vertices=NO_VERTICES)
    assert_allclose(limbs_of_joints(joints).limbs.points["trunk"][0], (0, 1, 0))
