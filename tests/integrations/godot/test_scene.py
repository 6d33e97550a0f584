"""Scenes read by the addon have the same arrays as with the service's own decoder, and both refuse the same scenes."""

import base64
import json
import struct

import numpy as np
import pytest

from engine_bridge.service.protocol.header import WireError, split
from engine_bridge.service.protocol.scene import Scene

from ...recorded import recorded

RECORDED = recorded("scene")
ARRAYS = {"triangles": "<i4", **dict.fromkeys(("positions", "normals", "ladder", "slopes", "uv", "colors"), "<f4")}


@pytest.fixture
def read(run_godot, tmp_path):
    """Have the payloads of scenes read."""

    def decode(payloads, **more):
        path = tmp_path / "messages"
        path.write_bytes(b"".join(struct.pack("<I", len(message)) + message for message in map(message_of, payloads)))
        return run_godot("decode.gd", path, **more)

    return decode


def message_of(payload):
    header = bytearray(RECORDED[:128])
    struct.pack_into("<I", header, 64 + 12, len(payload))
    return bytes(header) + payload


def payload_of(facts, arrays):
    text = json.dumps(facts).encode()
    text += b" " * (-len(text) % 8)
    return struct.pack("<I", len(text)) + text + arrays


def taken_apart():
    payload = bytes(split(RECORDED).payload)
    start = 4 + int.from_bytes(payload[:4], "little")
    return json.loads(payload[4:start]), payload[start:]


def rounded(value):
    """Return JSON without the last digits of its numbers, in which readers differ."""
    return json.loads(json.dumps(value), parse_float=lambda number: round(float(number), 9))


def assert_same(told, payload):
    scene = Scene.decode(payload)
    facts = scene.facts
    for name, dtype in ARRAYS.items():
        array = np.frombuffer(base64.b64decode(told[name]), dtype)
        np.testing.assert_array_equal(array, scene.arrays.get(name, np.zeros(0)).ravel(), err_msg=name)
    assert rounded(told["facts"]) == rounded(facts)
    assert told["counts"] == [facts[name] for name in ("vertices", "triangles", "fields", "isolines")]
    weights = np.frombuffer(base64.b64decode(told["weights"]), "<f4")
    np.testing.assert_array_equal(weights, np.float32(facts["weights"]))
    np.testing.assert_allclose(told["bounds"], facts["bounds"], atol=1e-6)
    np.testing.assert_allclose([each.pop("position") for each in told["handles"]],
                               [each["position"] for each in facts["handles"]], rtol=1e-6)  # fmt: skip
    assert told["handles"] == [{key: each[key] for key in ("name", "joints")} for each in facts["handles"]]
    same = ("revision", "diagonal", "joints", "morphs", "parts")
    assert rounded([told[name] for name in same]) == rounded([facts[name] for name in same])


def test_the_recorded_scene_is_what_it_is_for_python(read):
    payload = bytes(split(RECORDED).payload)
    [told] = read([payload])
    assert_same(told, payload)


def test_arrays_in_any_order_and_others_that_are_not_known(read):
    facts, arrays = taken_apart()
    extra = b"????" * 3
    turned = {name: {**entry, "offset": entry["offset"] + len(extra)} for name, entry in facts["arrays"].items()}
    uv = np.arange(2 * facts["vertices"], dtype="<f4")
    turned |= {
        "what": {"type": "f32", "shape": [3], "offset": 0},
        "uv": {"type": "f32", "shape": [facts["vertices"], 2], "offset": len(extra + arrays)},
    }
    payload = payload_of(
        {**facts, "arrays": dict(reversed(turned.items())), "news": [1]}, extra + arrays + uv.tobytes()
    )
    [told] = read([payload])
    assert_same(told, payload)
    np.testing.assert_array_equal(np.frombuffer(base64.b64decode(told["uv"]), "<f4"), uv)


