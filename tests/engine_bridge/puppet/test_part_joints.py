"""Bodies of rigid parts: what hangs on what, where it turns, and that a clip keeps it together."""

from copy import deepcopy

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from engine_bridge.character.character import load_character
from engine_bridge.puppet.limb_nodes import node_labels
from engine_bridge.puppet.part_joints import part_joints, without_ornaments
from engine_bridge.puppet.rig_bones import rig_bones
from engine_bridge.puppet.rig_limbs import rig_limbs
from engine_bridge.puppet.skin_joints import are_nested, joints_of
from solver.motion.limbs import TRUNK, Limb

from ..character.conftest import QUADS, VERTICES
from .skeletons import rows

GIRL = """
torso            0    1    0    0.5 0.5 0.3  -
head             0    1.5  0    0.5 0.5 0.5  torso
hair             0    1.7  0    0.6 0.2 0.6  head
eye_left_front   0.1  1.55 0.25 0.1 0.1 0.05 head
eye_right_front -0.1  1.55 0.25 0.1 0.1 0.05 head
arm_left         0.31 1    0    0.1 0.5 0.1  torso
arm_right       -0.31 1    0    0.1 0.5 0.1  torso
hand_left        0.31 0.7  0    0.12 0.12 0.12 arm_left
hand_right      -0.31 0.7  0    0.12 0.12 0.12 arm_right
skirt            0    0.65 0    0.8 0.25 0.4 torso
leg_left         0.13 0.35 0    0.1 0.6 0.1  torso
leg_right       -0.13 0.35 0    0.1 0.6 0.1  torso
shoe_left        0.13 0.04 0.05 0.14 0.08 0.3 leg_left
shoe_right      -0.13 0.04 0.05 0.14 0.08 0.3 leg_right
"""
"""Boxes: name, middle, size, and the part on which each hangs. The skirt touches hands and legs as well."""

COW = """
wool        0    0.9  0    0.9 0.9 1.6  -
Leg        -0.3  0.3  0.5  0.2 0.6 0.2  wool
Leg.001     0.3  0.3  0.5  0.2 0.6 0.2  wool
Leg.002    -0.3  0.3 -0.5  0.2 0.6 0.2  wool
Leg.003     0.3  0.3 -0.5  0.2 0.6 0.2  wool
Hoof       -0.3  0.03 0.5  0.22 0.06 0.22 Leg
Hoof.001    0.3  0.03 0.5  0.22 0.06 0.22 Leg.001
Hoof.002   -0.3  0.03 -0.5 0.22 0.06 0.22 Leg.002
Hoof.003    0.3  0.03 -0.5 0.22 0.06 0.22 Leg.003
head        0    1.3  0.9  0.4 0.4 0.5  wool
tail        0    1.1 -1    0.1 0.1 0.5  wool
"""

TOY = """
character_toy          0    0.35 0    0.4 0.7 0.4  -
character_toyHead      0    1.1  0    0.9 0.8 0.8  character_toy
character_toyArmLeft   0.29 0.45 0    0.18 0.5 0.18 character_toy
character_toyArmRight -0.29 0.45 0    0.18 0.5 0.18 character_toy
"""
"""The body, whose name says nothing, is smaller than the head that it carries."""


@pytest.fixture
def build(glb, tmp_path):
    """A character of boxes side by side; `origins` are those of nodes, which are else in the middle of their part.

    All are turned about y by `turn`, in degrees.
    """

    def make(table, order=None, origins=(), turn=0):
        boxes = rows(table)
        triangles = np.array([[a, *rest] for a, b, c, d in QUADS for rest in ((b, c), (c, d))])
        half, own = np.radians(turn) / 2, deepcopy(glb)
        top = own.node(name="character", rotation=[0.0, float(np.sin(half)), 0.0, float(np.cos(half))])
        for name in order or boxes:
            numbers, _ = boxes[name]
            origin = np.array(dict(origins).get(name, numbers[:3]))
            corners = (VERTICES - 0.5) * numbers[3:] + numbers[:3] - origin
            mesh = own.mesh(own.primitive(corners, triangles))
            own.node(mesh, parent=top, name=name, translation=origin.tolist())
        return load_character(own.save(tmp_path / "parts.glb"))

    return make


