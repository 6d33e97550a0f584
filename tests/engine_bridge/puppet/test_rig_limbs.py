import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal, assert_equal

from engine_bridge.character.character import from_document, load_character, make_character
from engine_bridge.puppet.rig_limbs import limbs_of_joints, rig_limbs
from engine_bridge.puppet.skin_joints import Joint, joints_of

from ..bones import points

PERSON = ["trunk", "head", "left arm", "right arm", "left leg", "right leg"]

NO_VERTICES = np.zeros((0, 3))

PERSON_JOINTS = """
hips        -           0    1    0
spine       hips        0    1.2  0
chest       spine       0    1.35 0
neck        chest       0    1.5  0
head        neck        0    1.6  0
crown       head        0    1.8  0
shoulder    chest       0.05 1.45 0
upper_arm   shoulder    0.2  1.45 0
twist       upper_arm   0.35 1.45 0
lower_arm   twist       0.5  1.45 0
hand        lower_arm   0.75 1.45 0
finger      hand        0.85 1.45 0
thigh       hips        0.1  0.95 0
shin        thigh       0.1  0.5  0
foot        shin        0.1  0.08 0
toes        foot        0.1  0.02 0.15
"""
ROWS = [row.split() for row in PERSON_JOINTS.split("\n") if row]
PLACES = {name: tuple(map(float, place)) for name, _, *place in ROWS}
PARENTS = {name: parent for name, parent, *_ in ROWS}
"""A person in a T-pose, with a joint between upper arm and lower arm. Joints outside the middle exist on both sides."""

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
"""Names of the joints of `PLACES`, in its order."""


FRONT = np.array([0.0, 0.0, 1.0])


def assert_stands(found, up, front):
    body = found.bodies[0][1]
    assert_array_equal([body.up, body.front], [up, front])


def holding(joints):
    """Return joints that all have vertices: their place, if they have none."""
    return [joint if len(joint.vertices) else replace(joint, vertices=joint.place[None]) for joint in joints]


def skeleton(names, vertices=None):
    """Make the person's joints, the root of an armature above them, and a control for each foot."""
    joints = [Joint("Armature", -1, np.zeros(3), NO_VERTICES)]
    index = {}
    for sign, side in ((0, ""), (1, "left"), (-1, "right")):
        for key, name in zip(PLACES, names, strict=True):
            if (PLACES[key][0] == 0) != (sign == 0):
                continue
            parent = index.get((PARENTS[key], side), index.get((PARENTS[key], ""), 0))
            index[key, side] = len(joints)
            spelled = name.format(side=side, Side=side.title(), S=side[:1].upper(), s=side[:1])
            place = np.array(PLACES[key]) * (sign or 1, 1, 1)
            joints.append(Joint(spelled, parent, place, NO_VERTICES, f"{side} {key}".strip()))
    joints.append(Joint("IK-foot.l", 0, np.array([0.1, 0.08, 0.5]), NO_VERTICES))
    return joints


@pytest.mark.parametrize("names", CONVENTIONS.values(), ids=CONVENTIONS)
def test_a_person_is_known_by_the_names_of_every_convention_whatever_its_axes(names):
    joints = skeleton(names)
    found = limbs_of_joints(joints)
    limbs = found.limbs
    assert limbs.notes == ()
    assert list(limbs.points) == PERSON
    for side, sign in (("left", np.ones(3)), ("right", np.array([-1.0, 1, 1]))):
        arm = [PLACES[key] for key in ("upper_arm", "lower_arm", "hand", "finger")] * sign
        leg = [PLACES[key] for key in ("thigh", "shin", "foot", "toes")] * sign
        assert_array_equal(limbs.points[f"{side} arm"], arm)
        assert_array_equal(limbs.points[f"{side} leg"], leg)
    assert_allclose(limbs.points["trunk"], [(0, 0.95, 0), PLACES["spine"], PLACES["neck"]])
    assert_array_equal(limbs.points["head"], [PLACES["neck"], PLACES["crown"]])
    nodes = {chain.name: chain.nodes for chain in limbs.chains}
    assert nodes.pop("trunk") == ()
    assert nodes.pop("head") == ("neck", "head")
    parts = {"arm": ("upper_arm", "lower_arm", "hand"), "leg": ("thigh", "shin", "foot")}
    assert nodes == {f"{s} {limb}": tuple(f"{s} {p}" for p in parts[limb]) for limb in parts for s in ("left", "right")}
    assert_stands(found, (0, 1, 0), (0, 0, 1))
    lying = [replace(joint, place=joint.place[[2, 0, 1]]) for joint in joints]
    assert_stands(limbs_of_joints(lying), (0, 0, 1), (1, 0, 0))


