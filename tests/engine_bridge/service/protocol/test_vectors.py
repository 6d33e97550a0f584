"""The recorded messages, read and written by this project.

`tests/examples/test_clients.py` has what another one makes of a scene and of controls.
"""

import json

import numpy as np
import pytest

from engine_bridge.service.protocol.header import FRAME_KINDS, Kind, join, split, topic_field

from ....modules import load
from ....recorded import EXPECTED, VECTORS, recorded


def floats(message):
    return np.frombuffer(split(message).payload, "<f4")


@pytest.fixture(scope="module")
def recorder():
    """The script that has recorded them."""
    return load("tests/vectors/record.py")


def test_there_is_one_of_every_kind_that_belongs_to_a_character():
    kinds = {EXPECTED[path.stem]["header"]["kind"] for path in VECTORS.glob("*.bin")}
    assert kinds == {*FRAME_KINDS, Kind.SCENE, Kind.PERFORMER, Kind.CHARACTERS}
    assert {path.stem for path in VECTORS.glob("*.bin")} == set(EXPECTED)


def assert_same(a, b, tolerance):
    """Two values of JSON are the same, except for their fractions; what is zero may be so but for rounding."""
    if isinstance(b, dict):
        assert a.keys() == b.keys()
        for key in b.keys() - {"digest"}:  # of bytes with fractions
            assert_same(a[key], b[key], tolerance)
    elif isinstance(b, list):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            assert_same(one, other, tolerance)
    else:
        assert a == (pytest.approx(b, rel=tolerance, abs=tolerance) if isinstance(b, float) else b)


def said(recorder, message):
    return json.loads(json.dumps(recorder.expected(message)))


FLOATS = ("controls", "morphs", "vertices", "joints", "handles")
OF_LIMBS = [*range(12), 16, 17, 18]
"""Rotations of the bones of limbs, and where the first is; the solver moves the one of a handle."""


def test_messages_are_read_and_written_as_they_were_recorded(recorder):
    made = recorder.messages()
    assert set(made) == set(EXPECTED)
    for name, expected in EXPECTED.items():
        old = recorded(name)
        assert_same(said(recorder, old), expected, 1e-6)
        message = split(old)
        assert join(topic_field(message.topic), message.header, message.payload) == old
        if name != "limbed.scene":  # whose fields differ somewhat from one machine to the next
            assert_same(said(recorder, made[name]), expected, 1e-3)
        if name.endswith("bones"):
            np.testing.assert_allclose(floats(made[name])[OF_LIMBS], floats(old)[OF_LIMBS], atol=1e-6)
        if name.endswith(FLOATS):
            np.testing.assert_allclose(floats(made[name]), floats(old), rtol=1e-3, atol=1e-3)
        if name != "scene":  # whose description holds numbers of any length
            assert made[name][:128] == old[:128]
            assert len(made[name]) == len(old)
