"""What every client makes of the recorded messages and of damaged ones, compared with Python's decoder.

The tests of a client derive a class from `Messages`, and give it the fixture `read`.
"""

import json
import struct

import numpy as np
import pytest

from engine_bridge.service.protocol.header import PAYLOAD_OFFSET, WireError, split
from engine_bridge.service.protocol.payloads import Vertices, decode
from engine_bridge.service.protocol.scene import DecodedScene

from ..recorded import NAMES, recorded

SCENE = recorded("scene")


def scene_message(facts, arrays):
    """Return the recorded scene's message with another description and other arrays."""
    text = json.dumps(facts).encode()
    text += b" " * (-len(text) % 8)
    payload = struct.pack("<I", len(text)) + text + arrays
    return SCENE[:76] + struct.pack("<I", len(payload)) + SCENE[80:PAYLOAD_OFFSET] + payload


def taken_apart():
    """Return the description of the recorded scene, and its arrays as bytes."""
    payload = bytes(split(SCENE).payload)
    start = 4 + int.from_bytes(payload[:4], "little")
    return json.loads(payload[4:start]), payload[start:]


def unusual():
    """Return messages that no service of today sends, and that are valid."""
    facts, arrays = taken_apart()
    extra = b"????" * 3
    moved = {name: {**entry, "offset": entry["offset"] + len(extra)} for name, entry in facts["arrays"].items()}
    moved["what"] = {"type": "f32", "shape": [3], "offset": 0}
    moved["uv"] = {"type": "f32", "shape": [facts["vertices"], 2], "offset": len(extra + arrays)}
    uv = np.arange(2 * facts["vertices"], dtype="<f4").tobytes()
    controls = recorded("1.controls")
    return {
        "arrays in another order and one more": scene_message(
            {**facts, "arrays": dict(reversed(moved.items())), "news": [1]}, extra + arrays + uv
        ),
        "a later minor version": controls[:65] + b"\7" + controls[66:] + b"more",
    }


def damaged():
    """Return recorded messages that are cut off or altered at random."""
    random, made = np.random.default_rng(3), {}
    for name in NAMES:
        whole = recorded(name)
        for number in range(40):
            made[f"{name}, cut {number}"] = whole[: random.integers(0, len(whole))]
            altered = bytearray(whole)
            region = PAYLOAD_OFFSET + 8 if number % 2 else len(whole)
            for place in random.integers(0, min(region, len(whole)), random.integers(1, 4)):
                altered[place] = random.choice([0, 1, 2, 4, 127, 128, 255])
            made[f"{name}, altered {number}"] = bytes(altered)
    controls = recorded("1.controls")
    made["weights that are cut off"] = controls[:124] + b"\2\0\0\0" + controls[128:] + b"\0" * 7
    return made


STRANGE = (None, True, -1, 2, 1.5, 1e300, 2**62, "x", [], [1, 2], [[1], {}], {}, {"x": [0]})


def altered(value, name=""):
    """Yield each strange value in the place of a value of JSON or of one in it, or none there, and where and what."""
    yield from ((f"{name}: {other}", other) for other in STRANGE)
    if isinstance(value, dict):
        for key, each in value.items():
            yield f"{name}/{key} missing", {other: kept for other, kept in value.items() if other != key}
            yield from ((what, {**value, key: other}) for what, other in altered(each, f"{name}/{key}"))
    elif isinstance(value, list) and value:
        yield from ((what, [other, *value[1:]]) for what, other in altered(value[0], f"{name}/0"))


def strange_scenes():
    """Yield messages of scenes with what is strange about them."""
    facts, arrays = taken_apart()
    facts |= {"joints": ["a"], "morphs": ["b"]}
    for what, value in altered(facts):
        if isinstance(value, dict):
            yield what, scene_message(value, arrays)
    for name, value in (
        *(("triangles", np.uint32(vertex)) for vertex in (facts["vertices"], 2**31, 2**32 - 1)),
        *(("ladder", np.float32(number)) for number in (np.nan, np.inf, 4.5, -0.5)),
        ("positions", np.float32(np.nan)),
    ):
        start = facts["arrays"][name]["offset"]
        yield f"{name} {value}", scene_message(facts, arrays[:start] + value.tobytes() + arrays[start + 4 :])
    for what, payload in {
        "deep": b"\xa0\x86\x01\0" + b"[" * 100_000,
        "no JSON": struct.pack("<I", 4) + b"{{}}",
        "a description beyond the end": struct.pack("<I", 2**31) + b"{}",
        "three bytes": b"\0\0\0",
        "cut off": SCENE[PAYLOAD_OFFSET:-4],
    }.items():
        yield what, SCENE[:76] + struct.pack("<I", len(payload)) + SCENE[80:PAYLOAD_OFFSET] + payload


