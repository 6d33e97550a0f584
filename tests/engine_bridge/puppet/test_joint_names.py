"""Names of joints say which part of the body they are."""

import pytest

from engine_bridge.puppet.joint_names import JointMeaning, parse_joint_name


@pytest.mark.parametrize(
    ("name", "side", "pair"),
    [("leg_f_l", "left", "front"), ("FLLeg", "left", "front"), ("leg.br.1", "right", "hind"), ("RLeg", "right", None)],
)
def test_a_leg_says_its_pair_and_its_side_in_one_word_or_in_two(name, side, pair):
    assert parse_joint_name(name, True) == JointMeaning(side, pair, "leg")
