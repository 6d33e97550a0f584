"""Messages that the JavaScript client decodes are those that Python decodes."""

import base64
import json
from pathlib import Path

import numpy as np
import pytest

from engine_bridge.service.protocol.header import Kind

from ...recorded import decoded, recorded
from ..messages import ARRAYS, HEADER, Messages

TYPES = {"Float32Array": "<f4", "Uint32Array": "<u4"}


def array(found):
    return np.zeros(0) if found is None else np.frombuffer(base64.b64decode(found["base64"]), TYPES[found["type"]])


def plain(told):
    """Return a message in the form that the common tests compare."""
    if "refused" in told:
        return None
    header, body = told["header"], told["body"]
    numbers = [*(header[name] for name in HEADER), *header["root"]]
    plain = {"topic": told["topic"], "header": [np.nan if each is None else float(each) for each in numbers]}
    if told["kind"] == "scene":
        arrays = {name: array(body["coordinates" if name == "ladder" else name]) for name in (*ARRAYS, "weights")}
        return plain | {"facts": body["description"], "arrays": arrays}
    if "vertices" in str(told["kind"]):
        return plain | {"values": np.concatenate([array(body["positions"]), array(body["normals"])])}
    if told["kind"] == "morphs":
        return plain | {"values": np.float32([body["residual"], *array(body["weights"])])}
    return plain | ({"values": array(body)} if isinstance(body, dict) and "base64" in body else {"json": body})


@pytest.fixture
def decode(node, packed):
    return lambda messages: json.loads(node("decode.mjs", packed(messages)))


class TestMessages(Messages):
    accepts = ("/weights/0: ", "/isolines: 1e")

    @pytest.fixture
    def read(self, decode):
        return lambda messages: [*map(plain, decode(messages))]


def test_a_kind_under_the_topic_of_another_is_refused(decode):
    controls, others = recorded("1.controls"), {*Kind} - {Kind.CONTROLS, Kind.CLIP}
    told = decode([controls[:66] + bytes([kind]) + controls[67:] for kind in others])
    assert all("refused" in each for each in told)


def test_controls_give_the_vertices_of_the_same_frame(decode):
    diagonal = decoded("scene").facts["diagonal"]
    _, *frames = decode(map(recorded, ("scene", *(f"{frame}.controls" for frame in range(3)))))
    for frame, told in enumerate(frames):
        expected, evaluated = decoded(f"{frame}.vertices"), told["evaluated"]
        np.testing.assert_allclose(array(evaluated["positions"]), expected.positions.ravel(), atol=1e-6 * diagonal)
        np.testing.assert_allclose(array(evaluated["normals"]), expected.normals.ravel(), atol=1e-5)


def test_the_modules_are_typed(node_program):
    """tsc --strict finds nothing."""
    node_program("node_modules/typescript/bin/tsc", "--project", Path(__file__).parents[3] / "integrations" / "web")
