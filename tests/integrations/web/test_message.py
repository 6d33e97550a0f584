"""Messages that the JavaScript client decodes are those that Python decodes."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from engine_bridge.service.protocol.header import PAYLOAD_OFFSET, Kind, WireError, split
from engine_bridge.service.protocol.payloads import decode
from engine_bridge.service.protocol.scene import Scene

from ...recorded import VECTORS

FILES = sorted(path.name for path in VECTORS.glob("*.bin"))
TYPES = {"Float32Array": "<f4", "Uint32Array": "<u4"}
NAMES = {
    "positions": "positions",
    "normals": "normals",
    "coordinates": "ladder",
    "slopes": "slopes",
    "colors": "colors",
}


@pytest.fixture(scope="module")
def decoded(node):
    """The vectors as the JavaScript client reads them, by file name."""
    return json.loads(node("decode.mjs", VECTORS))


def array(found):
    return np.frombuffer(base64.b64decode(found["base64"]), TYPES[found["type"]])


@pytest.mark.parametrize("name", FILES)
def test_topic_and_header_are_those_of_python(decoded, name):
    expected = split((VECTORS / name).read_bytes())
    found = decoded[name]
    header = dict(found["header"], root=tuple(found["header"]["root"]))
    assert (found["topic"], found["kind"]) == (expected.topic, Kind(expected.header.kind).word)
    assert header | {key: int(header[key]) for key in ("received", "published")} == expected.header._asdict()


@pytest.mark.parametrize("name", FILES)
def test_the_numbers_of_every_kind_are_those_of_python(decoded, name):
    expected, found = decode((VECTORS / name).read_bytes()).body, decoded[name]["body"]
    if isinstance(expected, Scene):
        assert found["description"] == expected.facts
        for mine, theirs in NAMES.items():
            np.testing.assert_array_equal(array(found[mine]), expected.arrays[theirs].ravel())
        np.testing.assert_array_equal(array(found["triangles"]), expected.arrays["triangles"].ravel())
        assert found["uv"] is None
    elif isinstance(expected, dict | list):
        assert found == expected
    elif hasattr(expected, "residual"):
        assert np.float32(found["residual"]) == np.float32(expected.residual)
        np.testing.assert_array_equal(array(found["weights"]), expected.weights)
    elif hasattr(expected, "positions"):
        np.testing.assert_array_equal(array(found["positions"]), expected.positions.ravel())
        if "16" in name:  # computed in double precision here, in single precision there
            np.testing.assert_allclose(array(found["normals"]), expected.normals.ravel(), atol=1e-6)
        else:
            np.testing.assert_array_equal(array(found["normals"]), expected.normals.ravel())
    else:
        np.testing.assert_array_equal(array(found), expected.ravel())


@pytest.mark.parametrize("frame", [0, 1, 2])
def test_controls_give_the_vertices_of_the_same_frame(decoded, frame):
    expected = decode((VECTORS / f"{frame}.vertices.bin").read_bytes()).body
    evaluated = decoded[f"{frame}.controls.bin"]["evaluated"]
    diagonal = decoded["scene.bin"]["body"]["description"]["diagonal"]
    np.testing.assert_allclose(array(evaluated["positions"]), expected.positions.ravel(), atol=1e-6 * diagonal)
    np.testing.assert_allclose(array(evaluated["normals"]), expected.normals.ravel(), atol=1e-5)


def test_damaged_messages_are_refused_as_by_python(node, tmp_path):
    random = np.random.default_rng(3)
    damaged = {}
    for name in FILES:
        whole = (VECTORS / name).read_bytes()
        for number in range(40):
            end = int(random.integers(0, len(whole)))
            damaged[f"{name}.cut{number}.bin"] = whole[:end]
            other = bytearray(whole)
            region = PAYLOAD_OFFSET + 8 if number % 2 else len(whole)
            other[random.integers(0, min(region, len(whole)))] = random.integers(0, 256)
            damaged[f"{name}.changed{number}.bin"] = bytes(other)
    for name, content in damaged.items():
        (tmp_path / name).write_bytes(content)
    found = json.loads(node("decode.mjs", tmp_path))
    refused = set()
    for name, content in damaged.items():
        try:
            decode(content)
        except WireError:
            refused.add(name)
    assert {name for name, message in found.items() if "refused" in message} == refused
    assert 0.5 < len(refused) / len(damaged) < 1


def test_the_modules_are_typed(node_program):
    """tsc --strict finds nothing."""
    node_program("node_modules/typescript/bin/tsc", "--project", Path(__file__).parents[3] / "integrations" / "web")
