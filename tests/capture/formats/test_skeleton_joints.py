import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from capture.bone_names import find_bones
from capture.formats.options import ReadOptions
from capture.formats.skeleton_joints import BY_SHAPE_NOTE, REQUIRED, select
from capture.skeleton import JOINT_INDEX, JOINTS, PARENTS
from puppetline.errors import SkeletonLogError

from .people import moving


def sides(*names, of=("Left", "Right")):
    return [name.replace("*", side) for side in of for name in names]


# Names of the joints that differ between skeletons: of the middle, and of the sides; and joints that are found there.
SKELETONS_TEXT = """
CMU | Left Right |
Hips, LowerBack, Spine, Spine1, Neck, Neck1, Head, LFingers, RFingers |
*Shoulder, *Arm, *ForeArm, *Hand, *UpLeg, *Leg, *Foot, *ToeBase |
spine: LowerBack, shoulder_center: Neck, shoulder_left: LeftArm, wrist_left: LeftHand, hand_left: LFingers, hip_left:
LeftUpLeg, knee_left: LeftLeg, ankle_left: LeftFoot, foot_left: LeftToeBase

Biovision | Left Right |
Hips, Chest, Neck, Head |
*Collar, *Shoulder, *Elbow, *Wrist, *Hip, *Knee, *Ankle, *Toe |
spine: Chest, shoulder_left: LeftShoulder, elbow_right: RightElbow, wrist_left: LeftWrist, hip_left: LeftHip,
knee_left: LeftKnee, ankle_left: LeftAnkle, foot_left: LeftToe

Kinect | Left Right |
SpineBase, SpineMid, SpineShoulder, Neck, Head |
Shoulder*, Elbow*, Wrist*, Hand*, Hip*, Knee*, Ankle*, Foot* |
hip_center: SpineBase, spine: SpineMid, shoulder_center: SpineShoulder, wrist_left: WristLeft, hand_left: HandLeft,
ankle_right: AnkleRight, foot_right: FootRight

Mixamo | Left Right |
mixamorig:Hips, mixamorig:Spine, mixamorig:Spine1, mixamorig:Spine2, mixamorig:Neck, mixamorig:Head |
mixamorig:*Shoulder, mixamorig:*Arm, mixamorig:*ForeArm, mixamorig:*Hand, mixamorig:*HandMiddle1, mixamorig:*UpLeg,
mixamorig:*Leg, mixamorig:*Foot, mixamorig:*ToeBase |
spine: mixamorig:Spine, shoulder_right: mixamorig:RightArm, hand_left: mixamorig:LeftHandMiddle1

Poser | l r |
hip, abdomen, chest, neck, head |
*Collar, *Shldr, *ForeArm, *Hand, *Thigh, *Shin, *Foot, *Toe |
hip_center: hip, spine: abdomen, shoulder_left: lShldr, hip_right: rThigh, knee_right: rShin, ankle_left: lFoot,
foot_left: lToe, wrist_left: lHand

3ds Max | l r |
Bip01, Bip01 Pelvis, Bip01 Spine, Bip01 Neck, Bip01 Head |
Bip01 * Clavicle, Bip01 * UpperArm, Bip01 * Forearm, Bip01 * Hand, Bip01 * Finger2, Bip01 * Thigh, Bip01 * Calf,
Bip01 * Foot, Bip01 * Toe0 |
hip_center: Bip01 Pelvis, shoulder_left: Bip01 l UpperArm, knee_right: Bip01 r Calf, hand_left: Bip01 l Finger2,
foot_right: Bip01 r Toe0

Unreal | l r |
root, pelvis, spine_01, spine_02, neck_01, head |
clavicle_*, upperarm_*, lowerarm_*, hand_*, thigh_*, calf_*, foot_*, ball_* |
hip_center: pelvis, spine: spine_01, shoulder_center: neck_01, elbow_left: lowerarm_l, foot_right: ball_r

CMU, the bones of its ASF files | l r |
hip, lowerback, upperback, thorax, lowerneck, upperneck, head |
*hipjoint, *femur, *tibia, *foot, *toes, *clavicle, *humerus, *radius, *wrist, *hand, *fingers, *thumb |
hip_center: hip, spine: lowerback, shoulder_center: lowerneck, shoulder_left: lhumerus, elbow_right: rradius,
wrist_left: lwrist, hand_left: lfingers, hip_right: rfemur, knee_left: ltibia, ankle_right: rfoot, foot_left: ltoes

MakeHuman | l r |
Root, Spine1, Spine2, Neck, Head, Hips |
__Clavicle_*, Clavicle_*, UpArm_*, LoArm_*, Hand_*, Middle1_*, __UpLeg_*, UpLeg_*, LoLeg_*, Foot_*, Toe_* |
hip_center: Hips, spine: Spine1, shoulder_left: UpArm_l, hand_left: Middle1_l, hip_right: UpLeg_r, knee_right:
LoLeg_r, ankle_left: Foot_l, foot_left: Toe_l

VRoid | L R |
J_Bip_C_Hips, J_Bip_C_Spine, J_Bip_C_Chest, J_Bip_C_Neck, J_Bip_C_Head |
J_Bip_*_Shoulder, J_Bip_*_UpperArm, J_Bip_*_LowerArm, J_Bip_*_Hand, J_Bip_*_UpperLeg, J_Bip_*_LowerLeg, J_Bip_*_Foot,
J_Bip_*_ToeBase |
hip_center: J_Bip_C_Hips, shoulder_left: J_Bip_L_UpperArm, elbow_right: J_Bip_R_LowerArm, hip_left: J_Bip_L_UpperLeg,
foot_right: J_Bip_R_ToeBase

Character Creator | L R |
CC_Base_Hip, CC_Base_Waist, CC_Base_Spine02, CC_Base_NeckTwist01, CC_Base_Head |
CC_Base_*_Clavicle, CC_Base_*_Upperarm, CC_Base_*_Forearm, CC_Base_*_Hand, CC_Base_*_Thigh, CC_Base_*_Calf,
CC_Base_*_Foot, CC_Base_*_ToeBase |
hip_center: CC_Base_Hip, shoulder_center: CC_Base_NeckTwist01, wrist_left: CC_Base_L_Hand, knee_right: CC_Base_R_Calf

Rigify | L R |
DEF-spine, DEF-spine.001, DEF-spine.002, DEF-spine.003, DEF-spine.004, DEF-spine.005, DEF-spine.006 |
DEF-shoulder.*, DEF-upper_arm.*, DEF-upper_arm.*.001, DEF-forearm.*, DEF-hand.*, DEF-thigh.*, DEF-shin.*, DEF-foot.*,
DEF-toe.* |
hip_center: DEF-spine, spine: DEF-spine.001, shoulder_center: DEF-spine.004, head: DEF-spine.006, shoulder_left:
DEF-upper_arm.L, knee_right: DEF-shin.R

Motive | L R |
Hip, Ab, Chest, Neck, Head |
*Shoulder, *UArm, *FArm, *Hand, *Thigh, *Shin, *Foot, *Toe |
spine: Ab, shoulder_left: LUArm, elbow_right: RFArm, hip_left: LThigh, foot_right: RToe

Advanced Skeleton | L R |
Root_M, Spine1_M, Chest_M, Neck_M, Head_M |
Scapula_*, Shoulder_*, Elbow_*, Wrist_*, Hip_*, Knee_*, Ankle_*, Toes_* |
hip_center: Root_M, spine: Spine1_M, shoulder_left: Shoulder_L, ankle_right: Ankle_R, foot_left: Toes_L

MikuMikuDance | 左 右 |
センター, 上半身, 首, 頭 |
*肩, *腕, *ひじ, *手首, *足, *ひざ, *足首, *つま先 |
spine: 上半身, shoulder_center: 首, head: 頭, shoulder_left: 左腕, elbow_right: 右ひじ, wrist_left: 左手首,
hip_left: 左足, knee_right: 右ひざ, ankle_left: 左足首, foot_right: 右つま先

MikuMikuDance in English | L R |
center, upper body, neck, head |
shoulder_*, arm_*, elbow_*, wrist_*, leg_*, knee_*, ankle_*, toe_* |
shoulder_left: arm_L, elbow_right: elbow_R, hip_left: leg_L, knee_right: knee_R, foot_left: toe_L

ARKit | left right |
hips_joint, spine_1_joint, spine_7_joint, neck_1_joint, head_joint |
*_shoulder_1_joint, *_arm_joint, *_forearm_joint, *_hand_joint, *_upLeg_joint, *_leg_joint, *_foot_joint, *_toes_joint |
hip_center: hips_joint, spine: spine_1_joint, shoulder_left: left_arm_joint, elbow_right: right_forearm_joint,
hip_left: left_upLeg_joint, knee_right: right_leg_joint, foot_left: left_toes_joint
"""


