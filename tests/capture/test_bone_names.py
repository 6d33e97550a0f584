"""Names of joints say which part of the body they are."""

import pytest

from capture.bone_names import (
    MIDDLE_PARTS,
    SIDE_PARTS,
    TABLE,
    JointMeaning,
    bone_name,
    find_bones,
    find_points,
    joint_meanings,
    joint_sides,
    ornaments,
)

from ..integrations.bone_names import CONVENTIONS, FINGERS, SYNONYMS

BOTH = ("left", "right")


@pytest.mark.parametrize("name", CONVENTIONS)
def test_every_joint_of_a_convention_is_known_however_it_is_spelled(name):
    convention = TABLE["conventions"][name.split(" ")[0]]
    parts = [part for part, own in zip(MIDDLE_PARTS, convention["middle"], strict=False) if own]
    parts += [
        bone_name(side, part)
        for side in BOTH
        for part, own in zip(SIDE_PARTS, convention["sides"], strict=False)
        if own
    ]
    assert find_bones(CONVENTIONS[name]) == {part: index for index, part in enumerate(parts)}


@pytest.mark.parametrize("names", SYNONYMS.values(), ids=SYNONYMS)
def test_every_word_of_a_part_is_known_however_it_is_spelled(names):
    parts = [*MIDDLE_PARTS, *(bone_name(side, part) for side in BOTH for part in SIDE_PARTS)]
    assert find_bones(names) == {part: index for index, part in enumerate(parts)}


def test_fingers_are_counted_from_the_palm():
    found = {name: list(find_bones(names)) for name, names in FINGERS.items()}
    thumb = [f"leftThumb{bone}" for bone in ("Metacarpal", "Proximal", "Distal")]
    index, little = (
        [f"left{finger}{bone}" for bone in ("Proximal", "Intermediate", "Distal")] for finger in ("Index", "Little")
    )
    assert found["VRM 0"][:6] == [*thumb, *little]
    assert found["Unreal"][:9] == found["MikuMikuDance"][:9] == [*thumb, *index, *little]
    assert (found["3ds Max"][:6], len(found["3ds Max"])) == ([*thumb, *index], 30)


def test_a_leg_says_its_side_and_its_pair_in_one_word_or_in_two():
    legs = {"leg_f_l": ("left", "front"), "FL_Leg": ("left", "front"), "leg.br.1": ("right", "hind")}
    legs["RLeg"] = ("right", None)
    assert joint_meanings([*legs]) == [JointMeaning(*leg, "leg") for leg in legs.values()]


def test_further_joints_are_the_parts_that_no_joint_is_named_after():
    """A neck without a head, a spine by its numbers, a shoulder before an elbow, and legs by their numbers."""
    names = ["Root", "Spine", "Spine1", "Spine2", "Neck", "Neck1"]
    names += [
        f"{name}_L" for name in ("Scapula", "Shoulder", "Elbow", "Wrist", "Hand", "Leg1", "Leg2", "Ankle", "Foot")
    ]
    parts = ["hips", "spine", "chest", "upperChest", "neck", "head"]
    parts += [
        f"left{part}"
        for part in ("Shoulder", "UpperArm", "LowerArm", "Hand", "Palm", "UpperLeg", "LowerLeg", "Foot", "Toes")
    ]
    assert find_bones(names) == {part: index for index, part in enumerate(parts)}


def test_parts_of_a_character_may_say_where_they_are_and_how_they_collide():
    names = ["eye_left_front", "tail_back", "left_arm-col.004", "muzzle_front", "hair_back"]
    parts = [("left", "eye"), (None, "tail"), ("left", "upperArm"), (None, "face")]
    assert joint_meanings(names) == [*(JointMeaning(side, None, part) for side, part in parts), None]


