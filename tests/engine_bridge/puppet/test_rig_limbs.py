import re
from dataclasses import replace
from itertools import product

import numpy as np
import pygltflib as gltf
import pytest
from numpy.testing import assert_allclose, assert_array_equal, assert_equal

from engine_bridge.character.character import from_document, load_character, make_character
from engine_bridge.puppet.rig_limbs import limbs_of_joints, rig_limbs
from engine_bridge.puppet.skin_joints import Joint, joints_of

from ..bones import points
from ..character.conftest import CORNERS
from ..character.conftest import SIDES as TRIANGLES
from .skeletons import FRONT, NO_VERTICES, SIDES, UP, assert_stands, joints_at, points_of

LIMBS = [f"{side} {limb}" for limb in ("arm", "leg") for side, _ in SIDES]

PERSON = """
~Armature          -                 0    0    0
~hips              Armature          0    1    0
~spine             hips              0    1.2  0
~chest             spine             0    1.35 0
~neck              chest             0    1.5  0
~head              neck              0    1.6  0
~crown             head              0    1.8  0
~{side}:shoulder   chest             0.05 1.45 0
~{side}:upper_arm  {side}:shoulder   0.2  1.45 0
~{side}:twist      {side}:upper_arm  0.35 1.45 0
~{side}:lower_arm  {side}:twist      0.5  1.45 0
~{side}:hand       {side}:lower_arm  0.75 1.45 0
~{side}:finger     {side}:hand       0.85 1.45 0
~{side}:thigh      hips              0.1  0.95 0
~{side}:shin       {side}:thigh      0.1  0.5  0
~{side}:foot       {side}:shin       0.1  0.08 0
~{side}:toes       {side}:foot       0.1  0.02 0.15
~IK-foot.l         Armature          0.1  0.08 0.5
"""
"""A person in a T-pose, with a joint between upper arm and lower arm, and a control of a foot."""

HOLDING = PERSON.replace("~", "")
"""The same, where a vertex follows each joint."""

PLACES = {joint.name.removeprefix("left:"): joint.place for joint in joints_at(PERSON) if "right" not in joint.name}
"""Places of the joints in the middle and on the left."""

Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""Matrix that turns rows of coordinates so that up is z and front is -y."""

SPELLINGS = """
VRM: hips, spine, chest, neck, head, headEnd, {side}Shoulder, {side}UpperArm, {side}UpperArmTwist,
  {side}LowerArm, {side}Hand, {side}MiddleProximal, {side}UpperLeg, {side}LowerLeg, {side}Foot,
  {side}Toes
Mixamo: mixamorig:Hips, mixamorig:Spine, mixamorig:Spine2, mixamorig:Neck, mixamorig:Head,
  mixamorig:HeadTop_End, mixamorig:{Side}Shoulder, mixamorig:{Side}Arm, mixamorig:{Side}ArmTwist,
  mixamorig:{Side}ForeArm, mixamorig:{Side}Hand, mixamorig:{Side}HandMiddle1, mixamorig:{Side}UpLeg,
  mixamorig:{Side}Leg, mixamorig:{Side}Foot, mixamorig:{Side}ToeBase
Rigify: DEF-pelvis, DEF-spine.001, DEF-spine.003, DEF-neck, DEF-head, DEF-crown, DEF-shoulder.{S},
  DEF-upper_arm.{S}, DEF-upper_arm.{S}.001, DEF-forearm.{S}, DEF-hand.{S}, DEF-f_middle.01.{S},
  DEF-thigh.{S}, DEF-shin.{S}, DEF-foot.{S}, DEF-toe.{S}
Unreal: pelvis, spine_01, spine_03, neck_01, head, crown, clavicle_{s}, upperarm_{s},
  upperarm_twist_01_{s}, lowerarm_{s}, hand_{s}, middle_01_{s}, thigh_{s}, calf_{s}, foot_{s},
  ball_{s}
Quaternius: Hips, Abdomen, Chest, Neck, Head, Top, Shoulder.{S}, UpperArm.{S}, Extra.{S},
  LowerArm.{S}, Hand.{S}, Middle1.{S}, UpperLeg.{S}, LowerLeg.{S}, Foot.{S}, Toes.{S}