def skeleton(text):
    """Return the program, the names of its joints, and the name that is expected for some of ours."""
    program, of, middle, sided, expected = (" ".join(part.split()) for part in text.split("|"))
    names = [*middle.split(", "), *sides(*sided.split(", "), of=of.split())]
    return program, names, dict(pair.split(": ") for pair in expected.split(", "))


SKELETONS = {program: rest for program, *rest in map(skeleton, SKELETONS_TEXT.strip().split("\n\n"))}


def points_of(names, places=None):
    """Return x of the 20 joints of a chain of nodes in which node i is at x = i, or at the x of `places`."""
    x = [(places or {}).get(index, float(index)) for index in range(len(names))]
    rest = np.array([[value, 0.0, 0.0] for value in x])
    turns = [np.eye(3)[None]] * len(names)
    parents = range(-1, len(names) - 1)
    body = select(Path("take.bvh"), names, parents, rest, list(rest[:, None]), turns, ReadOptions(as_person=True))
    return dict(zip(JOINTS, body.points[0, :, 0].tolist(), strict=True)), body.notes


@pytest.mark.parametrize("program", SKELETONS)
def test_skeletons_of_known_programs_are_recognised(program):
    names, expected = SKELETONS[program]
    found, _ = points_of(names)
    assert {joint: names[int(found[joint])] for joint in expected} == expected
    assert found["head"] == find_bones(names)["head"] + 0.5