def hung(character):
    """Return on which part each one hangs."""
    joints = part_joints(character)
    return {joint.name: joints[joint.parent].name if joint.parent >= 0 else "-" for joint in joints}


@pytest.mark.parametrize("table", [GIRL, COW, TOY])
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_parts_hang_on_what_they_touch_whatever_their_order(build, table, seed):
    order = None if seed is None else np.random.default_rng(seed).permutation([*rows(table)]).tolist()
    assert hung(build(table, order)) == {name: parent for name, (_, parent) in rows(table).items()}


def test_slender_parts_turn_at_the_end_that_is_nearer_and_hanging_arms_at_the_upper_one(build):
    places = {joint.name: joint.place for joint in part_joints(build(GIRL))}
    for side, sign in (("left", 1), ("right", -1)):
        assert_allclose(places[f"arm_{side}"], [0.31 * sign, 1 + 0.9 * 0.25, 0], atol=0.02)
        assert_allclose(places[f"leg_{side}"], [0.13 * sign, 0.35 + 0.9 * 0.3, 0], atol=0.02)
        assert_allclose(places[f"shoe_{side}"], [0.13 * sign, 0.04, 0], atol=0.04)


def test_an_origin_toward_the_body_is_where_a_part_turns(build):
    shoulder, sole = [0.26, 1.2, 0.01], [0.13, 0.05, 0]
    joints = part_joints(build(GIRL, origins={"arm_left": shoulder, "leg_left": sole}))
    places = {joint.name: joint.place for joint in joints}
    assert_allclose(places["arm_left"], shoulder, atol=1e-6)
    assert places["leg_left"][1] > 0.5, "an origin at the sole is away from the body"


def test_limbs_are_found_from_parts(build):
    found = rig_limbs(build(GIRL))
    assert list(found.limbs.points) == [TRUNK, "head", "left arm", "right arm", "left leg", "right leg"]
    assert (found.bodies[0][1].up @ [0, 1, 0], found.bodies[0][1].front @ [0, 0, 1]) == (1, 1)
    assert len(found.limbs.points[TRUNK]) == 2, "one part does not bend"
    hip, knee, ankle, toes = found.limbs.points["left leg"]
    assert_allclose(knee, hip + 0.9 * (ankle - hip))
    assert_allclose(toes - ankle, [0, 0, 0.2], atol=0.07)  # the shoe lies on the floor


def test_four_legs_of_the_same_name_are_told_by_where_they_are(build):
    legs = [f"{side} {row} leg" for row in ("front", "hind") for side in ("left", "right")]
    assert [name for name in rig_limbs(build(COW)).limbs.points if "leg" in name] == legs


def test_ornaments_are_no_limbs_if_names_say_what_the_others_are(build):
    named = [joint.name for joint in without_ornaments(part_joints(build(GIRL)))]
    assert set(rows(GIRL)) - set(named) == {"hair", "skirt"}


def test_a_part_without_a_name_may_be_the_head_if_no_other_is(build):
    found = rig_limbs(build(GIRL.replace("head ", "top ").replace("eye_", "bead_")))
    assert found.limbs.points["head"][-1][1] > 1.7


def test_a_body_that_is_one_part_among_marks_of_its_joints_is_none_of_parts(build):
    marks = "\n".join(f"{name} 0 {0.2 * k} 0 0.02 0.02 0.02 body" for k, name in enumerate(["hips", "leg_l", "leg_r"]))
    assert rig_limbs(build(f"body 0 0.5 0 1 2 1 -\n{marks}")) is None


def test_animals_on_four_legs_look_where_their_head_is(build):
    turned = COW.replace(" 1.3  0.9 ", " 1.3 -0.9 ").replace(" 1.1 -1 ", " 1.1  1 ")
    assert (rig_limbs(build(turned)).bodies[0][1].front @ [0, 0, -1]) == 1


