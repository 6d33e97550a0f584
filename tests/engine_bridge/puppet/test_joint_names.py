"""Names of joints say which part of the body they are."""

from engine_bridge.puppet.joint_names import JointMeaning, parse_joint_name


def test_a_leg_says_its_side_and_its_pair_in_one_word_or_in_two():
    legs = {"leg_f_l": ("left", "front"), "FL_Leg": ("left", "front"), "leg.br.1": ("right", "hind")}
    legs["RLeg"] = ("right", None)
    assert all(parse_joint_name(name, True) == JointMeaning(*leg, "leg") for name, leg in legs.items())