def test_a_person_is_known_without_names():
    own = holding(skeleton(CONVENTIONS["Unreal"]))
    expected = limbs_of_joints(own).limbs.points
    found = limbs_of_joints([replace(joint, name=f"node {number}") for number, joint in enumerate(own)])
    assert_stands(found, (0, 1, 0), (0, 0, 1))
    for limb in ("left arm", "right arm", "left leg", "right leg"):
        assert_array_equal(found.limbs.points[limb][[0, -1]], expected[limb][[0, -1]])


def test_the_head_begins_above_a_neck_that_carries_the_arms():
    """As in skeletons of 3ds Max; else no joint would be the head's."""
    joints = skeleton(CONVENTIONS["3ds Max"])
    neck = next(number for number, joint in enumerate(joints) if joint.name == "Bip01 Neck")
    joints = [replace(joint, parent=neck) if "Clavicle" in joint.name else joint for joint in joints]
    limbs = limbs_of_joints(joints).limbs
    assert_array_equal(limbs.points["head"], [PLACES["head"], PLACES["crown"]])
    assert_array_equal(limbs.points["trunk"][-1], PLACES["neck"])


def test_ears_and_a_jaw_that_move_vertices_are_limbs():
    """Their joints may hang on the neck, and the end of an ear is where its vertices end."""
    joints = holding(skeleton(CONVENTIONS["Quaternius"]))
    neck = next(number for number, joint in enumerate(joints) if joint.name == "Neck")
    for name, place in (("Ear1.L", (0.1, 1.8, 0)), ("Ear1.R", (-0.1, 1.8, 0)), ("Jaw", (0, 1.6, 0.05))):
        way = np.array((0.0, -0.05, 0.2) if name == "Jaw" else (0.0, 0.2, 0.0))
        joints.append(Joint(name, neck, np.array(place), place + np.linspace(0, 1, 21)[:, None] * way))
    found = limbs_of_joints(joints).limbs.points
    assert found.keys() == {*PERSON, "left ear", "right ear", "jaw"}
    assert_allclose(found["left ear"], [(0.1, 1.8, 0), (0.1, 1.895, 0), (0.1, 1.99, 0)], atol=1e-9)
    assert_allclose(found["jaw"][-1], (0, 1.6 - 0.95 * 0.05, 0.05 + 0.95 * 0.2), atol=1e-9)
    still = [replace(joint, vertices=NO_VERTICES) for joint in joints]
    assert list(limbs_of_joints(still).limbs.points) == PERSON


def test_a_head_with_long_ears_is_a_head_and_not_a_trunk():
    joints = holding(skeleton(CONVENTIONS["Quaternius"]))
    head = next(number for number, joint in enumerate(joints) if joint.name == "Head")
    for side, sign in (("L", 1), ("R", -1)):
        place, tip = np.array([0.1 * sign, 1.8, 0]), np.array([0.3 * sign, 2.4, 0])
        joints.append(Joint(f"Ear1.{side}", head, place, np.linspace(place, tip, 21)))
    found = limbs_of_joints(joints).limbs.points
    assert found.keys() == {*PERSON, "left ear", "right ear"}
    assert_array_equal(found["head"][0], limbs_of_joints(joints[:-2]).limbs.points["head"][0])
    assert_allclose(found["left ear"][[0, -1]], [(0.1, 1.8, 0), (0.29, 2.37, 0)], atol=1e-9)


@pytest.mark.parametrize("named", [True, False])
def test_feet_that_hang_on_the_root_belong_to_the_legs_with_which_they_share_triangles(named):
    """The shins of coarse meshes end far above the feet, as far as thighs."""
    root, *others, _ = skeleton(CONVENTIONS["Unreal"])
    own = [root, *holding(others)]
    if not named:
        own = [replace(joint, name=f"node {number}") for number, joint in enumerate(own)]
    expected, joints = limbs_of_joints(own).limbs, [*own]
    for number, joint in enumerate(own):
        if joint.label.endswith("foot"):
            joints[number] = replace(joint, parent=0, contacts={joint.parent: 8})
    found = limbs_of_joints(joints).limbs
    assert found.points.keys() == expected.points.keys()
    for name, chain in expected.points.items():
        assert_array_equal(found.points[name], chain)


