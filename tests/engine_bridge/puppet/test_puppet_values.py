import json

import pytest

from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet_values import merged, puppet_of, values_of
from puppetline.errors import PuppetError


def test_values_are_json_and_return_the_same_puppet(limbed_puppet):
    puppet = puppet_file.load(limbed_puppet)
    for deviation in (0.02, float("inf")):
        smoothing = puppet.smoothing.model_copy(update={"max_deviation": deviation})
        changed = puppet.model_copy(update={"smoothing": smoothing})
        values = json.loads(json.dumps(values_of(changed), allow_nan=False))
        assert puppet_of(values, "blob.glb") == changed


def test_the_page_does_not_choose_the_mesh(limbed_puppet):
    puppet = puppet_file.load(limbed_puppet)
    values = values_of(puppet) | {"character": {"mesh": "/etc/passwd", "up": "z", "front": "x"}}
    made = puppet_of(values, "blob.glb").character
    assert (made.mesh, made.up) == ("blob.glb", "z")
    assert puppet_of({key: value for key, value in values.items() if key != "character"}, "b").character.mesh == "b"
    moved = puppet.character.model_copy(update={"mesh": "/home/somebody/blob.glb"})
    assert values_of(puppet.model_copy(update={"character": moved}))["character"]["mesh"] == "blob.glb"


def test_a_mistake_is_named(limbed_puppet):
    values = values_of(puppet_file.load(limbed_puppet))
    values["limb"][1]["joints"][0] = "shoulder_centre"
    with pytest.raises(PuppetError) as caught:
        puppet_of(values, "blob.glb")
    assert caught.value.where == "the puppet, [[limb]] 2 'head', joints, 1"


def test_tables_are_merged_and_lists_replaced():
    values = {"root": {"joint": "head", "axes": "x"}, "limb": [1, 2], "vrm": None}
    assert merged(values, {"root": {"axes": "z"}, "limb": [3], "vrm": {"name": "Rex"}}) == {
        "root": {"joint": "head", "axes": "z"},
        "limb": [3],
        "vrm": {"name": "Rex"},
    }
    assert merged(values, {"root": None}) == values | {"root": None}