def test_missing_middle_joints_are_midpoints_and_hands_are_ends():
    names = [*sides("*Arm", "*ForeArm", "*Hand", "", "*UpLeg", "*Leg", "*Foot", ""), "Head", ""]
    found, notes = points_of(names)
    assert found["hip_center"] == (found["hip_left"] + found["hip_right"]) / 2 == (4 + 12) / 2
    assert found["shoulder_center"] == (0 + 8) / 2
    assert found["spine"] == (8 + 4) / 2
    assert (found["hand_left"], found["foot_left"]) == (3, 7)
    assert sum("joint for spine." in note for note in notes) == 1


def test_a_joint_with_another_name_is_the_only_one_between_its_neighbours():
    names = [*sides("*Arm", "*Alpha", "*Hand", "", "*UpLeg", "*Beta", "*Foot", ""), "Head", ""]
    found, _ = points_of(names)
    assert (found["elbow_left"], found["knee_left"], found["knee_right"]) == (1, 5, 13)
    with pytest.raises(SkeletonLogError, match="no joint for elbow_left among"):
        points_of([*names[:1], "LeftGamma", *names[1:]])


def test_a_finger_joint_at_the_wrist_is_passed_over():
    names, _ = SKELETONS["Biovision"]
    names = [*names, "lhand", "LFingers", "rhand", "RFingers"]
    wrist = names.index("LeftWrist")
    assert points_of(names)[0]["hand_left"] == names.index("LFingers")
    names.remove("LFingers")
    assert points_of(names)[0]["hand_left"] == names.index("lhand")
    found, _ = points_of(names, {names.index("lhand"): float(wrist)})
    assert found["hand_left"] == wrist + 1  # where the wrist's bone ends


def test_names_of_no_human_are_quoted_up_to_a_whole_one():
    with pytest.raises(SkeletonLogError) as caught:
        points_of([f"Tail{number}" for number in range(100)])
    assert caught.value.where == "take.bvh"
    assert re.search(r"for shoulder_left.*Tail0, .*Tail\d\d, …$", caught.value.found)


def test_joints_without_names_whose_rest_pose_is_folded_are_told_by_their_motion():
    """All offsets are along x, as in LAFAN's files."""
    points = moving()
    parents = [JOINT_INDEX.get(PARENTS.get(joint), -1) for joint in JOINTS]
    rest = np.zeros((len(JOINTS), 3))
    for joint, parent in enumerate(parents[1:], start=1):
        rest[joint, 0] = rest[parent, 0] + np.linalg.norm(points[0, joint] - points[0, parent])
    names = [f"joint_{number}" for number in range(len(JOINTS))]
    turns = [np.eye(3)[None]] * len(names)
    body = select(Path("take.bvh"), names, parents, rest, list(np.moveaxis(points, 1, 0)), turns, ReadOptions())
    for joint in REQUIRED:
        assert_array_equal(body.points[:, JOINT_INDEX[joint]], points[:, JOINT_INDEX[joint]])
    assert BY_SHAPE_NOTE in body.notes


def test_where_both_hips_are_at_one_point_joints_are_at_the_ends_of_the_bones_with_their_names():
    names, _ = SKELETONS["Kinect"]
    hips = {names.index(f"Hip{side}"): -1.0 for side in ("Left", "Right")}
    found, notes = points_of(names, hips)
    assert [found[joint] for joint in ("hip_left", "knee_left", "head")] == [
        names.index(name) + 1 for name in ("HipLeft", "KneeLeft", "Head")
    ]
    assert len(notes) == 1
