"""The plain C# core follows the real service, through restarts, tokens, bad networks and worse peers."""

import re
import socket
import struct
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from engine_bridge.character import examples

from ...recorded import recorded
from ...waiting import wait_until
from .conftest import array

FRAMES = 20
FEW, EVERY = 6, 25
"""So many frames of a large character, one in so many: what tests tell each other is longer than what is sent."""


@pytest.fixture
def follow(start):
    """Follow a character with the plain core."""

    def run(port, character="", kind="controls", token="", every=1):
        return start("Core", "follow", "127.0.0.1", port, token, character, kind, every)

    return run


def frames(program, since=0):
    return {each["frame"]: array(each["values"], columns=6) for each in program.said[since:] if "frame" in each}


def common(program, reference, wanted=FRAMES, since=0):
    """Wait until both have so many frames of the same moments, and return those: (C#'s, Python's) each."""

    def both():
        theirs = dict(reference.frames)
        found = [(ours, theirs[n].body) for n, ours in frames(program, since).items() if n in theirs]
        return found if len(found) >= wanted else None

    return wait_until(both)


def assert_equal(both, diagonal, most=1e-6, normals_most=1e-5):
    """Positions agree; so do normals, but for the few vertices where f32 says no more (docs/protocol.md)."""
    for ours, theirs in both:
        assert np.abs(ours[:, :3] - theirs.positions).max() <= most * diagonal
        off = np.abs(ours[:, 3:] - theirs.normals).max(axis=1)
        assert off.max() <= 10 * normals_most
        assert np.mean(off > normals_most) <= 1e-3


def assert_moving(both, diagonal):
    assert max(np.abs(ours[:, :3] - both[0][0][:, :3]).max() for ours, _ in both) > 0.005 * diagonal


def moved(service, character, follow, reference):
    """Compare frames in which the character moves with the service's own vertices."""
    python = reference(service.stream, f"{character}/vertices", f"{character}/scene/python", every=EVERY)
    program = follow(service.port, character, every=EVERY)
    both = common(program, python, FEW)
    diagonal = python.scene.facts["diagonal"]
    assert_equal(both, diagonal)
    assert_moving(both, diagonal)
    scene = next(each for each in program.said if "scene" in each)
    assert (scene["character"], scene["vertices"]) == (character, python.scene.facts["vertices"])
    program.finish()


@pytest.mark.slow
@pytest.mark.parametrize("character", ["pegasus", "dog"])
def test_an_example_character_moves_as_the_service_has_it(
    serve, free_port, follow, reference, tmp_path, character, example_character, monkeypatch
):
    made = example_character(character)
    monkeypatch.setitem(examples.CHARACTERS, character, lambda: made)
    log, puppet = examples.prepare(character, tmp_path, lambda _stage, _share: None)
    port = free_port()
    service = serve("--puppet", puppet, "--source", f"replay:{log}?loop", "--calibrate", "at_once", "--port", port)
    service.port = port
    moved(service, character, follow, reference)


@pytest.mark.slow
def test_a_textured_file_with_many_parts_moves_as_the_service_has_it(
    serve, free_port, follow, reference, tmp_path, real_data, take, commands
):
    mesh = real_data / "mesh" / "gltf" / "kaykit_Knight.glb"
    puppet = tmp_path / "knight.toml"
    commands.run("new", mesh, "-o", puppet, cwd=tmp_path).check_returncode()
    port = free_port()
    service = serve("--puppet", puppet, "--source", f"replay:{take}?loop", "--calibrate", "at_once", "--port", port)
    service.port = port
    moved(service, "knight", follow, reference)


@pytest.mark.parametrize(("kind", "most", "normals_most"), [("vertices", 1e-7, 1e-6), ("vertices16", 1e-5, 2e-4)])
def test_vertices_come_as_they_were_sent(figure, follow, reference, kind, most, normals_most):
    python = reference(figure.stream, "blob/vertices", "blob/scene/python")
    program = follow(figure.port, "blob", kind)
    both = common(program, python)
    assert_equal(both, python.scene.facts["diagonal"], most, normals_most)
    program.finish()


def test_morph_weights_come_as_they_were_sent(figure, follow, reference):
    python = reference(figure.stream, "blob/morphs")
    program = follow(figure.port, "blob", "morphs")
    program.until(lambda said: "frame" in said and said["frame"] in python.frames)
    for said in program.finish():
        if "frame" in said and said["frame"] in python.frames:
            sent = python.frames[said["frame"]].body
            np.testing.assert_array_equal(array(said["values"]), np.float32([sent.residual, *sent.weights]))


def test_a_character_without_morph_targets_says_so(locked_figure, follow, token_file):
    program = follow(locked_figure.port, "blob", "morphs", token_file.read_text())
    assert "--morphs" in program.until(lambda said: said.get("reason"))["reason"]
    assert not any("frame" in said for said in program.finish())


def test_the_first_character_is_followed_if_none_is_named(figure, follow):
    program = follow(figure.port)
    assert program.until(lambda said: "scene" in said)["character"] == "blob"
    status = program.finish()[-1]["status"]
    assert [each["name"] for each in status["characters"]] == ["blob"]