def test_legs_whose_roots_are_at_the_hips_hang_on_them():
    """Parts of an armature may have no parent; hands that hang beside the hips are nearer to the thighs."""
    own = [joint for joint in holding(skeleton(CONVENTIONS["Unreal"])[:-1]) if joint.name != "IK-foot.l"]
    expected, hips = limbs_of_joints(own).limbs.points, next(j for j in own if j.name == "pelvis")
    for number, joint in enumerate([*own]):
        if joint.name.startswith("thigh"):
            own[number] = replace(joint, parent=len(own))
            own.append(replace(hips, parent=-1, name=joint.name.replace("thigh", "hip")))
    found = limbs_of_joints(own).limbs.points
    assert found.keys() == expected.keys()
    for name in ("left leg", "right leg", "left arm", "head"):
        assert_array_equal(found[name], expected[name])


@pytest.mark.parametrize("seed", range(4))
def test_boxes_that_all_hang_on_a_root_at_the_floor_are_a_body_in_any_order(seed):
    """As in animals of block games."""
    boxes = {"head": ((0, 1.25, 0.62), 0.25), "body": ((0, 0.9, 0), 0.45)}
    boxes |= {f"leg{k}": ((x, 0.75, z), 0.1) for k, (x, z) in enumerate(product((-0.25, 0.25), (-0.38, 0.38)))}
    joints = [Joint("root", -1, np.zeros(3), NO_VERTICES)]
    for name in np.random.default_rng(seed).permutation([*boxes]).tolist():
        (x, y, z), half = boxes[name]
        tall = np.array([half, 0.4 if name.startswith("leg") else half, 0.7 if name == "body" else half])
        corners = np.array([*product((-1, 1), repeat=3)]) * tall
        middle = [x, 0.4 if name.startswith("leg") else y, z]
        joints.append(Joint(name, 0, np.array([x, y, z], float), corners + middle))
    assert {name for name in limbs_of_joints(joints).limbs.points if "leg" in name} == {
        f"{side} {row} leg" for side in ("left", "right") for row in ("front", "hind")
    }


def test_parts_on_joints_without_a_skin_are_the_body_and_those_on_a_skinned_body_are_carried(real_data):
    """A shield is not the arm, but a robot of which only the hands have a skin is a robot."""
    document = load_character(real_data / "mesh" / "gltf" / "quaternius_Adventurer.glb").document.copy()
    own = joints_of(from_document(document))
    hand = next(index for index, node in enumerate(document.gltf["nodes"]) if node.get("name") == "LowerArm.R")
    meshes = [node for node in document.gltf["nodes"] if "mesh" in node]
    document.gltf["nodes"].append({"name": "Shield", "mesh": meshes[0]["mesh"], "translation": [0.5, 0, 0]})
    document.gltf["nodes"][hand].setdefault("children", []).append(len(document.gltf["nodes"]) - 1)
    carried = joints_of(from_document(document))
    assert [len(joint.vertices) for joint in carried] == [len(joint.vertices) for joint in own]
    for node in meshes:
        node.pop("mesh"), node.pop("skin")
    parts = joints_of(from_document(document))
    assert [joint.name for joint in parts if len(joint.vertices)] == ["LowerArm.R"]


def test_a_body_without_legs_is_known_by_its_head_and_tail():
    places = {"Chest": (0, 0.2, 0), "Neck": (0, 0.4, 0.1), "Head": (0, 0.8, 0.2), "Tail": (0, 0, -0.3)}
    joints = [Joint("Root", -1, np.zeros(3), NO_VERTICES)]
    joints += [Joint(name, 0, np.array(place, dtype=float), NO_VERTICES) for name, place in places.items()]
    limbs = limbs_of_joints(joints).limbs
    assert list(limbs.points) == ["trunk", "neck", "head", "tail"]
    assert_allclose(limbs.points["trunk"][[0, -1]], [places["Tail"], places["Neck"]])
    parts = [Joint(j.name, j.parent, np.zeros(3), j.vertices) for j in joints]  # names of parts of a mesh
    assert limbs_of_joints(parts).limbs.chains == ()