KayKit: hips, spine, chest, neck, head, top, shoulder.{s}, upperarm.{s}, extra.{s}, lowerarm.{s},
  wrist.{s}, hand.{s}, upperleg.{s}, lowerleg.{s}, foot.{s}, toes.{s}
3ds Max: Bip01 Pelvis, Bip01 Spine, Bip01 Spine1, Bip01 Neck, Bip01 Head, Bip01 HeadNub, Bip01 {S}
  Clavicle, Bip01 {S} UpperArm, Bip01 {S}UpTwist, Bip01 {S} Forearm, Bip01 {S} Hand, Bip01 {S}
  Finger0, Bip01 {S} Thigh, Bip01 {S} Calf, Bip01 {S} Foot, Bip01 {S} Toe0
VRoid: J_Bip_C_Hips, J_Bip_C_Spine, J_Bip_C_Chest, J_Bip_C_Neck, J_Bip_C_Head, HairJoint,
  J_Bip_{S}_Shoulder, J_Bip_{S}_UpperArm, J_Sec_{S}_Sleeve, J_Bip_{S}_LowerArm, J_Bip_{S}_Hand,
  J_Bip_{S}_Middle1, J_Bip_{S}_UpperLeg, J_Bip_{S}_LowerLeg, J_Bip_{S}_Foot, J_Bip_{S}_ToeBase
Rigify with its numbers: DEF-spine, DEF-spine.001, DEF-spine.003, DEF-spine.004, DEF-spine.006, crown, DEF-shoulder.{S},
  DEF-upper_arm.{S}, DEF-upper_arm.{S}.001, DEF-forearm.{S}, DEF-hand.{S}, DEF-f_middle.01.{S},
  DEF-thigh.{S}, DEF-shin.{S}, DEF-foot.{S}, DEF-toe.{S}
SMPL: Pelvis, Spine1, Spine3, Neck, Head, top, {S}_Collar, {S}_Shoulder, extra_{S}, {S}_Elbow, {S}_Wrist, {S}_Hand,
  {S}_Hip, {S}_Knee, {S}_Ankle, {S}_Foot
Motive: Hip, Ab, Chest, Neck, Head, Top, {S}Shoulder, {S}UArm, {S}Extra, {S}FArm, {S}Hand, {S}Middle1, {S}Thigh,
  {S}Shin, {S}Foot, {S}Toe
Advanced Skeleton: Root_M, Spine1_M, Chest_M, Neck_M, Head_M, HeadEnd_M, Scapula_{S}, Shoulder_{S}, ShoulderPart1_{S},
  Elbow_{S}, Wrist_{S}, MiddleFinger1_{S}, Hip_{S}, Knee_{S}, Ankle_{S}, Toes_{S}
ARKit: hips_joint, spine_1_joint, spine_7_joint, neck_1_joint, head_joint, top, {side}_shoulder_1_joint,
  {side}_arm_joint, {side}_extra_joint, {side}_forearm_joint, {side}_hand_joint, {side}_handMid_1_joint,
  {side}_upLeg_joint, {side}_leg_joint, {side}_foot_joint, {side}_toes_joint
"""
CONVENTIONS = {
    name: " ".join(names.split()).split(", ")
    for name, names in re.findall(r"^(\S.*?): (.*(?:\n .*)*)", SPELLINGS, re.MULTILINE)
}
"""Names of the joints of `PERSON`, in its order."""


def skeleton(convention, table=PERSON):
    """Return the person's joints with the names of a convention; further ones keep theirs."""
    names, joints = dict(zip([*PLACES][1:-1], CONVENTIONS[convention], strict=True)), []
    for joint in joints_at(table):
        side, _, key = joint.name.rpartition(":")
        spelled = names.get(key, key).format(side=side, Side=side.title(), S=side[:1].upper(), s=side[:1])
        joints.append(replace(joint, name=spelled, label=f"{side} {key}".strip()))
    return joints


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_a_person_is_known_by_the_names_of_every_convention_whatever_its_axes(convention):
    joints = skeleton(convention)
    found = limbs_of_joints(joints)
    limbs = found.limbs
    assert limbs.notes == ()
    assert list(limbs.points) == ["trunk", "head", *LIMBS]
    nodes = {chain.name: chain.nodes for chain in limbs.chains}
    for side, sign in SIDES:
        for limb, keys in {"arm": "upper_arm lower_arm hand finger", "leg": "thigh shin foot toes"}.items():
            *parts, tip = keys.split()
            assert_array_equal(limbs.points[f"{side} {limb}"], [PLACES[key] * [sign, 1, 1] for key in (*parts, tip)])
            assert nodes.pop(f"{side} {limb}") == tuple(f"{side} {part}" for part in parts)
    assert nodes == {"trunk": (), "head": ("neck", "head")}
    assert_allclose(limbs.points["trunk"], [(0, 0.95, 0), PLACES["spine"], PLACES["neck"]])
    assert_array_equal(limbs.points["head"], [PLACES["neck"], PLACES["crown"]])
    assert_stands(found)
    lying = [replace(joint, place=joint.place[[2, 0, 1]]) for joint in joints]
    assert_stands(limbs_of_joints(lying), (0, 0, 1), (1, 0, 0))


