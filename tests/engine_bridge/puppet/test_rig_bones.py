"""Bones that the joints of real and synthetic skeletons follow."""

import numpy as np
import pygltflib as gltf
import pytest

from engine_bridge.character.character import load_character
from engine_bridge.puppet.rig_bones import rig_bones
from solver.motion.limbs import parents_first

from ..bones import limb
from ..character.conftest import CORNERS, SIDES
from .skeletons import rows

BODY = limb("trunk", "0 1 0, 0 1.5 0, 0 2 0")
ARM_POINTS = "0.3 1.9 0, 0.8 1.9 0, 1.2 1.9 0, 1.4 1.9 0"
ARM = limb("left arm", ARM_POINTS)
HEAD = limb("head", "0 2 0, 0 2.5 0")


def placed(bones, found):
    """Return the joints whose places have keys."""
    return [name for name, is_placed in zip(found, bones.placed, strict=True) if is_placed]


@pytest.fixture
def sort(glb, tmp_path):
    """Make a skeleton of joints (name: world place, parent) and return the bones of limbs, and those of each joint.

    Each joint shows a small tetrahedron, but a control does not. Its bones are with their shares: {"left arm 1": 1.0}.
    Further arguments are the joints from which limbs were read.
    """

    def make(joints, limbs=(BODY, ARM, HEAD), **read_from):
        nodes = {}
        for name, (place, parent) in joints.items():
            mesh = None if "control" in name else glb.mesh(glb.primitive(CORNERS / 10, SIDES))
            where = place - joints.get(parent, (0, None))[0]
            nodes[name] = glb.node(mesh, parent=nodes.get(parent), name=name, translation=where.tolist())
        if any("control" in name for name in joints):
            glb.file.skins = [gltf.Skin(joints=[*nodes.values()])]
        own = {limb.replace("_", " "): [nodes[name] for name in names.split()] for limb, names in read_from.items()}
        bones = rig_bones(load_character(glb.save(tmp_path / "nodes.glb")), limbs, own)
        names = [f"{each.name} {k}" for each in parents_first(limbs) for k in range(len(each.points) - 1)]
        return bones, {
            [*nodes][node]: {names[b]: round(float(shares[b]), 3) for b in np.flatnonzero(shares)}
            for node, shares in zip(bones.nodes, bones.shares, strict=True)
        }

    return make


SPINE = rows("""
root       0    0    0  -
hips       0  0.9    0  root
middle     0  1.5    0  hips
chest      0  1.7    0  middle
collar   0.1 1.85    0  chest
upper    0.3  1.9    0  collar
twist   0.55  1.9    0  upper
lower    0.8  1.9    0  twist
hand     1.2  1.9    0  lower
thumb   1.25  1.9  0.1  hand
neck       0    2    0  chest
skull      0  2.1    0  neck
""")


def test_nodes_without_a_skin_are_sorted_as_joints_are(sort):
    bones, found = sort(SPINE)
    expected = {
        "trunk 0": ("root", "hips"),
        "trunk 1": ("middle", "chest", "collar"),
        "left arm 0": ("upper", "twist"),
        "left arm 1": ("lower",),
        "left arm 2": ("hand", "thumb"),
        "head 0": ("neck", "skull"),
    }
    assert found == {joint: {bone: 1} for bone, joints in expected.items() for joint in joints}
    turning = {name for name, turns in zip(found, bones.turning, strict=True) if turns}
    assert turning == {"root", "middle", "upper", "lower", "hand", "neck"}
    assert placed(bones, found) == ["root"]


def test_a_chest_on_which_arms_hang_is_not_the_beginning_of_the_head(sort):
    """Without a neck, the head begins at the chest's joint, and the arms must not follow it."""
    joints = {name: place for name, place in SPINE.items() if name not in ("neck", "skull")}
    joints |= rows("chest 0 2 0 middle\nskull 0 2.1 0 chest")
    _, found = sort(joints)
    assert found["chest"] == {"trunk 1": 1}
    assert found["skull"] == {"head 0": 1}
    assert found["upper"] == {"left arm 0": 1}


def test_one_joint_above_hips_and_chest_does_not_tie_the_hips_to_the_chest(sort):
    upper = {name: place for name, place in SPINE.items() if name not in ("root", "hips", "middle")}
    joints = rows("root 0 0 0 -\nbody 0 1.7 -0.3 root") | upper
    joints |= rows("""
chest     0  1.6  0  body
collar  0.1 1.85  0  body
pelvis    0  1.1  0  body
hip     0.1 1.05  0  body
thigh   0.2    1  0  hip
shin    0.2  0.5  0  thigh
""")
    leg = limb("left leg", "0.2 1 0, 0.2 0.5 0, 0.2 0 0")
    bones, found = sort(joints, (BODY, ARM, HEAD, leg))
    assert found["root"] == found["body"] == found["pelvis"] == found["hip"] == {"trunk 0": 1}
    assert found["chest"] == found["collar"] == {"trunk 1": 1}
    assert placed(bones, found) == ["root", "chest", "collar"]


def test_of_two_joints_at_one_place_the_lower_begins_the_arm(sort):
    _, found = sort(SPINE | rows("collar 0.3 1.9 0 chest"))
    assert (found["collar"], found["upper"]) == ({"trunk 1": 1}, {"left arm 0": 1})


def test_of_two_arms_at_one_place_the_one_that_moves_vertices_is_taken(sort):
    first = rows("upper_control 0.3 1.9 0 collar\nlower_control 0.8 1.9 0 upper_control")
    _, found = sort({name: SPINE[name] for name in list(SPINE)[:5]} | first | SPINE)
    assert (found["upper"], found["lower"]) == ({"left arm 0": 1}, {"left arm 1": 1})


def test_a_target_of_inverse_kinematics_goes_with_its_hand_and_what_hangs_elsewhere_does_not(sort):
    joints = SPINE | rows("grip 1.2 1.9 0.01 root\npole 0.8 1.9 -1 root\npouch 1.2 1.9 0.01 hips")
    tail = limb("tail", "0 1 -0.5, 0 1 -1")
    bones, found = sort(joints, (BODY, ARM, HEAD, tail))
    assert [found[name] for name in ("grip", "pole", "pouch")] == [{"left arm 2": 1}, {"trunk 0": 1}, {"trunk 0": 1}]
    assert placed(bones, found) == ["root", "grip"]
    assert bones.missing == ("tail",)


def test_joints_that_a_limb_was_read_from_are_its_own_wherever_they_are(sort):
    """Another arm is exactly at the limb, its own ends before its last bone, and its hand hangs on the root."""
    own = rows("high 0.3 2.1 0 chest\nlow 0.8 2.1 0 high\nend 1.3 2.1 0 root")
    bones, found = sort(SPINE | own, left_arm="high low end", head="skull")
    assert [found[name] for name in own] == [{"left arm 0": 1}, {"left arm 1": 1}, {"left arm 2": 1}]
    assert found["upper"] == found["hand"] == found["neck"] == {"trunk 1": 1}
    assert found["skull"] == {"head 0": 1}
    assert placed(bones, found) == ["root", "skull", "high", "low", "end"]  # far from where the limb bends


def test_without_a_trunk_what_is_above_the_limbs_stands_still(sort):
    bones, found = sort(SPINE, [limb("left arm", ARM_POINTS, parent=None)])
    assert found["chest"] == found["neck"] == {}
    assert found["upper"] == {"left arm 0": 1}
    assert placed(bones, found) == ["root"]


def test_one_plain_surface_is_no_skeleton(blob_file):
    assert len(rig_bones(load_character(blob_file), [BODY, ARM]).nodes) == 0