@pytest.mark.parametrize(
    "names", [("Back", "MidBack", "MidFront", "Front"), ("_hind", "_middle", "_fore"), ("", "", "")]
)
def test_rows_of_legs_are_numbered_from_the_front(names):
    """Feet that hang on the root, as those with inverse kinematics do, are the ends of their legs."""
    joints, expected = [Joint("Root", -1, np.zeros(3), NO_VERTICES)], {}
    for row, name in enumerate(names):
        for side, sign in (("L", 1), ("R", -1)):
            places = points("0.2 1 0, 1 1.6 0, 1.3 0.5 0, 1.5 0 0") * [sign, 1, 1] + [0, 0, 0.3 * row]
            for number, place in enumerate(places[:-1]):
                above = len(joints) - 1 if number else 0
                held = (places[2:] if name else places[-1:]) if number == 2 else NO_VERTICES
                limb = f"leg{name}" if name[:1] == "_" else f"{name}Leg"
                joints.append(Joint(f"{limb}{number + 1}.{side}", above, place, held))
            if name:
                joints.append(Joint(f"{limb}.{side}".lower().replace("leg", "foot"), 0, places[-1], places[-1:]))
            expected[f"{'left' if side == 'L' else 'right'} leg {len(names) - row}"] = places
    joints.append(Joint("Head", 0, np.array([0, 1.1, -0.1]), np.array([[0, 1.1, 1.5]])))
    found = limbs_of_joints([joints[0], *holding(joints[1:])])
    limbs = found.limbs
    assert_allclose([limbs.points[name] for name in expected], list(expected.values()), atol=1e-9)
    assert_allclose(limbs.points["head"], [[0, 1.1, -0.1], [0, 1.1, 1.5]])
    assert_stands(found, (0, 1, 0), (0, 0, 1))


def test_legs_of_two_joints_may_reach_up_and_a_pole_is_no_foot():
    """As those of an insect that flies: up is y, and the last fifth of a leg is its foot."""
    held, joints, expected = NO_VERTICES, [Joint("Root", -1, np.zeros(3), NO_VERTICES)], {}
    for side, sign in (("L", 1), ("R", -1)):
        for row, name in enumerate(("front", "middle", "rear")):
            hip, knee, tip = points("0.2 1 0, 0.6 1.1 0, 1.1 1.3 0") * [sign, 1, 1] - [0, 0, row]
            joints.append(Joint(f"{name}_upper_leg.{side}", 0, hip, held))
            joints.append(Joint(f"{name}_lower_leg.{side}", len(joints) - 1, knee, tip[None]))
            joints.append(Joint(f"{name}_knee.{side}", 0, tip + 1, held))
            expected[f"{'left' if side == 'L' else 'right'} leg {row + 1}"] = [hip, knee, 0.2 * knee + 0.8 * tip, tip]
    joints.append(Joint("Head", 0, np.array([0, 1.1, 0.5]), np.array([[0, 1.1, 1.5]])))
    found = limbs_of_joints(
        [joint if "knee" in joint.name or joint.parent < 0 else holding([joint])[0] for joint in joints]
    )
    limbs = found.limbs
    assert_allclose([limbs.points[name] for name in expected], list(expected.values()), atol=1e-9)
    assert_stands(found, (0, 1, 0), (0, 0, 1))