def test_a_character_that_is_not_there_is_named_with_those_that_are(figure, follow):
    program = follow(figure.port, "unicorn")
    reason = program.until(lambda said: said.get("reason"))["reason"]
    assert "unicorn" in reason
    assert "blob" in reason


@pytest.mark.slow
def test_a_service_that_was_killed_is_followed_again_when_it_is_back(serve_figure, follow, reference):
    service = serve_figure()
    program = follow(service.port, "blob")
    program.until(lambda said: "frame" in said)
    service.process.kill()
    service.ended()
    lost = program.until(lambda said: said.get("state") == "Offline")
    assert f":{service.port}" in lost["reason"]
    since = len(program.said)
    again = serve_figure(port=service.port)
    program.until(lambda said: said.get("state") == "Connected", since)
    program.until(lambda said: "scene" in said, since)
    python = reference(again.stream, "blob/vertices", "blob/scene/python")
    both = common(program, python, since=since)
    assert_equal(both, python.scene.facts["diagonal"])
    program.finish()


@pytest.mark.slow
def test_a_reload_brings_another_scene(serve, blob_puppet, take, follow, free_port, tmp_path):
    puppet = tmp_path / "blob.toml"
    text = blob_puppet.read_text().replace("blob.glb", str(blob_puppet.with_name("blob.glb")))
    puppet.write_text(text)
    port = free_port()
    service = serve("--puppet", puppet, "--source", f"replay:{take}?loop", "--calibrate", "at_once", "--port", port)
    program = follow(port, "blob")
    first = program.until(lambda said: "scene" in said)
    puppet.write_text(text.replace("isolines = 6", "isolines = 7"))
    service.ask("reload")
    second = program.until(lambda said: "scene" in said and said["scene"] != first["scene"])
    program.until(lambda said: "frame" in said, program.said.index(second))
    program.finish()


def test_a_wrong_token_is_refused_and_not_tried_again(locked_figure, follow, token_file):
    client = locked_figure.client("service/status", token=token_file.read_bytes())
    before = client.until(lambda _: True)[-1].body["clients"]["refused"]
    program = follow(locked_figure.port, "blob", token="wrong")
    refused = program.until(lambda said: said.get("state") == "Refused")
    assert "does not accept the token" in refused["reason"]
    client.until(lambda message: message.body["clients"]["refused"] == before + 1)
    for _ in range(3):  # seconds, in which it would have tried again
        assert client.until(lambda _: True)[-1].body["clients"]["refused"] == before + 1
    assert [said.get("state") for said in program.finish()][-2:] == ["Refused", None]


def test_a_missing_token_and_one_too_many_are_guessed_at(figure, locked_figure, follow):
    """The service closes these connections without an error, so the client retries, as the protocol allows."""
    for port, token, reason in (
        (locked_figure.port, "", "may require a token"),
        (figure.port, "any", "may have no token"),
    ):
        program = follow(port, "blob", token=token)
        program.until(lambda said, reason=reason: said.get("state") == "Offline" and reason in said["reason"])
        program.finish()


def test_a_network_that_gives_one_byte_at_a_time_does_no_harm(locked_figure, follow, reference, token_file, line):
    token = token_file.read_text()
    python = reference(locked_figure.stream, "blob/vertices", "blob/scene/python", token=token)
    program = follow(line(locked_figure.port).port, "blob", token=token)
    both = common(program, python)
    assert_equal(both, python.scene.facts["diagonal"])
    program.finish()


GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)
SHAKEN = GREETING + b"\x04\x1a\x05READY\x0bSocket-Type\x00\x00\x00\x04XPUB"


def ping(context):
    return b"\x04" + bytes([7 + len(context)]) + b"\x04PING\x00\x00" + context


@pytest.fixture
def impostor(answering):
    """Have something say one thing to each who comes, wait for an answer, and close."""

    def start(*sayings, port=0):
        left, heard = list(sayings), []

        def answer(line):
            line.settimeout(1)
            line.sendall(left.pop(0) if left else b"")
            heard.append(b"")
            with suppress(TimeoutError):
                while some := line.recv(4096):
                    heard[-1] += some

        return answering(answer, port), heard

    return start