def test_fins_and_ornaments_may_have_other_words_in_their_names():
    names = ["fin_peck.L", "B_Hair_12_031", "shellFront.R", "head.hair", "neck"]
    meanings = joint_meanings(names)
    assert meanings == [JointMeaning("left", None, "wing"), None, None, None, JointMeaning(None, None, "neck")]
    assert joint_meanings(["wingsupper.L", "LowerWing_R", "Arm_swing_L"]) == [
        JointMeaning("left", None, "wing"),
        JointMeaning("right", None, "wing"),
        None,
    ]
    assert ornaments(names) == [False, True, True, True, False]
    assert ornaments([f"B_Hair_{number}" for number in range(9)]) == [True] * 9  # a word of all says it as well


def test_a_letter_may_count_limbs():
    assert joint_meanings(["leg_a_1_l", "leg_d_2_r"]) == [JointMeaning(side, None, "leg") for side in BOTH]


def test_controls_count_where_vertices_follow_them():
    names = ["Foot_IK.L", "upperarm_twist_01_l", "HeadTop_End", "__Clavicle_L", "Bone.001"]
    assert joint_meanings(names) == [None] * 5
    assert joint_meanings(names, [True] * 5)[:3] == [JointMeaning("left", None, "foot"), None, None]


@pytest.mark.parametrize(
    ("word", "others"),
    [
        ("FullBody_", []),
        # as in exports with the meshes of bones between the joints
        ("Character1_", ["L_Radius_RIGMESH", "R_Radius_RIGMESH", "Torso_RIGMESH", "Pelvis_RIGMESH"]),
    ],
)
def test_a_word_before_all_or_most_names_says_nothing(word, others):
    names = ["Hips", "Spine", "LeftArm", "LeftForeArm", "LeftHand", "RightArm", "RightForeArm", "RightHand"]
    assert find_bones([*(word + name for name in names), *others]) == find_bones(names)


LIMBS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


@pytest.mark.parametrize("form", ["{side}{joint}", "{side}_{joint}"])
def test_initials_are_names_if_all_joints_have_such(form):
    names = {
        **{
            form.format(side=side[0], joint=joint[0]): f"{side}_{joint}"
            for side in ("left", "right")
            for joint in LIMBS
        },
        "n": "neck",
        "h": "head",
    }
    assert find_bones(list(names)) == find_bones(list(names.values()))
    assert find_points(list(names)) == find_points(list(names.values()))
    assert not find_bones([name for name in names if "k" not in name])


def test_a_wrist_or_ankle_may_follow_the_part_that_begins_there():
    names = ["Body_LeftHandWrist", "Body_RightFootAnkle", "Body_LeftHandPalm", "Body_RightHandWristTwist", "Body_Head"]
    assert find_points(names) == {"wrist_left": [0], "ankle_right": [1]}


def test_a_word_of_a_limb_that_all_joints_share_keeps_its_meaning():
    """All joints of a spider but the root may be of its legs; a leg at the back is no spine."""
    names = ["root", *(f"leg_{pair}_{side}_{k}" for pair in ("front", "back") for side in "lr" for k in range(3))]
    assert joint_meanings(names)[4] == JointMeaning("right", "front", "leg")
    assert joint_meanings(names)[-1] == JointMeaning("right", "hind", "leg")
    assert joint_sides(["Bone.007.L", "Bone.008.R", "Bone.009"]) == ["left", "right", None]


def test_single_words_count_if_most_names_of_a_skeleton_are_unknown():
    strange = ["torso_joint_1", "arm_joint_L_1", "leg_joint_R_2", "arm_leg_joint_L", "hair_arm_joint_L"]
    moving = [True] * len(strange)
    read = [None, JointMeaning("left", None, "upperArm"), JointMeaning("right", None, "leg"), None, None]
    assert joint_meanings(strange, moving) == read
    assert joint_meanings(strange) == [None] * 5
    usual = ["Hips", "Spine", "Neck", "Head", "Hand.L", "Foot.L"]
    assert joint_meanings([*strange, *usual], [True] * 11)[:5] == [None] * 5