def test_a_person_is_known_without_names():
    own = skeleton("Unreal", HOLDING)
    expected = points_of(own)
    found = limbs_of_joints([replace(joint, name=f"node {number}") for number, joint in enumerate(own)])
    assert_stands(found)
    for limb in LIMBS:
        assert_array_equal(found.limbs.points[limb][[0, -1]], expected[limb][[0, -1]])


def test_the_head_begins_above_a_neck_that_carries_the_arms():
    """As in skeletons of 3ds Max; else no joint would be the head's."""
    joints = skeleton("3ds Max", PERSON.replace(":shoulder   chest", ":shoulder   neck "))
    limbs = limbs_of_joints(joints).limbs
    assert_array_equal(limbs.points["head"], [PLACES["head"], PLACES["crown"]])
    assert_array_equal(limbs.points["trunk"][-1], PLACES["neck"])


def test_ears_and_a_jaw_that_move_vertices_are_limbs():
    """Their joints may hang on the neck, and the end of an ear is where its vertices end."""
    more = """
    Ear1.{S}  neck  0.1 1.8 0     0.1 1.8 0  0.1 2 0
    Jaw       neck  0   1.6 0.05  0 1.6 0.05  0 1.55 0.25
    """
    joints = skeleton("Quaternius", HOLDING + more)
    found = points_of(joints)
    assert found.keys() == {"trunk", "head", *LIMBS, "left ear", "right ear", "jaw"}
    assert_allclose(found["left ear"], [(0.1, 1.8, 0), (0.1, 1.895, 0), (0.1, 1.99, 0)], atol=1e-9)
    assert_allclose(found["jaw"][-1], (0, 1.6 - 0.95 * 0.05, 0.05 + 0.95 * 0.2), atol=1e-9)
    still = [replace(joint, vertices=NO_VERTICES) for joint in joints]
    assert list(points_of(still)) == ["trunk", "head", *LIMBS]


def test_a_head_with_long_ears_is_a_head_and_not_a_trunk():
    joints = skeleton("Quaternius", HOLDING + "Ear1.{S} head 0.1 1.8 0  0.1 1.8 0  0.3 2.4 0")
    found = points_of(joints)
    assert found.keys() == {"trunk", "head", *LIMBS, "left ear", "right ear"}
    assert_array_equal(found["head"][0], points_of(joints[:-2])["head"][0])
    assert_allclose(found["left ear"][[0, -1]], [(0.1, 1.8, 0), (0.29, 2.37, 0)], atol=1e-9)


@pytest.mark.parametrize("named", [True, False])
def test_feet_that_hang_on_the_root_belong_to_the_legs_with_which_they_share_triangles(named):
    """The shins of coarse meshes end far above the feet, as far as thighs."""
    own = skeleton("Unreal", HOLDING.replace("Armature  ", "~Armature ", 1))[:-1]
    if not named:
        own = [replace(joint, name=f"node {number}") for number, joint in enumerate(own)]
    joints = [
        replace(joint, parent=0, contacts={joint.parent: 8}) if joint.label.endswith("foot") else joint for joint in own
    ]
    assert_equal(points_of(joints), points_of(own))


