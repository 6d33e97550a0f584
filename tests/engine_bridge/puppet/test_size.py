"""Sizes: usual units where they are plausible for the body, and typical heights elsewhere."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_bridge.puppet.size import HEIGHTS, propose_scale


@pytest.mark.parametrize(
    ("height", "plan", "scale"),
    [
        (1.81, "upright", 1.0),
        (181.0, "upright", 0.01),
        (1810.0, "upright", 0.001),
        (0.84, "upright", 1.7 / 0.84),
        (2.69, "four legs", 0.5 / 2.69),
        (79.0, "four legs", 0.01),
        (14.7, "two legs", 1.5 / 14.7),
        (0.0, None, 1.0),
    ],
)
def test_a_unit_is_used_if_the_body_then_has_a_plausible_height(height, plan, scale):
    assert propose_scale(height, plan)[0] == pytest.approx(scale, rel=1e-3)


@given(st.floats(1e-4, 1e5), st.sampled_from([*HEIGHTS]))
def test_every_body_gets_a_plausible_height(height, plan):
    metres = height * propose_scale(height, plan)[0]
    assert HEIGHTS[plan].low * 0.999 <= metres <= HEIGHTS[plan].high * 1.001
