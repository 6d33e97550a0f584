import pytest

from engine_bridge.puppet.body_summary import body_summary


@pytest.mark.parametrize(
    ("plan", "limbs", "words"),
    [
        ("many legs", [f"{side} leg {n}" for side in ("left", "right") for n in range(7)], "fourteen"),
        ("no legs", ("trunk", "tail", "neck"), "a body without legs: one neck, one tail"),
        (None, (), "a shape without limbs"),
    ],
)
def test_a_summary_counts_limbs_of_each_kind(plan, limbs, words):
    assert body_summary(plan, limbs) == words.replace("fourteen", "an animal on many legs: 14 legs")