def test_legs_whose_roots_are_at_the_hips_hang_on_them():
    """Parts of an armature may have no parent; hands that hang beside the hips are nearer to the thighs."""
    expected = points_of(skeleton("Unreal", HOLDING)[:-1])
    apart = HOLDING.replace("{side}:thigh      hips ", "hip_{s} - 0 1 0\n{side}:thigh  hip_{s} ")
    found = points_of(skeleton("Unreal", apart)[:-1])
    assert found.keys() == expected.keys()
    for name in ("left leg", "right leg", "left arm", "head"):
        assert_array_equal(found[name], expected[name])


BOXES = """
head   0    1.25  0.62   0    1.25  0.62  0.25 0.25 0.25
body   0    0.9   0      0    0.9   0     0.45 0.45 0.7
leg0  -0.25 0.75 -0.38  -0.25 0.4  -0.38  0.1  0.4  0.1
leg1  -0.25 0.75  0.38  -0.25 0.4   0.38  0.1  0.4  0.1
leg2   0.25 0.75 -0.38   0.25 0.4  -0.38  0.1  0.4  0.1
leg3   0.25 0.75  0.38   0.25 0.4   0.38  0.1  0.4  0.1
"""
"""Where boxes turn, their middles, and the halves of their sides."""


@pytest.mark.parametrize("seed", range(4))
def test_boxes_that_all_hang_on_a_root_at_the_floor_are_a_body_in_any_order(seed):
    """As in animals of block games."""
    joints = [Joint("root", -1, np.zeros(3), NO_VERTICES)]
    for line in np.random.default_rng(seed).permutation(BOXES.strip().splitlines()).tolist():
        name, *numbers = line.split()
        place, middle, half = np.array(numbers, dtype=float).reshape(3, 3)
        joints.append(Joint(name, 0, place, middle + half * [*product((-1, 1), repeat=3)]))
    assert {name for name in points_of(joints) if "leg" in name} == {
        f"{side} {row} leg" for side in ("left", "right") for row in ("front", "hind")
    }


def test_parts_on_joints_without_a_skin_are_the_body_and_those_on_a_skinned_body_are_carried(glb, tmp_path):
    """A shield is not the arm, but a robot of which only the hands have a skin is a robot."""
    body = glb.node(name="body")
    arm = glb.node(parent=body, name="arm")
    glb.file.skins = [gltf.Skin(joints=[body, arm])]
    follows = np.array([[0], [0], [0], [1]], np.uint8) * np.array([1, 0, 0, 0], np.uint8)
    only = np.tile(np.float32([1, 0, 0, 0]), (4, 1))
    skinned = glb.node(glb.mesh(glb.primitive(CORNERS, TRIANGLES, JOINTS_0=follows, WEIGHTS_0=only)), skin=0)
    glb.node(glb.mesh(glb.primitive(CORNERS, TRIANGLES)), parent=arm, name="shield")
    document = load_character(glb.save(tmp_path / "robot.glb")).document
    assert [len(joint.vertices) for joint in joints_of(from_document(document))] == [3, 1]
    del document.gltf["nodes"][skinned]["mesh"], document.gltf["nodes"][skinned]["skin"]
    assert [len(joint.vertices) for joint in joints_of(from_document(document))] == [0, 4]


def test_a_body_without_legs_is_known_by_its_head_and_tail():
    joints = joints_at("""
    ~Root  -     0 0   0
    ~Chest Root  0 0.2 0
    ~Neck  Root  0 0.4 0.1
    ~Head  Root  0 0.8 0.2
    ~Tail  Root  0 0  -0.3
    """)
    limbs = limbs_of_joints(joints).limbs
    assert list(limbs.points) == ["trunk", "neck", "head", "tail"]
    assert_allclose(limbs.points["trunk"][[0, -1]], [joints[-1].place, joints[2].place])
    parts = [replace(joint, place=np.zeros(3)) for joint in joints]  # names of parts of a mesh
    assert limbs_of_joints(parts).limbs.chains == ()


