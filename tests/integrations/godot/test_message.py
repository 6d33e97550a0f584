"""Messages parsed by the addon are equal to those parsed by the service's own decoder."""

import base64
import json
import struct

import numpy as np
import pytest

from engine_bridge.service.protocol.header import FRAME_KINDS, Kind, WireError, split

from ...recorded import EXPECTED, NAMES, recorded


@pytest.fixture
def decoded(run_godot, tmp_path):
    """Have messages decoded."""

    def decode(messages, **more):
        path = tmp_path / "messages"
        path.write_bytes(b"".join(struct.pack("<I", len(message)) + message for message in messages))
        return run_godot("decode.gd", path, **more)

    return decode


def told(message):
    """Return the expected report of a message."""
    try:
        topic, header, payload, targets = split(message)
    except WireError:
        return {"damaged": True}
    if not np.isfinite([header.time, *header.root]).all():
        return {"damaged": True}
    moments = ("sequence", "received", "published")  # GDScript has no unsigned integers
    return {
        "topic": topic,
        **{name: getattr(header, name) for name in ("major", "minor", "kind", "state", "user", "revision", "time")},
        **{name: str(np.uint64(getattr(header, name)).astype(np.int64)) for name in moments},
        "root": list(header.root),
        "length": header.length,
        "is_frame": header.kind in FRAME_KINDS,
        "targets": base64.b64encode(targets).decode(),
        "payload": base64.b64encode(payload).decode(),
    }


def rounded(text):
    """Read JSON without the last digits of its numbers, in which readers differ."""
    return json.loads(text, parse_float=lambda number: round(float(number), 9))


def test_recorded_messages_are_what_they_are_for_python(decoded):
    names = [name for name in NAMES if not name.endswith("scene")]
    results = decoded(map(recorded, names))
    for name, result in zip(names, results, strict=True):
        parsed = result.pop("json")
        assert result == told(recorded(name)), name
        assert {key: result[key] for key in ("topic", "kind", "revision", "user", "root")} == {
            "topic": EXPECTED[name]["topic"],
            **{key: EXPECTED[name]["header"][key] for key in ("kind", "revision", "user", "root")},
        }
        if EXPECTED[name]["header"]["kind"] in (Kind.PERFORMER, Kind.STATUS, Kind.CHARACTERS):
            assert rounded(json.dumps(parsed)) == rounded(recorded(name)[128:])


def test_truncated_or_altered_messages_are_refused_exactly_where_python_refuses_them(decoded):
    whole = recorded("1.handles")
    altered = [whole[:length] for length in range(len(whole))]
    random = np.random.default_rng(3)
    for _ in range(400):
        bytes_ = bytearray(whole)
        for place in random.integers(0, 128, random.integers(1, 4)):
            bytes_[place] = random.choice([0, 1, 2, 4, 127, 128, 255])
        bytes_[66] = whole[66] if bytes_[66] == 1 else bytes_[66]  # a scene is another test's
        altered.append(bytes(bytes_))
    results = decoded(altered)
    assert len(results) == len(altered)
    for message, result in zip(altered, results, strict=True):
        result.pop("json", None)
        if not result.get("damaged") and result["major"] > 1:  # said with its version, so that somebody can be told
            assert result == {**result, "major": message[64], "minor": message[65], "length": 0}
            continue
        assert result == told(message), message[:128]


def test_additions_of_a_later_minor_version_are_ignored(decoded):
    message = bytearray(recorded("1.handles"))
    message[65] = 9
    [result] = decoded([bytes(message) + b"and more"])
    assert result["payload"] == base64.b64encode(recorded("1.handles")[128:]).decode()
    assert (result["major"], result["minor"]) == (1, 9)