def faulty():
    """Yield damaged scenes with a description of the damage."""
    facts, arrays = taken_apart()
    n, directory = facts["vertices"], facts["arrays"]

    def entry(name, **changed):
        return {**facts, "arrays": {**directory, name: {**directory[name], **changed}}}

    for what in ("vertices", "triangles", "fields", "isolines", "weights", "bounds", "arrays", "handles", "parts"):
        for value in (None, -1, 0, 1.5, 2**62, 1e300, "many", [], {}, [[]], True):
            if what in ("handles", "parts") and value == []:
                continue
            yield f"{what}: {value}", payload_of({**facts, what: value}, arrays)
    for name in ("triangles", "positions", "normals", "ladder", "slopes"):
        yield f"no {name}", payload_of({**facts, "arrays": {k: v for k, v in directory.items() if k != name}}, arrays)
        yield f"{name} of another type", payload_of(entry(name, type="f64"), arrays)
        yield f"{name} of another shape", payload_of(entry(name, shape=[n]), arrays)
        for offset in (-4, len(arrays), 2**40, 2**63, 1.5, None, "0"):
            yield f"{name} at {offset}", payload_of(entry(name, offset=offset), arrays)
    for vertex in (n, 2**31, 2**32 - 1):
        place = directory["triangles"]["offset"] + 40
        yield f"vertex {vertex}", payload_of(facts, arrays[:place] + struct.pack("<I", vertex) + arrays[place + 4 :])
    deep = b"[" * 100_000
    yield "deep", struct.pack("<I", len(deep)) + deep
    yield "not JSON", struct.pack("<I", 4) + b"{{}}" + arrays
    yield "no object", struct.pack("<I", 4) + b"[1] " + arrays
    yield "beyond its end", struct.pack("<I", 2**31) + b"{}"
    yield "nothing", b""
    yield "too short", b"\0\0"
    yield "cut off", payload_of(facts, arrays)[:-4]


def refused_by_python(payload):
    try:
        Scene.decode(payload)
    except WireError:
        return True
    return False


def test_a_scene_that_is_damaged_is_refused(read):
    names, payloads = zip(*faulty(), strict=True)
    assert [
        name
        for name, payload in zip(names, payloads, strict=True)
        if not refused_by_python(payload) and not name.startswith(("bounds", "handles", "parts", "isolines: 4"))
    ] == []  # these it leaves to its users
    results = read(payloads)
    assert [name for name, told in zip(names, results, strict=True) if not told.get("damaged")] == []


def test_numbers_that_a_mesh_cannot_have_are_refused(read):
    facts, arrays = taken_apart()
    wrong = [
        {"weights": [0.5, 0.5, 0.5, 1e300]},
        {"weights": [1.5, 0.0, -0.5, 0.0]},
        {"weights": [2.0, 0.0, 0.0, 0.0]},
        {"diagonal": 1e300},
        {"bounds": [[0, 0, 0], [1, 1e39, 1]]},
        {"handles": [{**facts["handles"][0], "position": [0, -1e39, 0]}]},
    ]
    told = read([payload_of({**facts, **each}, arrays) for each in wrong])
    assert [each for each, result in zip(wrong, told, strict=True) if not result.get("damaged")] == []


STRANGE = (None, True, -1, 1.5, 1e300, "x", [], [1, 2], [[1], {}], {}, {"x": [0]})


def altered(value):
    """Yield copies of JSON in each of which one thing is strange."""
    yield from STRANGE
    if isinstance(value, dict):
        for key, each in value.items():
            yield from ({**value, key: other} for other in altered(each))
    elif isinstance(value, list) and value:
        yield from ([other, *value[1:]] for other in altered(value[0]))


def test_a_scene_with_any_altered_description_is_complete_or_refused(read):
    facts, arrays = taken_apart()
    scenes = [each for each in altered({**facts, "joints": ["a"], "morphs": ["b"]}) if isinstance(each, dict)]
    [whole, *told] = read([payload_of(each, arrays) for each in (facts, *scenes)])
    same = [name for name in ("counts", "weights", *ARRAYS) if name != "colors"]
    accepted = [each for each in told if not each.get("damaged")]
    assert 0 < len(accepted) < len(told) == len(scenes)
    for each in accepted:
        assert [each[name] for name in same] == [whole[name] for name in same], each["facts"]
        assert each["colors"] in (whole["colors"], "")  # a character need not have them


def test_a_part_that_reaches_beyond_the_mesh_is_refused(read):
    facts, arrays = taken_apart()
    wrong = []
    for what, values in (("vertices", [0, 163]), ("triangles", [1, 320]), ("triangles", [-1, 2]), ("vertices", [0])):
        wrong.append(payload_of({**facts, "parts": [{**facts["parts"][0], what: values}]}, arrays))
    for what, values in (("vertices", [[0, 162], [161, 1]]), ("triangles", [[0, 320], [0, 320]])):
        rest = {"vertices": [0, 0], "triangles": [0, 0]}
        parts = [{**facts["parts"][0], **rest, what: each} for each in values]
        wrong.append(payload_of({**facts, "parts": parts}, arrays))
    assert [told.get("damaged") for told in read(wrong)] == [True] * len(wrong)


def test_a_material_is_complete_whatever_came(read):
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
    told = read(
        [
            payload_of({**facts, "parts": [{**facts["parts"][0], "material": material}]}, arrays)
            for material in (None, {}, {"base_color": [1, None, 2, 3], "emissive": "red", "double_sided": "yes"})
        ]
    )
    assert [each["parts"][0]["material"] for each in told] == [default] * 3
