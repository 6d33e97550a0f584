import pytest

from engine_bridge.export.vrm_expressions import expressions


def faces(*meshes):
    """Return the presets, and the names of others, of a file whose nodes show meshes with targets of these names."""
    described = [
        {"primitives": [{"attributes": {}, "targets": [{}] * len(names)}], "extras": {"targetNames": names}}
        for names in meshes
    ]
    found = expressions({"nodes": [{}, *({"mesh": k} for k in range(len(meshes)))], "meshes": described})
    return {name: binds(each) for name, each in found["preset"].items()}, list(found["custom"])


def binds(expression):
    return [(bind["node"], bind["index"], bind["weight"]) for bind in expression["morphTargetBinds"]]


PRESETS = "happy angry sad relaxed surprised neutral aa ih ou ee oh blink blinkLeft blinkRight"
PRESETS += " lookUp lookDown lookLeft lookRight"
"""All presets of VRM 1.0."""


@pytest.mark.parametrize("preset", PRESETS.split())
def test_targets_with_vrms_names_are_its_expressions_and_half_of_a_pair_is_none(preset):
    assert faces([preset, "mouthSmileLeft"]) == ({preset: [(1, 0, 1.0)]}, ["mouthSmileLeft"])


def test_arkits_names_are_expressions_and_stay_expressions_of_their_own():
    names = ["jawOpen", "eyeBlinkLeft", "eyeBlinkRight", "cheekPuff"]
    jaw, left, right = ((1, index, 1.0) for index in range(3))
    assert faces(names) == ({"aa": [jaw], "blink": [left, right], "blinkLeft": [left], "blinkRight": [right]}, names)


def test_a_preset_of_its_own_name_precedes_others_in_any_case_and_all_meshes_move():
    presets, others = faces(["jawOpen", "AA"], ["aa"], ["Aa", "other"])
    assert presets == {"aa": [(1, 1, 1.0), (2, 0, 1.0), (3, 0, 1.0)]}
    assert others == ["jawOpen", "other"]


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
