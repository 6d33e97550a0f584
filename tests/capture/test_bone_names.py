"""Names of joints say which part of the body they are."""

from capture.bone_names import JointMeaning, joint_meanings


def test_a_leg_says_its_side_and_its_pair_in_one_word_or_in_two():
    legs = {"leg_f_l": ("left", "front"), "FL_Leg": ("left", "front"), "leg.br.1": ("right", "hind")}
    legs["RLeg"] = ("right", None)
    assert joint_meanings([*legs]) == [JointMeaning(*leg, "leg") for leg in legs.values()]
