import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_bridge.service.protocol.header import PAYLOAD_OFFSET, Header, Kind, WireError, join, topic, topic_field
from engine_bridge.service.protocol.payloads import decode, encode, message
from engine_bridge.service.protocol.scene import StreamedCharacter

from ....oracles import assert_is_clause
from ....recorded import NAMES, recorded
from ..outputs.frames import Basis, frame_of


@pytest.fixture(scope="module")
def frame(prepared_blob):
    """A frame of a character with morph targets and without limbs, of which no joints are known."""
    return frame_of(StreamedCharacter("dog", prepared_blob, 3, Basis()))


@pytest.mark.parametrize("count", range(1, 6))
def test_quantised_vertices_are_counted_by_the_length_whatever_the_padding(frame, count):
    some = frame.vertices_and_normals[:, :count]
    part = replace(frame)
    vars(part)["vertices_and_normals"] = some
    positions, normals = decode(encode(Kind.VERTICES16, part, 0)).body
    assert positions.shape == normals.shape == (count, 3)
    np.testing.assert_allclose(positions, some[0], atol=1e-4)


def test_a_value_that_a_frame_lacks_gives_no_message(frame):
    bare = replace(frame, character=replace(frame.character, basis=None))
    assert message(Kind.MORPHS, frame) is message(Kind.MORPHS, frame)  # encoded once
    for kind in (Kind.CHANNELS, Kind.JOINTS, Kind.MORPHS, Kind.BONES):
        assert encode(kind, bare, 0) is None


def test_a_kind_of_a_later_minor_version_has_no_body():
    header = Header(kind=99, length=3, minor=9)
    later = decode(join(topic_field("dog/new"), header, b"abc"))
    assert later.header == header
    assert later.body is None


def test_a_topic_of_another_kind_and_a_box_without_bounds_are_refused():
    box = struct.pack("<6f", 0, 0, 0, float("inf"), 1, 1)
    for wrong in (topic("dog", Kind.VERTICES) + recorded("1.controls")[64:], payload_of(Kind.VERTICES16, box)):
        with pytest.raises(WireError):
            decode(wrong)


def payload_of(kind, payload):
    name = "service" if kind in (Kind.STATUS, Kind.CHARACTERS) else "dog"
    return join(topic(name, kind), Header(kind=kind, length=len(payload)), payload)


def changed(message, changes, cut):
    content = bytearray(message[: max(len(message) - cut, 1)])
    for place, byte in changes.items():
        content[place % len(content)] = byte
    return bytes(content)


RECORDED = [recorded(name) for name in NAMES if "scene" not in name]
PAYLOADS = st.builds(payload_of, st.sampled_from(Kind), st.binary(max_size=200))
CHANGES = st.dictionaries(st.integers(0, 200), st.integers(0, 255), max_size=5)
CHANGED = st.builds(changed, st.sampled_from(RECORDED), CHANGES, st.just(0) | st.integers(0, 150))


@settings(max_examples=400)
@given(PAYLOADS | CHANGED)
def test_any_message_is_understood_or_refused(content):
    try:
        received = decode(content)
    except WireError as error:
        assert_is_clause(error)
        return
    body, kind, length = received.body, received.header.kind, received.header.length
    assert length <= len(content) - PAYLOAD_OFFSET
    if kind in (Kind.CONTROLS, Kind.JOINTS, Kind.HANDLES):
        assert body.dtype == np.float32
        assert body.nbytes == length
        assert body.shape[1:] == {Kind.CONTROLS: (3, 4), Kind.JOINTS: (4,), Kind.HANDLES: (3,)}[kind]
        assert kind != Kind.JOINTS or len(body) == 20
    elif kind == Kind.MORPHS:
        assert body.weights.dtype == np.float32
        assert body.weights.shape == (length // 4 - 1,)
    elif kind in (Kind.VERTICES, Kind.VERTICES16):
        count = len(body.positions)
        assert body.positions.dtype == body.normals.dtype == np.float32
        assert body.positions.shape == body.normals.shape == (count, 3)
        assert length == (24 * count if kind == Kind.VERTICES else 24 + (6 * count + 3) // 4 * 4 + 4 * count)