def test_parts_are_read_as_those_of_the_character_that_is_turned_back(build):
    back = Rotation.from_rotvec([0, -30, 0], degrees=True).as_matrix()
    straight = rig_limbs(build(GIRL)).limbs.points
    found = rig_limbs(build(GIRL, turn=30), back=back)
    assert_allclose(found.bodies[0][1].front, [0, 0, 1])
    assert list(found.limbs.points) == list(straight)
    for name, points in found.limbs.points.items():
        assert_allclose(points @ back.T, straight[name], atol=1e-6, err_msg=name)


def test_names_that_say_nothing_leave_all_parts(build):
    assert len(without_ornaments(part_joints(build("a 0 0 0 1 1 1 -\nb 1 0 0 1 1 1 a")))) == 2


def test_in_a_clip_every_part_follows_the_part_that_it_hangs_on(build):
    character = build(GIRL)
    found = rig_limbs(character)
    limbs = [
        Limb(c.name, c.points, ((),) * len(c.points), parent=None if c.name == TRUNK else TRUNK)
        for c in found.limbs.chains
    ]
    labels = node_labels(character.document)
    nodes = {chain.name: [labels.index(label) for label in chain.nodes] for chain in found.limbs.chains}
    bones = rig_bones(character, limbs, nodes)
    shares = {labels[node]: tuple(row) for node, row in zip(bones.nodes, bones.shares, strict=True)}
    for part, carrier in (("hair", "head"), ("eye_left_front", "head"), ("skirt", "torso")):
        assert shares[part] == shares[carrier]
    assert bones.placed.all(), "parts need not turn at their origins"
    assert len({shares[name] for name in ("torso", "head", "arm_left", "arm_right", "leg_left", "leg_right")}) == 6


def test_nested_parts_hang_as_the_file_says(glb, build, tmp_path):
    assert not are_nested(build(GIRL))
    mesh, parent = glb.mesh(glb.primitive(VERTICES, np.array([[0, 1, 2]]))), None
    for name in ("body", "arm", "hand"):
        parent = glb.node(mesh, parent=parent, name=name)
    assert are_nested(load_character(glb.save(tmp_path / "nested.glb")))


def test_bones_that_show_their_parts_are_their_joints(glb, tmp_path):
    mesh, bone, places = glb.mesh(glb.primitive(VERTICES, np.array([[0, 1, 2], [4, 6, 5]]))), None, []
    for number, name in enumerate(("body", "arm_left", "hand_left")):
        bone = glb.node(parent=bone, name=name, translation=[number, 0, 0])
        glb.node(mesh, parent=bone, name=f"Object_{number}")
        places.append([number * (number + 1) / 2, 0, 0])
    character = load_character(glb.save(tmp_path / "bones.glb"))
    assert are_nested(character)
    joints = [joint for joint in joints_of(character) if len(joint.vertices)]
    assert [joint.name for joint in joints] == ["body", "arm_left", "hand_left"]
    assert_allclose([joint.place for joint in joints], places)
    assert all(len(joint.vertices) == len(joints[0].vertices) for joint in joints)


def test_a_part_has_the_name_of_a_node_that_holds_nothing_else(glb, tmp_path):
    mesh = glb.mesh(glb.primitive(VERTICES, np.array([[0, 1, 2], [4, 6, 5], [0, 2, 4], [1, 5, 3]])))
    for name in ("body", "arm_left", "arm_right"):
        glb.node(mesh, parent=glb.node(name=name), name="Object_7")
    names = {joint.name for joint in part_joints(load_character(glb.save(tmp_path / "named.glb")))}
    assert names == {"body", "arm_left", "arm_right"}


def test_a_single_part_has_no_joint_nor_have_too_many(blob_file, build, monkeypatch):
    assert part_joints(load_character(blob_file)) == []
    monkeypatch.setattr("engine_bridge.puppet.part_joints.MAX_PARTS", len(rows(GIRL)) - 1)
    assert part_joints(build(GIRL)) == []


@pytest.mark.parametrize("size", ["0 0 0", "1 0 0", "1 1 0", "1e-7 1e-7 1e-7"])
def test_parts_without_a_volume_have_joints_as_well(build, size):
    places = [joint.place for joint in part_joints(build(f"body 0 0 0 1 1 1 -\nleg 0.5 0 0 {size} body"))]
    assert_allclose(places, [[0, 0, 0], [0.5, 0, 0]], atol=0.51)
