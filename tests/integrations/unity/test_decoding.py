"""Messages read by the plain C# core are equal to those read by Python, and damaged ones are rejected."""

import base64
import json
import struct

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import decode
from engine_bridge.service.states import STATES

from ...recorded import NAMES, VECTORS, decoded, recorded
from .conftest import array

KINDS = {kind: kind.name.capitalize() for kind in Kind}


@pytest.fixture(scope="module")
def read(run_core, tmp_path_factory):
    """Have files read as messages."""
    folder = tmp_path_factory.mktemp("read")

    def of(paths):
        names = folder / "names"
        names.write_text("\n".join(map(str, paths)))
        return run_core("decode", names)

    return of


@pytest.fixture(scope="module")
def vectors(read):
    return dict(zip(NAMES, read(VECTORS / f"{name}.bin" for name in NAMES), strict=True))


@pytest.mark.parametrize("name", NAMES)
def test_recorded_messages_have_the_same_topic_and_header(vectors, name):
    expected = decode(recorded(name))
    head = expected.header
    kind, state, *rest = vectors[name]["header"]
    assert vectors[name]["topic"] == expected.topic
    assert (kind, state.lower()) == (KINDS[head.kind], STATES[head.state])
    numbers = (head.user, head.revision, head.sequence, head.time, head.received, head.published, *head.root)
    assert tuple(rest) == numbers


@pytest.mark.parametrize("name", [name for name in NAMES if name[0].isdigit() or name == "limbed.bones"])
def test_recorded_frames_have_the_same_numbers(vectors, name):
    body = decoded(name)
    found = array(vectors[name]["values"])
    assert vectors[name]["finite"]
    if "vertices16" in name:
        expected = np.concatenate([body.positions.ravel(), body.normals.ravel()])
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    elif "vertices" in name:
        np.testing.assert_array_equal(found, np.concatenate([body.positions.ravel(), body.normals.ravel()]))
    elif "morphs" in name:
        np.testing.assert_array_equal(found, np.float32([body.residual, *body.weights]))
    else:
        np.testing.assert_array_equal(found, body.ravel())


@pytest.mark.parametrize("name", ["performer", "characters", "limbed.channels"])
def test_recorded_json_is_the_same(vectors, name):
    assert vectors[name]["json"] == decoded(name)


def test_the_recorded_scene_is_the_same(vectors):
    found, expected = vectors["scene"], decoded("scene")
    facts, arrays = expected.facts, expected.arrays
    assert found["description"] == facts
    names = ("revision", "vertices", "triangles", "fields", "isolines")
    assert found["counts"] == [*(facts[name] for name in names), len(facts["parts"]), len(facts["morphs"])]
    assert found["diagonal"] == pytest.approx(facts["diagonal"], rel=1e-6)
    np.testing.assert_array_equal(array(found["weights"]), np.float32(facts["weights"]))
    np.testing.assert_array_equal(array(found["triangles"], np.int32), arrays["triangles"].ravel())
    for name in ("positions", "normals", "ladder", "slopes", "colors"):
        np.testing.assert_array_equal(array(found[name]), arrays[name].ravel())
    assert (found["uv"], "uv" in arrays) == ("", False)


