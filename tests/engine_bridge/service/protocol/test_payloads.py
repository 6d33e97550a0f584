import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_bridge.service.protocol import payloads
from engine_bridge.service.protocol.header import (
    FRAME_KINDS,
    PAYLOAD_OFFSET,
    Header,
    Kind,
    WireError,
    join,
    topic,
    topic_field,
)
from engine_bridge.service.protocol.payloads import decode, encode
from engine_bridge.service.protocol.scene import Scene, StreamedCharacter

from ....oracles import assert_is_clause
from ..outputs.frames import Basis, frame_of


@pytest.fixture(scope="module")
def character(blob_rig):
    return StreamedCharacter("dog", blob_rig, 3, Basis())


@pytest.fixture(scope="module")
def frame(character):
    """The figure at rest, with a value of every kind that it has."""
    joints, confidence = np.arange(60.0).reshape(20, 3), np.linspace(0, 1, 20, dtype=np.float32)
    return frame_of(character, 12, joints=joints, confidence=confidence)


def message(frame, kind):
    return encode(kind, frame, 456)


@pytest.mark.parametrize("count", range(1, 6))
def test_quantised_vertices_are_counted_by_the_length_whatever_the_padding(character, frame, count):
    some = frame.vertices_and_normals[:, :count]
    part = replace(frame)
    part.__dict__["vertices_and_normals"] = some
    positions, normals = decode(encode(Kind.VERTICES16, part, 0)).body
    assert positions.shape == normals.shape == (count, 3)
    np.testing.assert_allclose(positions, some[0], atol=1e-4)


def test_a_value_that_a_frame_lacks_gives_no_message(frame):
    bare = replace(frame, character=replace(frame.character, basis=None), joints=None, confidence=None)
    kinds = [Kind.CHANNELS, Kind.JOINTS, Kind.MORPHS, Kind.BONES]
    assert [encode(kind, bare, 0) for kind in kinds] == [None] * 4
    assert bare.character.skeleton is None


def test_a_kind_of_a_later_minor_version_has_no_body():
    assert decode(join(topic_field("dog/new"), Header(kind=99, length=3, minor=1), b"abc")).body is None


def test_a_topic_of_another_kind_is_refused(frame):
    moved = topic("dog", Kind.VERTICES) + message(frame, Kind.CONTROLS)[64:]
    with pytest.raises(WireError):
        decode(moved)


def test_a_box_without_bounds_is_refused():
    payload = struct.pack("<6f", 0, 0, 0, float("inf"), 1, 1)
    with pytest.raises(WireError):
        decode(join(topic("dog", Kind.VERTICES16), Header(kind=Kind.VERTICES16, length=len(payload)), payload))


@given(kind=st.sampled_from(list(Kind)), payload=st.binary(max_size=200))
def test_any_payload_is_understood_or_refused(kind, payload):
    name = "service" if kind in (Kind.STATUS, Kind.CHARACTERS) else "dog"
    try:
        received = decode(join(topic(name, kind), Header(kind=kind, length=len(payload)), payload))
    except WireError as error:
        assert_is_clause(error)
        return
    assert_has_the_arrays_of(kind, received)
    if kind in FRAME_KINDS and kind not in (Kind.MORPHS, Kind.VERTICES, Kind.VERTICES16, Kind.CHANNELS):
        assert received.body.nbytes == len(payload)
    if kind in (Kind.PERFORMER, Kind.STATUS, Kind.CHARACTERS, Kind.CHANNELS):
        assert json.loads(payload) == received.body


def assert_has_the_arrays_of(kind, received):
    """Assert that a body is what the protocol has for its kind, of as many bytes as the payload."""
    body, length = received.body, received.header.length
    if kind in (Kind.CONTROLS, Kind.JOINTS, Kind.HANDLES):
        assert body.dtype == np.float32
        assert body.nbytes == length
        assert body.shape[1:] == {Kind.CONTROLS: (3, 4), Kind.JOINTS: (4,), Kind.HANDLES: (3,)}[kind]
        assert kind != Kind.JOINTS or len(body) == 20
    elif kind == Kind.MORPHS:
        assert (body.weights.dtype, body.weights.shape) == (np.float32, (length // 4 - 1,))
    elif kind in (Kind.VERTICES, Kind.VERTICES16):
        assert body.positions.dtype == body.normals.dtype == np.float32
        assert body.positions.shape == body.normals.shape == (len(body.positions), 3)
        count = len(body.positions)
        assert length == (24 * count if kind == Kind.VERTICES else 24 + (6 * count + 3) // 4 * 4 + 4 * count)
    elif kind == Kind.SCENE:
        assert isinstance(body, Scene)


@settings(max_examples=300)
@given(data=st.data(), kind=st.sampled_from([kind for kind in FRAME_KINDS if kind < Kind.BONES]))
def test_a_message_with_bytes_changed_is_understood_or_refused(frame, data, kind):
    content = bytearray(message(frame, kind))
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, min(200, len(content) - 1)))] = data.draw(st.integers(0, 255))
    cut = data.draw(st.integers(0, len(content)))
    try:
        received = decode(bytes(content[:cut]))
    except WireError as error:
        assert_is_clause(error)
        return
    assert received.header.length <= cut - PAYLOAD_OFFSET
    if received.header.kind == kind:
        assert_has_the_arrays_of(kind, received)


def test_every_kind_has_an_encoder_and_a_decoder():
    assert set(payloads._PARTS) == set(FRAME_KINDS)
    assert set(payloads._BODIES) == set(Kind)