NOISE = np.random.default_rng(3).bytes(5000)
SAYINGS = {
    "nothing": (b"", "closed the connection"),
    "a page": (b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n" + b" " * 64, "does not support ZMTP 3"),
    "several parts": (SHAKEN + b"\x01\x01a\x00\x01b", "several parts"),
    "noise": (NOISE, "does not support ZMTP 3"),
    "another command": (GREETING + b"\x04\x06\x05HELLO", "did not follow the ZMTP handshake"),
    "ZMTP 2": (GREETING[:10] + b"\x01" + GREETING[11:], "does not support ZMTP 3"),
    "a message too early": (GREETING + b"\x00\x05READY", "did not follow the ZMTP handshake"),
    "a frame larger than memory": (SHAKEN + b"\x02" + b"\xff" * 8, "18446744073709551615 bytes"),
    "a frame larger than is taken": (SHAKEN + b"\x02" + struct.pack(">Q", (256 << 20) + 1), "268435457 bytes"),
    "a huge frame that never comes": (SHAKEN + b"\x02" + struct.pack(">Q", 256 << 20) + NOISE, "closed the connection"),
    "a huge command in the handshake": (GREETING + b"\x06" + struct.pack(">Q", 1 << 20), "1048576 bytes"),
    "messages that are none": (SHAKEN + b"\x00\x05hello" * 50 + b"\x00\x00" * 50, "closed the connection"),
    "a greeting and noise": (GREETING + b"\xf0" + NOISE, "data that is not ZMTP"),
    "broken commands": (SHAKEN + b"\x04\x00" + b"\x04\x05\x04PING" + b"\x04\x01\xff", "closed the connection"),
}
"""Each ends otherwise than the third before it, so that one sees that it has ended."""


@pytest.mark.slow
def test_the_service_is_followed_once_it_replaces_another_program_there(serve_figure, follow, impostor, free_port):
    """After a second each time, so that three clients at once meet a third of them each."""
    meetings = []
    for first in range(3):
        sayings = dict(list(SAYINGS.items())[first::3])
        server, _ = impostor(*(saying for saying, _ in sayings.values()), port=free_port())
        meetings.append((sayings, server, follow(server.port, "blob")))
    for sayings, server, program in meetings:
        since = 0
        for what, (_, reason) in sayings.items():
            said = program.until(
                lambda said, reason=reason: said["state"] == "Offline" and reason in said["reason"], since
            )
            since = program.said.index(said, since) + 1
            assert f":{server.port}" in said["reason"], what
        peak = next(
            int(line.split()[1])
            for line in Path(f"/proc/{program.process.pid}/status").read_text().splitlines()
            if line.startswith("VmHWM")
        )
        assert peak < 200_000  # KB: what was announced has taken no memory
        server.close()
        serve_figure(port=server.port)
        program.until(lambda said: "frame" in said, since)
        program.finish()


def test_a_ping_is_answered_with_its_context(follow, impostor):
    server, heard = impostor(SHAKEN + ping(b"") + ping(b"some context"))
    program = follow(server.port, "blob")
    program.until(lambda said: said.get("state") == "Offline")
    heard = heard[0]
    assert heard.index(b"\x04\x05\x04PONG") < heard.index(b"\x04\x11\x04PONGsome context")
    assert heard.startswith(GREETING + b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x03SUB")
    assert b"\x00\x0f\x01blob/controls\x00" in heard


def test_another_protocol_version_is_refused_by_its_number(follow, impostor):
    message = (b"service/status".ljust(64, b"\0") + b"\x02\x00\x09" + bytes(61) + b"{}").ljust(200, b"\0")
    server, _ = impostor(SHAKEN + b"\x00" + bytes([len(message)]) + message)
    program = follow(server.port, "blob")
    refused = program.until(lambda said: said.get("state") == "Refused")
    assert "version 2" in refused["reason"]
    program.finish()


@pytest.mark.slow
def test_a_service_that_says_nothing_any_more_is_left(follow, free_port):
    """It answers the handshake and then hangs, as a machine that has lost its network."""
    port = free_port()
    hanging = socket.create_server(("127.0.0.1", port))
    program = follow(port, "blob")
    held, _ = hanging.accept()
    held.sendall(SHAKEN)
    program.until(lambda said: said.get("state") == "Connected")
    reason = program.until(lambda said: said.get("state") == "Offline")["reason"]
    assert "has not sent a message" in reason
    held.close()
    hanging.close()
    program.finish()


def sent(topic, name):
    """Return a recorded message as it goes over the wire, under another topic."""
    message = topic.ljust(64, b"\0") + recorded(name)[64:]
    return b"\x02" + struct.pack(">Q", len(message)) + message


@pytest.mark.slow
def test_a_scene_may_take_longer_than_a_service_may_be_silent(follow, answering):
    """And is asked for less and less often meanwhile: each time, all of it would be sent again.

    It comes in nine parts with a second between them, and a frame behind it.
    """
    asked, met = [], []

    def send(line, scene):
        part = -(-len(scene) // 9)
        with suppress(OSError):
            for start in range(0, len(scene), part):
                line.sendall(scene[start : start + part])
                time.sleep(1)
            line.sendall(sent(b"worm/controls", "1.controls"))

    def answer(line):
        met.append(line)
        line.sendall(SHAKEN)
        while some := line.recv(4096):
            for topic in re.findall(rb"\x01(worm/scene/\w+)\0", some):
                asked.append(time.monotonic())
                if len(asked) == 1:
                    threading.Thread(target=send, args=(line, sent(topic, "scene"))).start()

    program = follow(answering(answer).port, "worm")
    program.until(lambda said: "frame" in said)
    states = [said["state"] for said in program.finish() if said.get("state") in ("Connected", "Offline")]
    assert (states, len(met)) == (["Connected"], 1)
    pauses = np.diff(asked)
    assert len(pauses) >= 2
    assert (np.diff(pauses) > 0).all()
