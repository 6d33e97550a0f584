"""The recorded messages, read by a client that knows docs/protocol.md and nothing of this project.

`tests/examples/test_clients.py` has what another one makes of a scene and of controls.
"""

import json
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from engine_bridge.service.protocol.header import FRAME_KINDS, Kind, join, split, topic_field

from ....modules import load
from ....recorded import EXPECTED, VECTORS, recorded


def payload(message):
    (length,) = struct.unpack_from("<I", message, 64 + 12)
    return message[128 : 128 + length]


def floats(message, *shape):
    return np.frombuffer(payload(message), "<f4").reshape(shape)


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
        if name.endswith(FLOATS):
            np.testing.assert_allclose(floats(made[name], -1), floats(old, -1), rtol=1e-3, atol=1e-3)
        if name != "scene":  # whose description holds numbers of any length
            assert made[name][:128] == old[:128]
            assert len(made[name]) == len(old)


@pytest.mark.parametrize("number", range(3))
def test_quantised_vertices_are_within_half_a_step(number):
    content = payload(recorded(f"{number}.vertices16"))
    low, high = np.frombuffer(content, "<f4", 6).reshape(2, 3).astype(float)
    n = (len(content) - 24) // 10
    positions = low + np.frombuffer(content, "<u2", 3 * n, 24).reshape(n, 3) / 65535 * (high - low)
    u, v = np.frombuffer(content, "<i2", 2 * n, 24 + (6 * n + 3) // 4 * 4).reshape(n, 2).T / 32767
    z = 1 - abs(u) - abs(v)
    x = np.where(z < 0, (1 - abs(v)) * np.where(u >= 0, 1, -1), u)
    y = np.where(z < 0, (1 - abs(u)) * np.where(v >= 0, 1, -1), v)
    normals = np.column_stack([x, y, z])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    expected, expected_normals = floats(recorded(f"{number}.vertices"), 2, -1, 3)
    assert (abs(positions - expected) <= 0.5 * (high - low) / 65535 + 1e-6).all()
    assert abs(normals - expected_normals).max() < 1e-4


def globals_of(bones, turns, places):
    """Global positions and rotations of joints by those relative to their parents."""
    out = []
    for bone, turn, place in zip(bones, turns, places, strict=True):
        above = out[bone["parent"]] if bone["parent"] >= 0 else (np.zeros(3), Rotation.identity())
        out.append((above[0] + above[1].apply(place), above[1] * Rotation.from_quat(turn)))
    return out


def test_bones_are_where_the_motions_of_the_limb_take_them(recorder):
    described = payload(recorded("limbed.scene"))
    bones = json.loads(described[4 : 4 + int.from_bytes(described[:4], "little")])["bones"]
    values = floats(recorded("limbed.bones"), -1)
    turns, moved = values[: 4 * len(bones)].reshape(-1, 4), iter(values[4 * len(bones) :].reshape(-1, 3))
    np.testing.assert_allclose(np.linalg.norm(turns, axis=1), 1, atol=1e-6)
    places = [next(moved) if bone["travels"] else bone["position"] for bone in bones]
    assert next(moved, None) is None
    rest = globals_of(bones, [bone["rotation"] for bone in bones], [bone["position"] for bone in bones])
    frame = recorder.limbed_frame()
    limb = {"hips": 0, "spine": 1, "chest": 1}
    assert [bone["name"] for bone in bones if bone["name"] in limb] == [*limb]
    for bone, (place, turn), (head, axes) in zip(bones, globals_of(bones, turns, places), rest, strict=True):
        if bone["name"] in limb:
            motion = frame.motions[limb[bone["name"]]]
            np.testing.assert_allclose(place, head @ motion[:3] + motion[3] + frame.root, atol=1e-5)
            np.testing.assert_allclose(turn.as_matrix(), motion[:3].T @ axes.as_matrix(), atol=1e-6)