@pytest.mark.parametrize(
    "names", ["BackLeg MidBackLeg MidFrontLeg FrontLeg", "leg_hind leg_middle leg_fore", "Leg Leg Leg"]
)
def test_rows_of_legs_are_numbered_from_the_front(names):
    """Feet that hang on the root, as those with inverse kinematics do, are the ends of their legs."""
    table, has_feet, names = "~Root - 0 0 0", names != "Leg Leg Leg", names.split()
    for row, name in enumerate(names):
        z = 0.3 * row
        table += f"""
        {name}1.{{S}}  Root           0.2 1   {z}
        {name}2.{{S}}  {name}1.{{S}}  1   1.6 {z}
        {name}3.{{S}}  {name}2.{{S}}  1.3 0.5 {z}  {f"1.3 0.5 {z}" if has_feet else ""}  1.5 0 {z}"""
        if has_feet:
            table += f"\n{name.lower().replace('leg', 'foot')}.{{s}} Root 1.5 0 {z}"
    found = limbs_of_joints(joints_at(f"{table}\nHead Root 0 1.1 -0.1  0 1.1 1.5"))
    limbs = found.limbs.points
    for row, (side, sign) in product(range(len(names)), SIDES):
        chain = points("0.2 1 0, 1 1.6 0, 1.3 0.5 0, 1.5 0 0") * [sign, 1, 1] + [0, 0, 0.3 * row]
        assert_allclose(limbs[f"{side} leg {len(names) - row}"], chain, atol=1e-9)
    assert_allclose(limbs["head"], [[0, 1.1, -0.1], [0, 1.1, 1.5]])
    assert_stands(found)


def test_legs_of_two_joints_may_reach_up_and_a_pole_is_no_foot():
    """As those of an insect that flies: up is y, and the last fifth of a leg is its foot."""
    table = "~Root - 0 0 0\nHead Root 0 1.1 0.5  0 1.1 1.5"
    for row, name in enumerate(("front", "middle", "rear")):
        table += f"""
        {name}_upper_leg.{{S}}  Root                    0.2 1   {-row}
        {name}_lower_leg.{{S}}  {name}_upper_leg.{{S}}  0.6 1.1 {-row}     1.1 1.3 {-row}
        ~{name}_knee.{{S}}      Root                    2.1 2.3 {1 - row}"""
    found = limbs_of_joints(joints_at(table))
    assert_stands(found)
    for row, (side, sign) in product(range(3), SIDES):
        hip, knee, tip = points("0.2 1 0, 0.6 1.1 0, 1.1 1.3 0") * [sign, 1, 1] - [0, 0, row]
        expected = [hip, knee, 0.2 * knee + 0.8 * tip, tip]
        assert_allclose(found.limbs.points[f"{side} leg {row + 1}"], expected, atol=1e-9)


@pytest.mark.parametrize(
    ("pair", "limb"),
    [("upper_arm2.{S} hand2.{S}", "arm"), ("shoulder2.{S} wings_lower.{S}", "wing"), ("breast.{S} nipple.{S}", None)],
)
def test_other_pairs_that_are_called_arms_or_wings_are_limbs_and_breasts_are_none(pair, limb):
    """A shoulder is of the limb that it carries."""
    first, second = pair.split()
    own = "wing.{S} spine 0.2 1.4 -0.2  0.9 1.6 -0.3" if limb == "wing" else ""
    table = f"""{HOLDING}
        {own}
        {first}   spine    0.2 1.2 0
        {second}  {first}  0.5 1.2 0  0.8 1.2 0"""
    expected = set(points_of(f"{HOLDING}\n{own}"))
    found = points_of(table)
    assert found.keys() - expected == ({f"{side} {limb} 2" for side, _ in SIDES} if limb else set())
    assert expected <= found.keys()
    if limb:
        assert_allclose(found[f"left {limb} 2"][-1], [0.8, 1.2, 0], atol=1e-9)


