import pytest

from engine_bridge.puppet.humanoid_bones import HUMANOID_BONES
from engine_bridge.rigging.naming_schemes import NAMES, SCHEMES


@pytest.mark.parametrize("scheme", SCHEMES)
def test_names_are_distinct_and_all_bones_have_one(scheme):
    assert list(NAMES[scheme]) == list(HUMANOID_BONES)
    assert len(set(NAMES[scheme].values())) == len(HUMANOID_BONES)


@pytest.mark.parametrize(
    ("scheme", "expected"),
    [
        ("vrm", ("hips", "upperChest", "leftUpperArm", "rightToes")),
        ("mixamo", ("mixamorig:Hips", "mixamorig:Spine2", "mixamorig:LeftArm", "mixamorig:RightToeBase")),
        ("unreal", ("pelvis", "spine_03", "upperarm_l", "ball_r")),
        ("rigify", ("spine", "spine.003", "upper_arm.L", "toe.R")),
        ("godot", ("Hips", "UpperChest", "LeftUpperArm", "RightToes")),
    ],
)
def test_names_are_those_of_the_programs(scheme, expected):
    assert tuple(NAMES[scheme][bone] for bone in ("hips", "upperChest", "leftUpperArm", "rightToes")) == expected
