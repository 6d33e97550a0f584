import pytest

from engine_bridge.character.face_targets import EXPRESSION_TARGETS
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


def test_the_presets_are_all_that_vrm_has():
    emotions, mouth = {"happy", "angry", "sad", "relaxed", "surprised", "neutral"}, {"aa", "ih", "ou", "ee", "oh"}
    eyes = {"blink", "blinkLeft", "blinkRight", "lookUp", "lookDown", "lookLeft", "lookRight"}
    assert EXPRESSION_TARGETS.keys() == emotions | mouth | eyes


@pytest.mark.parametrize("preset", EXPRESSION_TARGETS)
def test_targets_with_vrms_names_are_its_expressions(preset):
    found = faces([preset])
    assert binds(found["preset"][preset]) == [(1, 0, 1.0)]
    assert "custom" not in found


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


def test_half_of_a_pair_is_no_expression():
    assert "happy" not in faces(["mouthSmileLeft", "jawOpen"])["preset"]


@pytest.mark.parametrize(
    "mesh",
    [
        {"primitives": [{"targets": [{}]}]},
        {"primitives": [{"targets": [{}]}], "extras": "jawOpen"},
        {"primitives": [{"targets": [{}]}], "extras": {"targetNames": "jawOpen"}},
        {"primitives": [{"targets": [{}]}], "extras": {"targetNames": [None, "jawOpen"]}},
        {"primitives": [{}], "extras": {"targetNames": ["jawOpen"]}},
        {"primitives": [], "extras": {"targetNames": ["jawOpen"]}},
    ],
)
def test_targets_without_names_and_names_without_targets_are_no_expressions(mesh):
    assert expressions({"nodes": [{"mesh": 0}], "meshes": [mesh]}) == {}
