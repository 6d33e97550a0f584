"""The plain C# core follows the real service, through refusals, bad networks and worse peers, on a given clock."""

import re
import struct
import threading
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from engine_bridge.performance.exercise import random_poses
from engine_bridge.performance.rig import load_rig
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import decode, encode
from engine_bridge.service.protocol.scene import StreamedCharacter

from ...recorded import recorded
from ...waiting import wait_until
from .conftest import array, assert_equal


@pytest.fixture
def follow(start):
    """Follow a character with the plain core."""

    def run(port, character="", kind="controls", token=""):
        return start("Core", "follow", "127.0.0.1", port, token, character, kind)

    return run


def state(name, reason=""):
    """Tell whether something said is a state, and its reason contains a text."""
    return lambda said: said.get("state") == name and reason in said["reason"]


def followed(program, stage, count=5):
    """Send frames, each when the one before has come, and compare what is made of them with the service's vertices."""
    for frame in stage.next(count):
        stage.send(frame)
        said = program.until(lambda said, number=frame.sequence: said.get("frame") == number)
        theirs = decode(encode(Kind.VERTICES, frame, 0)).body
        assert_equal(array(said["values"], columns=6), theirs, stage.diagonal)
    program.finish()


@pytest.mark.slow
def test_a_textured_file_with_many_parts_moves_as_the_service_has_it(new_stage, follow, tmp_path, real_data, commands):
    puppet, mesh = tmp_path / "knight.toml", real_data / "mesh" / "gltf" / "kaykit_Knight.glb"
    commands.run("new", mesh, "-o", puppet, cwd=tmp_path).check_returncode()
    character = StreamedCharacter.of("knight", load_rig(puppet))
    controls, motions = random_poses(character.rig, 5)
    frames = [
        Frame(character, 1, 0.0, 0, "performing", 1, np.float64(R), np.zeros(3), np.zeros((0, 3)), motions=motion)
        for R, motion in zip(controls, motions, strict=True)
    ]
    stage = new_stage(frames)
    followed(follow(stage.port, "knight"), stage)


def test_the_first_character_is_followed_if_none_is_named_and_what_is_not_there_is_named(
    figure, locked_figure, follow, token_file
):
    program = follow(figure.port)
    assert program.until(lambda said: "scene" in said)["character"] == "blob"
    assert [each["name"] for each in program.finish()[-1]["status"]["characters"]] == ["blob"]
    reason = follow(figure.port, "unicorn").until(lambda said: said.get("reason"))["reason"]
    assert "unicorn" in reason
    assert "blob" in reason
    without = follow(locked_figure.port, "blob", "morphs", token_file.read_text())
    assert "--morphs" in without.until(lambda said: said.get("reason"))["reason"]
    assert not any("frame" in said for said in without.finish())


@pytest.mark.slow
def test_a_reload_brings_another_scene(serve_puppet, blob_puppet, take, follow, tmp_path):
    puppet = tmp_path / "blob.toml"
    text = blob_puppet.read_text().replace("blob.glb", str(blob_puppet.with_name("blob.glb")))
    puppet.write_text(text)
    service = serve_puppet(puppet, take)
    program = follow(service.port, "blob")
    first = program.until(lambda said: "scene" in said)
    puppet.write_text(text.replace("isolines = 6", "isolines = 7"))
    service.ask("reload")
    second = program.until(lambda said: "scene" in said and said["scene"] != first["scene"])
    program.until(lambda said: "frame" in said, program.said.index(second))
    program.finish()


def test_a_missing_token_is_guessed_at_and_a_wrong_one_is_refused_and_not_tried_again(
    figure, locked_figure, follow, token_file
):
    """Without a token, the service closes the connection without an error, and the client retries."""
    for port, token, reason in (
        (locked_figure.port, "", "may require a token"),
        (figure.port, "any", "may have no token"),
    ):
        other = follow(port, "blob", token=token)
        other.until(state("Offline", reason))
        other.finish()
    client = locked_figure.client("service/status", token=token_file.read_bytes())
    before = client.until(lambda _: True)[-1].body["clients"]["refused"]
    program = follow(locked_figure.port, "blob", token="wrong")
    program.until(state("Refused"))
    refused = client.until(lambda message: message.body["clients"]["refused"] > before)[-1].body["clients"]["refused"]
    for _ in range(2):  # as often as it would have tried again
        assert client.until(lambda _: True)[-1].body["clients"]["refused"] == refused
    assert [said.get("state") for said in program.finish()][-2:] == ["Refused", None]