@pytest.mark.parametrize(
    "names",
    ["UpperLeg LowerLeg UpperArm LowerArm", "thigh shin arm1 arm2", "leg - arm -"],
    ids=["two", "numbered", "one"],
)
def test_a_person_may_have_limbs_of_one_or_two_joints_and_controls_beside_them(names):
    joints = [
        Joint("hips", -1, np.array([0, 1.0, 0]), NO_VERTICES),
        Joint("head", 0, np.array([0, 1.5, 0]), NO_VERTICES),
    ]
    expected = {}
    for side, sign in (("L", 1), ("R", -1)):
        for limb, row, pair in (
            ("leg", "0.1 0.9 0, 0.1 0.45 0, 0.1 0 0", names.split()[:2]),
            ("arm", "0.2 1.4 0, 0.5 1.4 0, 0.8 1.4 0", names.split()[2:]),
        ):
            root, bend, tip = points(row) * [sign, 1, 1]
            for name, place in zip(pair, (root, bend), strict=True):
                if name != "-":
                    last = name == pair[-1] or pair[-1] == "-"
                    above = 0 if name == pair[0] else len(joints) - 1
                    joints.append(Joint(f"{name}.{side}", above, place, tip[None] if last else NO_VERTICES))
            expected[f"{'left' if sign > 0 else 'right'} {limb}"] = [root, bend, 0.2 * bend + 0.8 * tip, tip]
        control = Joint(f"leg_ik.{side}", 0, np.array([sign, 0, 0]), NO_VERTICES)
        joints += [control, replace(control, name=f"foot_ik.{side}", parent=len(joints))]
    limbs = limbs_of_joints([joint if "_ik" in joint.name else holding([joint])[0] for joint in joints]).limbs.points
    assert limbs.keys() == {"trunk", "head", *expected}
    known = [0, -1] if "-" in names else [0, 1, 2, 3]  # where a single joint bends is anybody's guess
    found, wanted = (np.array([each[name] for name in expected])[:, known] for each in (limbs, expected))
    assert_allclose(found, wanted, atol=1e-9)


def test_an_elbow_that_moves_nothing_is_no_lower_arm_beside_one_that_does():
    joints = [replace(joint, vertices=joint.place[None]) for joint in skeleton(CONVENTIONS["Unreal"])]
    poles = [Joint(f"elbow.{side}", 0, np.array([0, 1.2, -1.0]), NO_VERTICES) for side in "lr"]
    assert_equal(limbs_of_joints([*joints, *poles]).limbs.points, limbs_of_joints(joints).limbs.points)


def test_a_limb_ends_where_the_vertices_end_that_follow_it():
    held = np.add(PLACES["hand"], [[0, -0.02, 0], [0.2, 0.02, 0]])
    others = {"hand_l": held, "middle_01_l": NO_VERTICES}
    joints = [
        replace(joint, vertices=others.get(joint.name, joint.vertices))
        for joint in holding(skeleton(CONVENTIONS["Unreal"]))
    ]
    end = limbs_of_joints(joints).limbs.points["left arm"][-1]
    assert_allclose(end, np.add(PLACES["hand"], (0.19, 0, 0)), atol=1e-12)  # 95 % of the way


def test_a_row_of_joints_from_front_to_back_is_a_trunk_and_a_tail():
    """As those of a fish; a row that stands may be anything."""
    row = [(2.0, 3), (1, 0), (0, -1), (-1, -2)]
    joints = [Joint(f"Main{i}", i - 1, z * FRONT, np.outer([z, end], FRONT)) for i, (z, end) in enumerate(row)]
    points = limbs_of_joints(joints).limbs.points
    assert_allclose(points["trunk"] @ FRONT, [1, 2.95])
    assert_allclose(points["tail"] @ FRONT, [1, 0, -1, -1.95])


def test_names_that_say_nothing_leave_it_to_the_shape():
    joints = [Joint(f"Bone.{i:03}", i - 1, np.array([0.0, i, 0]), NO_VERTICES) for i in range(7)]
    limbs = limbs_of_joints(joints).limbs
    assert (limbs.chains, len(limbs.notes)) == ((), 1)


def test_a_file_without_a_skeleton_has_no_limbs_by_it(blob):
    assert rig_limbs(make_character("blob", blob.vertices.astype(float), blob.faces)) is None


def test_a_vrm_humanoid_is_known_by_the_file_s_own_table(real_data):
    """The table is used and not the names of the nodes, which are numbers here."""
    document = load_character(real_data / "mesh" / "gltf" / "quaternius_Adventurer.glb").document.copy()
    named = {"Hips": "hips", "Neck": "neck", "Head": "head"}
    for side, letter in (("left", "L"), ("right", "R")):
        for bone in ("UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot"):
            named[f"{bone}.{letter}"] = f"{side}{bone}"
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
        assert list(found) == PERSON
        for name in ("left arm", "right arm", "left leg", "right leg"):
            assert_array_equal(found[name], expected[name])
