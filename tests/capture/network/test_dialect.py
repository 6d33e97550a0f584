import numpy as np
import pytest

from capture.network.dialect import JOINT_NAMES, Ignored, Part, has_types, joint_part, to_metres
from capture.network.osc import Message
from capture.skeleton import JOINT_INDEX


def test_every_joint_of_ours_has_names_on_both_sides_which_are_read_in_any_case():
    assert {name for name in JOINT_NAMES.values() if name} == set(JOINT_INDEX)
    assert joint_part("Left_Hand", 3, (1.0,), 5.0) == Part(3, "hand_left", (1.0,), 5.0)
    assert joint_part("L_Collar", 3, (1.0,)) == Ignored()
    assert joint_part("tail", 3, (1.0,)) == "unknown joint"


@pytest.mark.parametrize(
    ("tags", "layout", "more", "fits"),
    [
        ("sShidf", "ssiiff", False, True),
        ("siihf", "sffff", False, True),
        ("sff", "sii", False, False),
        ("sffb", "sff", False, False),
        ("sffb", "sff", True, True),
        ("sf", "sff", True, False),
    ],
)
def test_numbers_of_any_width_fit_and_whole_numbers_are_numbers(tags, layout, more, fits):
    assert has_types(Message("/a", tags, ()), "b", layout, more=more) == fits


@pytest.mark.parametrize(
    ("largest", "units", "scale", "found"),
    [
        *((20.0, None, 1.0, "m"), (20.5, None, 0.001, "mm"), (-900.0, None, 0.001, "mm"), (900.0, "cm", 0.01, "cm")),
        *((900.0, "m", 1.0, "m"), (0.5, "mm", 0.001, "mm"), (0.5, "screen", 1.0, "screen")),
    ],
)
def test_units_are_configured_or_detected_by_size(largest, units, scale, found):
    values = np.array([[0.25, largest, np.nan]])
    metres, unit = to_metres(values, units, "m")
    assert unit == found
    np.testing.assert_array_equal(metres, values * scale)