def test_a_network_that_gives_a_few_bytes_at_a_time_does_no_harm(locked_figure, stage, follow, token_file, line):
    followed(follow(line(stage.port, piece=3).port, "blob"), stage)
    program = follow(line(locked_figure.port).port, "blob", token=token_file.read_text())
    program.until(state("Connected"))
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
    "nothing": b"",
    "a page": b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n" + b" " * 64,
    "several parts": SHAKEN + b"\x01\x01a\x00\x01b",
    "noise": NOISE,
    "another command": GREETING + b"\x04\x06\x05HELLO",
    "ZMTP 2": GREETING[:10] + b"\x01" + GREETING[11:],
    "a message too early": GREETING + b"\x00\x05READY",
    "a frame larger than memory": SHAKEN + b"\x02" + b"\xff" * 8,
    "a frame larger than is taken": SHAKEN + b"\x02" + struct.pack(">Q", (256 << 20) + 1),
    "a huge frame that never comes": SHAKEN + b"\x02" + struct.pack(">Q", 256 << 20) + NOISE,
    "a huge command in the handshake": GREETING + b"\x06" + struct.pack(">Q", 1 << 20),
    "messages that are none": SHAKEN + b"\x00\x05hello" * 50 + b"\x00\x00" * 50,
    "a greeting and noise": GREETING + b"\xf0" + NOISE,
    "broken commands": SHAKEN + b"\x04\x00" + b"\x04\x05\x04PING" + b"\x04\x01\xff",
}


def test_the_service_is_followed_once_it_replaces_another_program_there(serve_figure, follow, impostor, free_port):
    """A second later each time, by the given clock."""
    server, heard = impostor(*SAYINGS.values(), port=free_port())
    program = follow(server.port, "blob")
    since = 0
    for number, what in enumerate(SAYINGS, 1):
        said = program.until(state("Offline"), since)
        since = program.said.index(said, since) + 1
        assert f":{server.port}" in said["reason"], what
        assert len(heard) == number, what
        if number < len(SAYINGS):
            program.tell("1.01")
    status = Path(f"/proc/{program.process.pid}/status").read_text()
    assert int(re.search(r"VmHWM:\s+(\d+)", status)[1]) < 200_000  # KB: what was announced has taken no memory
    server.close()
    serve_figure(port=server.port)
    program.tell("1.01")
    program.until(lambda said: "frame" in said, since)
    program.finish()


def test_a_ping_is_answered_with_its_context(follow, impostor):
    server, heard = impostor(SHAKEN + ping(b"") + ping(b"some context"))
    follow(server.port, "blob").until(state("Offline"))
    heard = heard[0]
    assert heard.index(b"\x04\x05\x04PONG") < heard.index(b"\x04\x11\x04PONGsome context")
    assert heard.startswith(GREETING + b"\x04\x19\x05READY\x0bSocket-Type\x00\x00\x00\x03SUB")
    assert b"\x00\x0f\x01blob/controls\x00" in heard


def test_another_protocol_version_is_refused_by_its_number(follow, impostor):
    message = (b"service/status".ljust(64, b"\0") + b"\x02\x00\x09" + bytes(61) + b"{}").ljust(200, b"\0")
    server, _ = impostor(SHAKEN + b"\x00" + bytes([len(message)]) + message)
    follow(server.port, "blob").until(state("Refused", "version 2"))


def sent(topic, name):
    """Return a recorded message as it goes over the wire, under another topic."""
    message = topic.ljust(64, b"\0") + recorded(name)[64:]
    return b"\x02" + struct.pack(">Q", len(message)) + message


def test_a_slow_scene_is_asked_for_less_and_less_often_and_silence_of_six_seconds_is_the_end(follow, answering):
    """Each time, all of it would be sent again. It comes in parts, and takes longer than a service may be silent."""
    lines, scenes, asked, is_stopped = [], [], [], threading.Event()

    def answer(line):
        lines.append(line)
        is_stopped.wait()
        line.sendall(SHAKEN)
        with suppress(OSError):
            while some := line.recv(4096):
                scenes.extend(re.findall(rb"\x01(worm/scene/\w+)\0", some))

    program = follow(answering(answer).port, "worm")
    program.tell("0")
    program.until(lambda said: "turned" in said)
    is_stopped.set()
    wait_until(lambda: scenes)
    content = sent(scenes[0], "scene")
    # a second after the first request, two after the second, four after the third
    for number, (seconds, requests) in enumerate(
        [(0.9, 1), (0.2, 2), (1.9, 2), (0.2, 3), (3.9, 3), (0.2, 4), (1.0, 4)]
    ):
        lines[0].sendall(content[2500 * number : 2500 * (number + 1)])
        since = len(program.said)
        program.tell(str(seconds))
        program.until(lambda said: "turned" in said, since)
        wait_until(lambda requests=requests: len(scenes) >= requests)
        asked.append(len(scenes))
    assert asked == [1, 2, 2, 3, 3, 4, 4]
    lines[0].sendall(content[7 * 2500 :] + sent(b"worm/controls", "1.controls"))
    program.until(lambda said: "frame" in said)
    program.tell("5.9")
    program.tell("0.2")
    program.until(state("Offline", "has not sent a message"))
    assert [said["state"] for said in program.finish() if said.get("state") in ("Connected", "Offline")] == [
        "Connected",
        "Offline",
    ]
    assert len(lines) == 1
