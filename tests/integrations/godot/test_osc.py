"""The addon's OSC reader and writer, compared with this project's decoder, and its receiver with the real service."""

import base64
import math
import random
import socket
import struct
from dataclasses import replace

import numpy as np
import pytest

from capture.network.osc import OscError, bundle, decode, encode
from capture.skeleton import JOINTS
from engine_bridge.service.outputs.osc import OscOutput, OscTable

from ...capture.network.test_osc import HOSTILE


@pytest.fixture
def read(start_godot, packed):
    """Have datagrams read, without a complaint, and written again."""

    def start(datagrams):
        script = start_godot("osc_packets.gd", packed(datagrams))
        results = script.finish()
        assert [line for line in script.lines if "nicode" in line] == []
        return results

    return start


def typed(argument):
    if argument is None:
        return ["Nil", None]
    if isinstance(argument, bool):
        return ["bool", argument]
    if isinstance(argument, int):
        return ["int", str((argument + 2**63) % 2**64 - 2**63)]
    if isinstance(argument, bytes):
        return ["bytes", base64.b64encode(argument).decode()]
    return ["float" if isinstance(argument, float) else "String", argument]


def told(datagram):
    """Return what the script is to say: what Python's decoder says, without addresses that OSC does not have."""
    try:
        messages = decode(datagram)
    except OscError:
        return []
    if not all(message.address.startswith("/") for message in messages):
        return []
    return [[message.address, list(map(typed, message.arguments))] for message in messages]


MESSAGES = [
    encode("/a"),
    encode("/puppetline/dog/joint/head", 1.5, -2.25, 3e-30, 1.0),
    encode("/texts", "", "abc", "abcd", "Grüße", "猫"),
    encode("/blobs", b"", b"1", b"1234", b"12345"),
    encode("/ints", 0, 1, -1, 2**31 - 1, -(2**31)),
    encode("/mixed", 1, 2.0, "three", 4.0, 5.0, b"six", 7),
    encode("/controls", np.random.default_rng(1).normal(size=960).astype(np.float32)),
    b"/t\0\0,TFNhdt\0" + struct.pack(">qdq", -(2**40), math.pi, 5),
    bundle(),
    bundle(encode("/a", 1), bundle(encode("/b", 2.0), encode("/c")), encode("/d", "x")),
]


def test_messages_are_read_as_by_python_and_written_back_unchanged(read):
    for datagram, result in zip(MESSAGES, read(MESSAGES), strict=True):
        assert result["messages"] == told(datagram), datagram
        again = [base64.b64decode(text) for text in result["written"]]
        if datagram.startswith(b"/") and not datagram.startswith(b"/t\0"):  # h, d and t come back as i, f and h
            assert again == [datagram]
        elif datagram.startswith(b"#"):
            assert again == [encode(message.address, *message.arguments) for message in decode(datagram)]


def test_damaged_datagrams_are_refused_exactly_where_python_refuses_them(read):
    chance = random.Random(5)
    small = [datagram for datagram in MESSAGES if len(datagram) < 200]
    damaged = [datagram[:length] for datagram in small for length in range(len(datagram))]
    for _ in range(1500):
        datagram = bytearray(chance.choice(small))
        for _ in range(chance.randint(1, 3)):
            datagram[chance.randrange(len(datagram))] = chance.choice([0, 1, 4, 44, 47, 97, 102, 105, 115, 127, 255])
        damaged.append(bytes(datagram))
    # decoders may differ about bytes that are no UTF-8 and addresses beyond ASCII
    damaged = [each for each in damaged if not any(byte > 126 or (0 < byte < 32) for byte in each)]
    others = {"bad address", "larger than a datagram", "too many messages"}  # limits that are only similar
    damaged += [datagram for reason, some in HOSTILE.items() if reason not in others for datagram in some]
    many = [bundle(*[encode("/a")] * count) for count in (600, 1023, 1025)]
    deepest = bundle(bundle(bundle(bundle(encode("/a")))))
    damaged += [*many, bundle(many[0], many[0]), deepest, bundle(deepest)]
    results = zip(damaged, read(damaged), strict=True)
    assert [datagram for datagram, result in results if result["messages"] != told(datagram)] == []


