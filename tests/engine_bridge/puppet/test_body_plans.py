import numpy as np
import pytest

from engine_bridge.puppet.body_plans import plan_of

from ..bones import points

UP, FRONT = np.eye(3)[1:]
BODY = {"trunk": points("0 0.8 0, 0 1.4 0"), "head": points("0 1.5 0, 0 1.8 0")}


@pytest.mark.parametrize(
    ("others", "up", "plan"),
    [
        ("head, left arm, right arm, left leg, right leg", UP, "upright"),
        ("left arm, right arm, left leg, right leg", UP, "upright"),
        ("head, left arm, right arm, left leg, right leg", FRONT, "two legs"),
        ("left hind leg, right hind leg, left front leg, right front leg", FRONT, "four legs"),
        ("left leg 1, right leg 1, left leg 2, right leg 2, left leg 3, right leg 3", FRONT, "many legs"),
        ("left hind leg, right hind leg, left front leg, right front leg, left wing", FRONT, "wings"),
        ("head, tail", FRONT, "no legs"),
    ],
)
def test_the_plan_of_a_body_follows_from_its_limbs(others, up, plan):
    """Only where trunk and head are counts."""
    assert plan_of({name: BODY.get(name, BODY["trunk"]) for name in ("trunk", *others.split(", "))}, up) == plan