def header_of(message):
    """Return topic and header in the form that `read` has; JavaScript has integers of 53 bits."""
    topic, header, *_ = split(message)
    numbers = [*(getattr(header, name) for name in HEADER), *header.root]
    return topic, pytest.approx(numbers, rel=1e-15, abs=0, nan_ok=True)


HEADER = ("kind", "state", "user", "revision", "sequence", "time", "received", "published")
ARRAYS = ("triangles", "positions", "normals", "ladder", "slopes", "uv", "colors")


class Messages:
    """Tests of a client's decoder.

    The fixture `read` takes messages, and returns for each None if the client refuses it, or: `topic`; `header`, the
    numbers of `HEADER` and the root; and of its body `json`, `payload` (bytes) or `values` (flat f32), or of a scene
    `facts` and `arrays`.
    """

    accepts = ()
    """What is strange about scenes that the client takes although Python does not: beginnings of names."""

    @staticmethod
    def refuses(message):
        """Tell whether Python refuses a message, and therefore the client."""
        try:
            decode(message)
        except WireError:
            return True
        return False

    @staticmethod
    def same(one, other):
        """Tell whether two values of JSON are the same for the client."""
        return one == other

    def assert_same(self, told, message):
        """Compare what a client has told of a message with what Python makes of it."""
        assert (told["topic"], told["header"]) == header_of(message)
        body = decode(message).body
        if isinstance(body, DecodedScene):
            assert self.same(told["facts"], body.facts)
            for name in ARRAYS:
                expected = body.arrays.get(name, np.zeros(0)).ravel()
                np.testing.assert_array_equal(told["arrays"][name], expected, err_msg=name)
            weights = told["arrays"].get("weights", body.facts["weights"])
            np.testing.assert_array_equal(np.float32(weights), np.float32(body.facts["weights"]))
        elif "payload" in told:
            assert told["payload"] == split(message).payload
        elif isinstance(body, dict | list):
            assert self.same(told["json"], body)
        else:
            expected = (
                np.concatenate([body.positions.ravel(), body.normals.ravel()])
                if isinstance(body, Vertices)
                else np.float32([body.residual, *body.weights])
                if hasattr(body, "residual")
                else body.ravel()
            )
            rounding = 1e-6 if "vertices16" in told["topic"] else 0  # single precision there, double precision here
            np.testing.assert_allclose(told["values"], expected, rtol=0, atol=rounding)

    def test_recorded_and_unusual_messages_are_what_they_are_for_python(self, read):
        messages = [*map(recorded, NAMES), *unusual().values()]
        for told, message in zip(read(messages), messages, strict=True):
            self.assert_same(told, message)

    def test_damaged_messages_are_refused_exactly_where_python_refuses_them(self, read):
        made = damaged()
        refused = [*map(self.refuses, made.values())]
        assert 0.5 < np.mean(refused) < 1
        results = read([*made.values()])
        assert [name for name, told, no in zip(made, results, refused, strict=True) if (told is None) != no] == []
        for message, told in zip(made.values(), results, strict=True):
            assert told is None or (told["topic"], told["header"]) == header_of(message)

    def test_a_strange_scene_is_complete_or_refused_at_least_where_python_refuses_it(self, read):
        names, messages = zip(*strange_scenes(), strict=True)
        whole, *results = read([SCENE, *messages])
        strange = zip(names, messages, results, strict=True)
        taken = [each for each in strange if each[-1] is not None and not each[0].startswith(self.accepts)]
        assert 0 < len(taken) < len(results)
        assert [name for name, message, _ in taken if self.refuses(message)] == []
        for name, _, told in taken:
            for array in ARRAYS:
                found, missing = told["arrays"][array], f"/arrays/{array} missing"
                alike = np.array_equal(found, whole["arrays"][array], equal_nan=True) or name == "positions nan"
                assert alike or (name == missing and not len(found)), name