@pytest.mark.parametrize(
    ("rows", "other"),
    [
        ((0.4, 0.15, -0.15, -0.4), "sting.{S} body 0.03 0 0.2  0.03 0 0.25"),
        ((0.4, 0, -0.4), "feeler.{S} head 0.05 0.1 0.4\nend.{S} feeler.{S} 0.1 0.2 0.55  0.15 0.25 0.7"),
    ],
)
def test_four_pairs_of_limbs_without_names_are_legs_if_none_is_on_the_head(rows, other):
    """As those of a spider that lies flat, unlike those of an ant."""
    table = f"body - 0 0 0\nhead body 0 0 0.2  0 0.1 0.4\n{other}"
    for row, z in enumerate(rows):
        table += f"""
        {row}a.{{S}}  body         0.05 0 {z / 10}
        {row}b.{{S}}  {row}a.{{S}}  0.2  0 {z / 2}
        {row}c.{{S}}  {row}b.{{S}}  0.4  0 {z}      0.5 0 {z}"""
    legs = {f"{side} leg {row + 1}" for row in range(len(rows)) for side, _ in SIDES}
    found = points_of(table)
    assert {name for name in found if "leg" in name or "arm" in name} == legs
    assert "head" in found


def test_legs_with_names_point_down_in_a_file_whose_up_is_z():
    """Joints that are all in one plane do not tell what is in front."""
    table = """
    body - 0 1.8 0
    chest body 0 2.6 0
    head chest 0 3.8 0  0 4.5 0
    hip.{s} body 0 1.8 0
    shin.{s} hip.{s} 0.28 0.91 0
    foot.{s} shin.{s} 0.27 0.14 0  0.27 0 0
    upper_arm.{s} chest 0.6 3.3 0
    forearm.{s} upper_arm.{s} 1.3 3.3 0
    hand.{s} forearm.{s} 2 3.3 0  2.3 3.3 0
    """
    turned = [replace(joint, place=joint.place @ Z_UP, vertices=joint.vertices @ Z_UP) for joint in joints_at(table)]
    assert_stands(limbs_of_joints(turned), UP @ Z_UP, FRONT @ Z_UP)


def test_branches_that_all_hang_on_a_root_which_they_do_not_touch_hang_on_those_that_they_touch():
    """As the bones of a tail, or a control that holds the hand of an arm."""
    table = (
        "spine - 0 1 0\nhead spine 0 1 0.4  0 1.2 0.9\nleg.{S} spine 0.2 0.9 0\nfoot.{S} leg.{S} 0.2 0.1 0  0.2 0 0.1"
    )
    for number in range(1, 6):
        table += f"\ntail{number} {f'tail{number - 1}' if number > 1 else 'spine'} 0 1 {-0.3 * number}"
    own = joints_at(table)
    last = len(own) - 1
    tail = [
        replace(
            joint,
            parent=0,
            contacts={each: 8 for each in (last - 5 + k, last - 3 + k) if each <= last} if k else {0: 8},
        )
        for k, joint in enumerate(own[-5:])
    ]
    assert_equal(points_of(own[:-5] + tail), points_of(own))


TWO = """
UpperLeg.{S} hips         0.1 0.9  0
LowerLeg.{S} UpperLeg.{S} 0.1 0.45 0    0.1 0 0
UpperArm.{S} hips         0.2 1.4  0
LowerArm.{S} UpperArm.{S} 0.5 1.4  0    0.8 1.4 0
"""
NUMBERED = (
    TWO.replace("UpperLeg", "thigh").replace("LowerLeg", "shin").replace("UpperArm", "arm1").replace("LowerArm", "arm2")
)
ONE = """
leg.{S} hips 0.1 0.9 0  0.1 0 0
arm.{S} hips 0.2 1.4 0  0.8 1.4 0
"""


@pytest.mark.parametrize("limbs", [TWO, NUMBERED, ONE], ids=["two", "numbered", "one"])
def test_a_person_may_have_limbs_of_one_or_two_joints_and_controls_beside_them(limbs):
    controls = "~leg_ik.{S} hips 1 0 0\n~foot_ik.{S} leg_ik.{S} 1 0 0"
    found = points_of(f"hips - 0 1 0\nhead hips 0 1.5 0\n{limbs}\n{controls}")
    assert found.keys() == {"trunk", "head", *LIMBS}
    known = [0, -1] if limbs is ONE else [0, 1, 2, 3]  # where a single joint bends is anybody's guess
    rows = {"leg": "0.1 0.9 0, 0.1 0.45 0, 0.1 0 0", "arm": "0.2 1.4 0, 0.5 1.4 0, 0.8 1.4 0"}
    for (limb, row), (side, sign) in product(rows.items(), SIDES):
        root, bend, tip = points(row) * [sign, 1, 1]
        expected = np.array([root, bend, 0.2 * bend + 0.8 * tip, tip])
        assert_allclose(found[f"{side} {limb}"][known], expected[known], atol=1e-9)


