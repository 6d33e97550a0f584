import json
import struct
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from engine_bridge.export.live_basis import Projection
from engine_bridge.service.protocol import payloads
from engine_bridge.service.protocol.frame import Frame
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
from engine_bridge.service.protocol.quantisation import BOX_STEPS
from engine_bridge.service.protocol.scene import Scene, StreamedCharacter
from solver.motion.deformer import Deformer

from ....oracles import assert_is_clause
from ..outputs.frames import frame_of
from .test_vectors import followed

ROOT = np.array([0.25, 0.0, -1.5])


class Basis:
    """Three morph targets, whatever the pose."""

    names = ("a", "b", "c")

    def project(self, R):
        return Projection(np.array([0.5, 0, 1], dtype=np.float32), 0.125, False)


@pytest.fixture(scope="module")
def character(blob_rig):
    return StreamedCharacter("dog", blob_rig, 3, Basis())


@pytest.fixture(scope="module")
def frame(character):
    """The figure, far from its rest pose."""
    rig = character.rig
    deformer = Deformer(rig.model, rig.mesh, rig.puppet.handle_positions)
    moved = np.array([[0.3, 0.6, 0.2], [-0.1, 0.9, 0.5], [0.2, -0.2, 0.3], [0, 0.2, 0.4], [0, 0, 0]])
    targets = deformer.handles + moved
    return Frame(
        character=character,
        sequence=12,
        time=1.25,
        received=123,
        state="performing",
        user=4,
        R=deformer.solve(targets),
        root=ROOT,
        targets=targets + ROOT,
        joints=np.arange(60.0).reshape(20, 3),
        confidence=np.linspace(0, 1, 20, dtype=np.float32),
    )


def message(frame, kind):
    return encode(kind, frame, 456)


def test_controls_and_the_scene_are_all_that_positions_and_normals_need(character, frame):
    scene = Scene.decode(character.scene)
    controls = decode(message(frame, Kind.CONTROLS)).body
    positions, normals = followed(scene.facts, scene.arrays, controls)
    expected, expected_normals = frame.vertices_and_normals
    assert np.abs(positions - expected).max() <= 1e-5 * character.rig.mesh.diagonal
    assert np.abs(normals - expected_normals).max() <= 1e-5


def test_a_frame_without_a_user_has_user_minus_one(frame):
    header = decode(encode(Kind.HANDLES, replace(frame, user=None, state="waiting"), 0)).header
    assert (header.user, header.state) == (-1, 0)


def test_quantised_vertices_are_off_by_half_a_step(frame):
    expected, expected_normals = frame.vertices_and_normals
    positions, normals = decode(message(frame, Kind.VERTICES16)).body
    assert (np.abs(positions - expected) <= 0.5 * np.ptp(expected, axis=0) / BOX_STEPS + 1e-6).all()
    assert np.abs(normals - expected_normals).max() < 1e-4


@pytest.mark.parametrize("count", range(1, 6))
def test_quantised_vertices_are_counted_by_the_length_whatever_the_padding(character, frame, count):
    some = frame.vertices_and_normals[:, :count]
    part = replace(frame)
    part.__dict__["vertices_and_normals"] = some
    positions, normals = decode(encode(Kind.VERTICES16, part, 0)).body
    assert positions.shape == normals.shape == (count, 3)
    np.testing.assert_allclose(positions, some[0], atol=1e-4)


def test_joints_carry_their_confidence_and_handles_the_root(frame):
    joints = decode(message(frame, Kind.JOINTS)).body
    np.testing.assert_array_equal(joints[:, :3], frame.joints)
    np.testing.assert_array_equal(joints[:, 3], frame.confidence)
    np.testing.assert_allclose(decode(message(frame, Kind.HANDLES)).body, frame.targets, rtol=1e-6)


def test_channels_are_their_values_by_name(frame):
    heard = replace(frame, channels={"voice": 0.123456, "blink_left": 1.0})
    assert decode(message(heard, Kind.CHANNELS)).body == {"voice": 0.1235, "blink_left": 1.0}


def test_morphs_are_a_residual_and_weights(frame):
    weights, residual = decode(message(frame, Kind.MORPHS)).body
    np.testing.assert_array_equal(weights, [0.5, 0, 1])
    assert residual == 0.125


def test_a_value_that_a_frame_lacks_gives_no_message(frame):
    bare = replace(frame, character=replace(frame.character, basis=None), joints=None, confidence=None)
    assert encode(Kind.CHANNELS, bare, 0) is None
    assert encode(Kind.JOINTS, bare, 0) is None
    assert encode(Kind.MORPHS, bare, 0) is None


def test_a_kind_of_a_later_minor_version_has_no_body():
    assert decode(join(topic_field("dog/new"), Header(kind=99, length=3, minor=1), b"abc")).body is None


def test_a_topic_of_another_kind_is_refused(frame):
    moved = topic("dog", Kind.VERTICES) + message(frame, Kind.CONTROLS)[64:]
    with pytest.raises(WireError, match="under the topic"):
        decode(moved)


def test_a_box_without_bounds_is_refused():
    payload = struct.pack("<6f", 0, 0, 0, float("inf"), 1, 1)
    with pytest.raises(WireError, match="bounds"):
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


def test_bones_at_rest_are_those_of_the_scene_moved_by_the_root(limbed_rig):
    character = StreamedCharacter("dog", limbed_rig, 3)
    still = np.tile(np.eye(4, 3), (sum(len(limb.points) - 1 for limb in limbed_rig.puppet.limbs), 1, 1))
    frame = frame_of(character, root=ROOT, motions=still)
    table = Scene.decode(memoryview(character.scene)).facts["bones"]
    values = decode(message(frame, Kind.BONES)).body
    turns, places = values[: 4 * len(table)].reshape(-1, 4), values[4 * len(table) :].reshape(-1, 3)
    np.testing.assert_allclose(turns, [bone["rotation"] for bone in table], atol=1e-5)
    travelling = [bone for bone in table if bone["travels"]]
    expected = [np.array(bone["position"]) + (ROOT if bone["parent"] < 0 else 0) for bone in travelling]
    np.testing.assert_allclose(places, expected, atol=1e-4)


def test_a_character_without_limbs_has_no_bones(frame):
    assert frame.character.skeleton is None
    assert message(frame, Kind.BONES) is None
