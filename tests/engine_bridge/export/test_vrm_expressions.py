import pytest

from engine_bridge.export.vrm_expressions import expressions


def faces(*meshes):
    """Return the expressions of a file in which each node shows a mesh with targets of these names."""
    return expressions(
        {
            "nodes": [{}, *({"mesh": number} for number in range(len(meshes)))],
            "meshes": [
                {"primitives": [{"attributes": {}, "targets": [{}] * len(names)}], "extras": {"targetNames": [*names]}}
                for names in meshes
            ],
        }
    )


def binds(expression):
    return [(bind["node"], bind["index"], bind["weight"]) for bind in expression["morphTargetBinds"]]


PRESETS = "happy angry sad relaxed surprised neutral aa ih ou ee oh blink blinkLeft blinkRight"
PRESETS += " lookUp lookDown lookLeft lookRight"
"""All presets of VRM 1.0."""


def test_targets_with_vrms_names_are_its_expressions_and_half_of_a_pair_is_none():
    for preset in PRESETS.split():
        found = faces([preset, "mouthSmileLeft"])
        assert {name: binds(each) for name, each in found["preset"].items()} == {preset: [(1, 0, 1.0)]}
        assert list(found["custom"]) == ["mouthSmileLeft"]


def test_arkits_names_are_expressions_and_stay_expressions_of_their_own():
    found = faces(["jawOpen", "eyeBlinkLeft", "eyeBlinkRight", "cheekPuff"])
    assert {name: binds(each) for name, each in found["preset"].items()} == {
        "aa": [(1, 0, 1.0)],
        "blink": [(1, 1, 1.0), (1, 2, 1.0)],
        "blinkLeft": [(1, 1, 1.0)],
        "blinkRight": [(1, 2, 1.0)],
    }
    assert list(found["custom"]) == ["jawOpen", "eyeBlinkLeft", "eyeBlinkRight", "cheekPuff"]


def test_a_preset_of_its_own_name_precedes_others_in_any_case_and_all_meshes_move():
    found = faces(["jawOpen", "AA"], ["aa"], ["Aa", "other"])
    assert binds(found["preset"]["aa"]) == [(1, 1, 1.0), (2, 0, 1.0), (3, 0, 1.0)]
    assert list(found["custom"]) == ["jawOpen", "other"]


@pytest.mark.parametrize(
    ("primitives", "extras"),
    [
        *(([{"targets": [{}]}], extras) for extras in ({}, "jawOpen")),
        *(([{"targets": [{}]}], {"targetNames": names}) for names in ("jawOpen", [None, "jawOpen"])),
        *((primitives, {"targetNames": ["jawOpen"]}) for primitives in ([{}], [])),
    ],
)
def test_targets_without_names_and_names_without_targets_are_no_expressions(primitives, extras):
    assert expressions({"nodes": [{"mesh": 0}], "meshes": [{"primitives": primitives, "extras": extras}]}) == {}
