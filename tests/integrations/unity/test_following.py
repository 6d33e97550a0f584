"""The plain C# core follows the real service, through refusals, bad networks and worse peers, on a given clock."""

import re
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from engine_bridge.service.protocol.header import Kind
from engine_bridge.service.protocol.payloads import decode, encode

from ...recorded import recorded
from ...waiting import wait_until
from ..peers import AFTER_THE_HANDSHAKE, BEFORE_THE_HANDSHAKE, GREETING, MANY, NOISE, READY, command, large
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
def test_a_reload_brings_another_scene(serve, played, blob_file, write_puppet, follow):
    puppet = write_puppet(blob_file.with_name("changed.toml"), blob_file.name)
    service = serve("--puppet", puppet, *played[2:])
    program = follow(service.port)
    first = program.until(lambda said: "scene" in said)
    write_puppet(puppet, blob_file.name, more="[solver]\nisolines = 7", replaces=True)
    service.ask("reload")
    second = program.until(lambda said: "scene" in said and said["scene"] != first["scene"])
    program.until(lambda said: "frame" in said, program.said.index(second))
    program.finish()


def test_a_missing_token_and_one_too_many_are_guessed_at(figure, locked_figure, follow):
    """The service closes the connection without an error, and the client retries."""
    for port, token in ((locked_figure.port, ""), (figure.port, "any")):
        follow(port, "blob", token=token).until(state("Offline", "token"))


def test_a_network_that_gives_a_few_bytes_at_a_time_does_no_harm(locked_figure, stage, follow, token_file, line):
    followed(follow(line(stage.port, piece=3).port, "blob"), stage)
    program = follow(line(locked_figure.port).port, "blob", token=token_file.read_text())
    program.until(state("Connected"))
    program.finish()


def ping(context):
    return command(b"\x04PING\x00\x00" + context)


@pytest.fixture
def impostor(answering):
    """Have something say one thing to each who comes, wait for an answer, and close."""

    def start(*sayings, port=0):
        left, heard = list(sayings), []

        def answer(line):
            line.settimeout(1)
            heard.append(b"")
            line.sendall(left.pop(0) if left else b"")
            with suppress(TimeoutError):
                while some := line.recv(4096):
                    heard[-1] += some

        return answering(answer, port), heard

    return start


SHAKEN = GREETING + READY
SAYINGS = BEFORE_THE_HANDSHAKE | {
    what: SHAKEN + said
    for what, said in {
        **AFTER_THE_HANDSHAKE,
        "a huge frame that never comes": large(MANY) + NOISE,
        "messages that are none": b"\x00\x05hello" * 50 + b"\x00\x00" * 50,
    }.items()
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
            since = program.said.index(program.until(lambda told: "turned" in told, since), since)
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


def test_a_refusal_is_final(follow, impostor):
    server, heard = impostor(GREETING + command(b"\5ERROR\x0bgo away now"))
    program = follow(server.port, "blob")
    program.until(state("Refused"))
    program.tell("60")
    program.until(lambda said: "turned" in said)
    program.finish()
    assert len(heard) == 1


def test_another_protocol_version_is_refused_by_its_number(follow, impostor):
    message = (b"service/status".ljust(64, b"\0") + b"\x02\x00\x09" + bytes(61) + b"{}").ljust(200, b"\0")
    server, _ = impostor(SHAKEN + b"\x00" + bytes([len(message)]) + message)
    follow(server.port, "blob").until(state("Refused", "version 2"))


def sent(topic, name):
    """Return a recorded message as it goes over the wire, under another topic."""
    message = topic.ljust(64, b"\0") + recorded(name)[64:]
    return b"\x02" + len(message).to_bytes(8, "big") + message


def test_a_slow_scene_is_asked_for_less_and_less_often_and_silence_of_six_seconds_is_the_end(follow, answering):
    """Each time, all of it would be sent again. It comes in parts, and takes longer than a service may be silent."""
    lines, scenes, received, asked, is_stopped = [], [], bytearray(), [], threading.Event()

    def answer(line):
        lines.append(line)
        is_stopped.wait()
        line.sendall(SHAKEN)
        with suppress(OSError):
            while some := line.recv(4096):
                received.extend(some)
                scenes[:] = re.findall(rb"\x01(worm/scene/\w+)\0", received)

    program = follow(answering(answer).port, "worm")
    program.until(state("Connecting"))
    program.tell("0")
    program.until(lambda said: "turned" in said)
    is_stopped.set()
    wait_until(lambda: scenes)
    # only then has it noted when it asked
    program.until(state("Connected"))
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
