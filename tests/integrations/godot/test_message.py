"""Messages parsed by the addon are equal to those parsed by the service's own decoder."""

import base64
import json

import numpy as np
import pytest

from engine_bridge.service.protocol.header import FRAME_KINDS, Kind, WireError, split
from engine_bridge.service.protocol.scene import DecodedScene

from ..messages import ARRAYS, HEADER, Messages, scene_message, taken_apart

IN_JSON = (Kind.PERFORMER, Kind.STATUS, Kind.CHARACTERS, Kind.CHANNELS)


def plain(told):
    """Return a message in the form that the common tests compare."""
    if told.get("damaged") or told["major"] > 1:
        return None
    numbers = [int(told[name]) % 2**64 if isinstance(told[name], str) else told[name] for name in HEADER]
    plain = {"topic": told["topic"], "header": [*numbers, *told["root"]], "own": told}
    assert told["is_frame"] == (told["kind"] in FRAME_KINDS)
    if told["kind"] == Kind.SCENE:
        types = {"triangles": "<u4"}
        arrays = {
            name: np.frombuffer(base64.b64decode(told[name]), types.get(name, "<f4")) for name in (*ARRAYS, "weights")
        }
        return plain | {"facts": told["facts"], "arrays": arrays}
    if told["kind"] in IN_JSON:
        return plain | {"json": told["json"]}
    return plain | {"payload": base64.b64decode(told["payload"])}


def rounded(value):
    """Return JSON without the last digits of its numbers, in which readers differ."""
    return json.loads(json.dumps(value), parse_float=lambda number: round(float(number), 9))


@pytest.fixture
def decode(run_godot, packed):
    return lambda messages: run_godot("decode.gd", packed(messages))


class TestMessages(Messages):
    accepts = tuple(f"/arrays/{name}/offset: 2" for name in ARRAYS)

    @pytest.fixture
    def read(self, decode):
        return lambda messages: [*map(plain, decode(messages))]

    @staticmethod
    def same(one, other):
        return rounded(one) == rounded(other)

    @staticmethod
    def refuses(message):
        """The payload of a frame is left to whoever uses it, but no time or place may be infinite."""
        try:
            _, header, payload, _ = split(message)
            if header.kind == Kind.SCENE:
                DecodedScene.decode(payload)
        except WireError:
            return True
        return not np.isfinite([header.time, *header.root]).all()

    def assert_same(self, told, message):
        super().assert_same(told, message)
        own, (_, header, payload, targets) = told["own"], split(message)
        assert (base64.b64decode(own["targets"]), own["minor"]) == (targets, header.minor)
        if header.kind == Kind.SCENE:
            facts = DecodedScene.decode(payload).facts
            assert own["counts"] == [facts[name] for name in ("vertices", "triangles", "fields", "isolines")]
            np.testing.assert_allclose(own["bounds"], facts["bounds"], atol=1e-6)
            for handle, expected in zip(own["handles"], facts["handles"], strict=True):
                np.testing.assert_allclose(handle["position"], expected["position"], rtol=1e-6)
                assert (handle["name"], handle["joints"]) == (expected["name"], expected["joints"])
            assert own["scene_revision"] == facts["revision"]
            for name in ("diagonal", "joints", "morphs", "parts"):
                assert self.same(own[name], facts[name])


def unshowable():
    """Yield scenes that Python takes, with what Godot could not draw."""
    facts, arrays = taken_apart()
    part, handle = facts["parts"][0], facts["handles"][0]
    empty = part | {"vertices": [0, 0], "triangles": [0, 0]}
    for what, value in (
        *((what, "many") for what in ("bounds", "handles", "parts")),
        *(("weights", weights) for weights in ([0.5, 0.5, 0.5, 1e300], [1.5, 0, -0.5, 0], [2, 0, 0, 0])),
        ("diagonal", 1e300),
        ("bounds", [[0, 0, 0], [1, 1e39, 1]]),
        ("handles", [handle | {"position": [0, -1e39, 0]}]),
        *(("parts", [part | {"vertices": vertices}]) for vertices in ([0, 163], [0])),
        *(("parts", [part | {"triangles": triangles}]) for triangles in ([1, 320], [-1, 2])),
        ("parts", [empty | {"vertices": [0, 162]}, empty | {"vertices": [161, 1]}]),
        ("parts", [empty | {"triangles": [0, 320]}] * 2),
    ):
        yield scene_message(facts | {what: value}, arrays)


def test_a_scene_that_cannot_be_drawn_is_refused(decode):
    assert [told for told in decode([*unshowable()]) if not told.get("damaged")] == []


def test_a_material_is_complete_whatever_came(decode):
    facts, arrays = taken_apart()
    default = {
        "name": "",
        "base_color": [1, 1, 1, 1],
        "metallic": 1,
        "roughness": 1,
        "emissive": [0, 0, 0],
        "alpha_mode": "OPAQUE",
        "double_sided": False,
    }
    for material in (None, {}, {"base_color": [1, None, 2, 3], "emissive": "red", "double_sided": "yes"}):
        [told] = decode([scene_message({**facts, "parts": [{**facts["parts"][0], "material": material}]}, arrays)])
        assert told["parts"][0]["material"] == default