def test_texts_are_read_if_they_are_utf_8_and_refused_without_a_word_otherwise(read):
    texts = (b"\xff", b"\x80", b"\xc3", b"\xc0\xaf", b"\xe0\x80\xaf", b"\xed\xa0\x80", b"\xf4\x90\x80\x80")
    wrong = [
        datagram.replace(b"abcdabcd", text.ljust(8, b"x"))
        for text in texts
        for datagram in (encode("/a", "abcdabcd"), encode("/abcdabcd", 1.0), encode("/a/b", 1.0, "abcdabcd", b"c"))
    ]
    right = [encode("/a", text) for text in ("ÿ", "\u07ff", "\u0800", "\ud7ff", "\ue000", "𐀀", "\U0010ffff")]
    assert [result["messages"] for result in read(wrong + right)] == [[]] * len(wrong) + [*map(told, right)]


@pytest.fixture
def receive(start_godot):
    """Start a receiver on a free port; it is ready when this returns."""

    def start(character=""):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        script = start_godot("osc_receive.gd", port, character)
        script.until(lambda told: told["signal"] == "ready")
        return script, port

    return start


def test_frames_of_the_service_become_signals(receive, danced):
    script, port = receive()
    random = np.random.default_rng(2)
    joints, confidence = random.normal(size=(len(JOINTS), 3)), random.random(len(JOINTS)).astype(np.float32)
    joints[3] = np.nan  # never tracked
    frame = replace(danced[20], joints=joints, confidence=confidence)
    table = OscTable(host="127.0.0.1", port=port, send=("joints", "handles", "controls", "performer"))
    output = OscOutput(table)
    output.offer(frame)
    output.send_due()
    output.close()
    script.until(lambda told: told["signal"] == "performer")
    told = {each.pop("signal"): each for each in script.end()[1:]}
    known, handles = [*range(3), *range(4, len(JOINTS))], frame.character.prepared.puppet.handle
    assert [each.pop("of") for each in told.values()] == ["blob"] * 4
    assert told["joints"]["names"] == [JOINTS[joint] for joint in known]
    assert told["handles"]["names"] == [handle.name.replace(" ", "_") for handle in handles]
    assert told["performer"] == {"state": "performing", "user": 1}
    for found, expected in (
        (told["joints"]["places"], joints[known]),
        (told["joints"]["confidence"], confidence[known]),
        (told["handles"]["places"], frame.handles),
        (told["controls"]["numbers"], frame.pose.controls.ravel()),
    ):
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_one_character_is_picked_out_and_what_has_no_signal_is_passed_on(receive):
    script, port = receive("dog")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for datagram in (
            encode("/puppetline/cat/morphs", 1.0),
            encode("/puppetline/dog/morphs", 0.5, -0.25),
            bundle(encode("/puppetline/dog/residual", 0.125), encode("/puppetline/dog/root", 1.0, 2.0, 3.0)),
            encode("/puppetline/dog/controls", 1.0),
            encode("/puppetline/dog/performer", "waiting"),
            encode("/other", 1.0, "x"),
            b"no osc",
            random.Random(1).randbytes(512),
            bundle(
                encode("/puppetline/dog/handle/left/ear", 1.0, 2.0, 3.0),
                encode("/puppetline/cat/handle/tail", 1.0, 2.0, 3.0),
                encode("/puppetline/dog/handle/tail", 4.0, 5.0, 6.0),
            ),
            encode("/last"),
        ):
            sender.sendto(datagram, ("127.0.0.1", port))
        script.until(lambda told: told.get("address") == "/last")
    results = script.end()
    assert results[1:] == [
        {"signal": "weights", "of": "dog", "numbers": [0.5, -0.25]},
        {"signal": "message", "address": "/puppetline/dog/residual", "arguments": [0.125]},
        {"signal": "root", "of": "dog", "places": [[1, 2, 3]]},
        {"signal": "message", "address": "/puppetline/dog/controls", "arguments": [1]},
        {"signal": "message", "address": "/puppetline/dog/performer", "arguments": ["waiting"]},
        {"signal": "message", "address": "/other", "arguments": [1, "x"]},
        {"signal": "handles", "of": "dog", "names": ["left/ear", "tail"], "places": [[1, 2, 3], [4, 5, 6]]},
        {"signal": "message", "address": "/last", "arguments": []},
    ]


def test_a_port_that_is_taken_is_told_once(start_godot):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        script = start_godot("osc_receive.gd", port, "")
        script.until(lambda told: told["signal"] == "ready")
        script.end()
    warnings = [line for line in script.lines if "cannot listen" in line]
    assert len(warnings) == 1
    assert f"UDP port {port} of '127.0.0.1'" in warnings[0]
