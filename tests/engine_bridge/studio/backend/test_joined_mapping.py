import copy

import pytest

from engine_bridge.studio.backend.joined_mapping import puppet_of, requests_of
from puppetline.errors import ServiceError

MAPPING = {
    "character": "dog",
    "handles": [
        {"name": "head", "position": [0.0, 1.6, 0.2], "joints": ["hand_left"], "axes": "xyz", "gain": 1.3},
        {"name": "tail", "position": [0.0, 0.9, -1.4], "joints": ["head", "spine"], "axes": "xy", "gain": -0.7},
        {"name": "foot", "position": [0.1, 0.0, 0.0], "joints": [], "axes": "xyz", "gain": 1.0},
    ],
    "limbs": [{"name": "arm", "points": [[0, 0, 0], [1, 0, 0]], "joints": ["elbow_left", "hand_left"]}],
    "root": {"joint": "hip_center", "axes": "xz", "turns": True, "feet": "lock", "walk": "in place"},
    "mirror": False,
    "scale": "auto",
    "smoothing": {"alpha": 0.6},
    "saved": True,
}


@pytest.fixture
def puppet():
    return puppet_of(MAPPING)


def test_each_change_of_the_mapping_is_a_request_and_walking_begins_with_the_hips(puppet):
    after = copy.deepcopy(puppet)
    after["handle"][0] |= {"joint": "head", "axes": "y", "gain": 2.0}
    after["handle"][1] |= {"joints": None, "joint": None}
    after["handle"][2] |= {"joints": ["hand_left", "hand_right"]}
    after["retarget"] = {"mirror": True, "scale": 1.5}
    after["root"] = None
    assert list(requests_of(puppet, after)) == [
        ("set_handle", {"handle": "head", "joints": "head", "axes": "y", "gain": 2.0}),
        ("set_handle", {"handle": "tail", "joints": None, "axes": "xy", "gain": -0.7}),
        ("set_handle", {"handle": "foot", "joints": "hand_left hand_right", "axes": "xyz", "gain": 1.0}),
        ("set_scale", {"scale": 1.5}),
        ("mirror", {"on": True}),
        ("set_root", {"joint": None}),
    ]
    assert list(requests_of(puppet, copy.deepcopy(puppet))) == []
    assert list(requests_of(puppet | {"root": None}, puppet | {"root": {}})) == [("set_root", {"joint": "hip_center"})]


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"limb": []}, "other limbs"),
        ({"smoothing": {"alpha": 0.3}}, "another smoothing"),
        ({"handle": []}, "other handles, or handles at other positions"),
        ({"retarget": {"mirror": False, "scale": "auto", "arm_space": 5}}, "retarget keys other than mirror and scale"),
    ],
)
def test_what_the_service_cannot_change_is_refused(puppet, change, found):
    with pytest.raises(ServiceError) as caught:
        list(requests_of(puppet, puppet | change))
    assert caught.value.found == found