def test_messages_cut_off_anywhere_are_refused(read, tmp_path):
    """But not where only what a later version may add behind the payload is missing: here, nothing."""
    paths = []
    for name in ("1.controls", "1.joints", "1.vertices16", "performer"):
        whole = recorded(name)
        for length in {0, 1, 63, 64, 127, 128, 129, len(whole) // 2, len(whole) - 1}:
            paths.append(tmp_path / f"{name}.{length}")
            paths[-1].write_bytes(whole[:length])
    said = read(paths)
    assert len(said) == len(paths)
    assert {each.get("refused") for each in said} == {"message"}


def damaged_scenes():
    """Scenes with a wrong description."""
    whole = recorded("scene")
    head, payload = whole[:128], whole[128:]
    start = 4 + int.from_bytes(payload[:4], "little")
    facts, arrays = json.loads(payload[4:start]), payload[start:]

    def rewritten(change, more=b""):
        told = json.loads(json.dumps(facts))
        change(told)
        text = json.dumps(told).encode()
        content = struct.pack("<I", len(text)) + text + arrays + more
        return head[:76] + struct.pack("<I", len(content)) + head[80:] + content

    def entry(name, key, value):
        return lambda told: told["arrays"][name].__setitem__(key, value)

    yield "a description longer than all", head + struct.pack("<I", 2**32 - 1) + payload[4:]
    yield "no description", head[:76] + struct.pack("<I", 3) + head[80:] + payload[:3]
    for name in ("vertices", "triangles", "fields", "isolines", "weights", "arrays", "parts"):
        if name != "parts":
            yield f"no {name}", rewritten(lambda told, name=name: told.pop(name))
        yield f"{name} that are a text", rewritten(lambda told, name=name: told.__setitem__(name, [{"vertices": "x"}]))
    for number in (0, -1, 1.5, 161, 10**9, 1e300):
        yield f"{number} vertices", rewritten(lambda told, number=number: told.__setitem__("vertices", number))
    for name in ("positions", "triangles", "ladder", "slopes", "normals", "colors"):
        yield f"{name} beyond the end", rewritten(entry(name, "offset", 10**6))
        yield f"{name} at an odd place", rewritten(entry(name, "offset", 2))
        yield f"{name} before the beginning", rewritten(entry(name, "offset", -4))
        yield f"{name} of a huge shape", rewritten(entry(name, "shape", [2**31, 2**31]))
        yield f"{name} of another type", rewritten(entry(name, "type", "f64"))
    for value, what in ((float("nan"), "no number"), (float("inf"), "infinite"), (4.5, "beyond"), (-0.5, "below")):
        place = 128 + start + facts["arrays"]["ladder"]["offset"]
        yield f"isoline_coordinates {what}", whole[:place] + struct.pack("<f", value) + whole[place + 4 :]
    place = 128 + start + facts["arrays"]["positions"]["offset"]
    yield "a position that is no number", whole[:place] + struct.pack("<f", float("nan")) + whole[place + 4 :]
    place = 128 + start + facts["arrays"]["triangles"]["offset"]
    yield "a triangle of another vertex", whole[:place] + struct.pack("<I", 162) + whole[place + 4 :]
    yield "a part beyond the triangles", rewritten(lambda told: told["parts"][0]["triangles"].__setitem__(1, 321))


def test_scenes_that_do_not_hold_what_they_say_are_refused_with_a_reason(read, tmp_path):
    scenes = dict(damaged_scenes())
    paths = []
    for number, content in enumerate(scenes.values()):
        paths.append(tmp_path / str(number))
        paths[-1].write_bytes(content)
    for what, said in zip(scenes, read(paths), strict=True):
        assert len(said.get("refused", "")) > 10, (what, said)


def test_bytes_changed_anywhere_are_refused_or_other_numbers(read, tmp_path):
    random = np.random.default_rng(5)
    paths = []
    for name in ("scene", "1.controls", "1.vertices16", "characters"):
        whole = np.frombuffer(recorded(name), np.uint8)
        for number in range(100):
            changed = whole.copy()
            places = random.integers(0, min(len(whole), 3000), 4)
            changed[places] = random.integers(0, 256, 4)
            paths.append(tmp_path / f"{name}.{number}")
            paths[-1].write_bytes(changed.tobytes())
    assert len(read(paths)) == len(paths)


def test_another_major_version_is_reported(read, tmp_path):
    whole = recorded("1.controls")
    (tmp_path / "two").write_bytes(whole[:64] + b"\2" + whole[65:])
    assert read([tmp_path / "two"]) == [{"refused": "message", "major": 2}]


def test_additions_of_a_later_minor_version_are_ignored(read, tmp_path, vectors):
    whole = recorded("1.controls")
    (tmp_path / "later").write_bytes(whole[:65] + b"\7" + whole[66:] + b"more")
    assert read([tmp_path / "later"]) == [vectors["1.controls"]]


def test_a_message_whose_weights_are_cut_off_is_refused(read, tmp_path):
    whole = recorded("1.controls")
    (tmp_path / "cut").write_bytes(whole[:124] + b"\2\0\0\0" + whole[128:] + b"\0" * 7)
    assert read([tmp_path / "cut"]) == [{"refused": "message", "major": 1}]


GOOD = [
    "null",
    " [ ] ",
    "{}",
    '{"a": [1, -0, 0.5, -1.25e-3, 1E+2, 1e300], "b": {"c": true, "d": false, "": null}}',
    r'"a\"\\\/\b\f\n\r\t\u00e4\ud83d\ude00ä😀"',
    '{"a": 1, "a": 2}',
    "[" * 30 + "]" * 30,
]
BAD = ["nul", "truer", "[1,]", "[1", '{"a"}', '{"a":}', '{"a":1,}', "{1:2}", "01", "-", "1.", ".5", "1e", "+1"]
BAD += ["0x1", "NaN", "Infinity", "1e999", '"a', r'"\x"', r'"\u12"']
BAD += ["", " ", "[1 2]", "1 2", '"\n"', r'"\u 123"', "\ufeff1"]
BAD += ["[" * 100_000, '{"a":' * 100_000, "[" + "0," * 300_000 + "0]"]


def read_json(run_core, texts):
    return run_core("json", told="".join(f"{base64.b64encode(text).decode()}\n" for text in texts))


def test_json_is_read_as_python_reads_it(run_core):
    assert [each["value"] for each in read_json(run_core, map(str.encode, GOOD))] == list(map(json.loads, GOOD))


def test_invalid_or_too_large_json_is_refused(run_core):
    texts = [*map(str.encode, BAD), b'"\xff"', b'"\xc3"', b'"\xed\xa0\x80"']
    for text, said in zip(texts, read_json(run_core, texts), strict=True):
        assert "refused" in said, text[:50]