def test_an_elbow_that_moves_nothing_is_no_lower_arm_beside_one_that_does():
    joints = skeleton("Unreal", HOLDING + "~elbow.{s} Armature 0 1.2 -1")
    assert_equal(points_of(joints), points_of(joints[:-2]))


def test_a_limb_ends_where_the_vertices_end_that_follow_it():
    table = HOLDING.replace("0.75 1.45 0", "0.75 1.45 0  0.75 1.43 0  0.95 1.47 0").replace(
        "{side}:finger", "~{side}:finger"
    )
    end = points_of(skeleton("Unreal", table))["left arm"][-1]
    assert_allclose(end, PLACES["hand"] + [0.19, 0, 0], atol=1e-12)  # 95 % of the way


def test_a_row_of_joints_from_front_to_back_is_a_trunk_and_a_tail():
    """As those of a fish; a row that stands may be anything."""
    row = joints_at("""
    Main0 -     0 0  2    0 0  2  0 0  3
    Main1 Main0 0 0  1    0 0  1  0 0  0
    Main2 Main1 0 0  0    0 0  0  0 0 -1
    Main3 Main2 0 0 -1    0 0 -1  0 0 -2
    """)
    found = points_of(row)
    assert_allclose(found["trunk"] @ FRONT, [1, 2.95])
    assert_allclose(found["tail"] @ FRONT, [1, 0, -1, -1.95])


def test_names_that_say_nothing_leave_it_to_the_shape():
    row = "\n".join(f"~Bone.{number:03} Bone.{number - 1:03} 0 {number} 0" for number in range(7))
    limbs = limbs_of_joints(joints_at(row)).limbs
    assert (limbs.chains, len(limbs.notes)) == ((), 1)


def test_a_file_without_a_skeleton_has_no_limbs_by_it(blob):
    assert rig_limbs(make_character("blob", blob.vertices.astype(float), blob.faces)) is None


def test_a_vrm_humanoid_is_known_by_the_file_s_own_table(glb, tmp_path):
    """The table is used and not the names of the nodes, which are numbers here."""
    mesh = glb.mesh(glb.primitive(CORNERS, TRIANGLES))
    for number in range(3):
        glb.node(mesh, name=f"{number}")
    document = load_character(glb.save(tmp_path / "avatar.glb")).document
    newer = {"head": {"node": 0}, "hips": {"node": 2}}
    older = [{"bone": bone, **entry} for bone, entry in newer.items()]
    for name, bones in (("VRMC_vrm", newer), ("VRM", older)):
        document.gltf["extensions"] = {name: {"humanoid": {"humanBones": bones}}}
        assert [joint.name for joint in joints_of(from_document(document))] == ["head", "1", "hips"]


def test_the_limbs_of_a_vrm_humanoid_are_those_of_the_same_skeleton_with_names(real_data):
    """The table is used and not the names of the nodes, which are numbers here."""
    document = load_character(real_data / "mesh" / "gltf" / "quaternius_Adventurer.glb").document.copy()
    named = {"Hips": "hips", "Neck": "neck", "Head": "head"}
    for (side, _), bone in product(SIDES, ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot")):
        named[f"{bone}.{side[0].upper()}"] = f"{side}{bone}"
    table = {}
    for index, node in enumerate(document.gltf["nodes"]):
        if node.get("name") in named:
            table[named[node["name"]]] = {"node": index}
        node["name"] = f"{index}"
    expected = rig_limbs(load_character(real_data / "mesh" / "gltf" / "quaternius_Adventurer.glb")).limbs.points
    older = [{"bone": bone, "node": entry["node"]} for bone, entry in table.items()]
    for extensions in ({"VRMC_vrm": {"humanoid": {"humanBones": table}}}, {"VRM": {"humanoid": {"humanBones": older}}}):
        document.gltf["extensions"] = extensions
        found = rig_limbs(from_document(document)).limbs.points
        assert list(found) == ["trunk", "head", *LIMBS]
        for name in LIMBS:
            assert_array_equal(found[name], expected[name])
