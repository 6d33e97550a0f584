"""The addon follows the real service through restarts and errors, and publishers that send the messages of a test."""

import hashlib
import re
import signal
import time
from contextlib import suppress
from fcntl import ioctl
from termios import TIOCOUTQ

import pytest
import zmq

from engine_bridge.service.protocol.header import Kind

from ...recorded import recorded
from ...waiting import wait_until
from ..peers import GREETING, READY, large
from ..stage import message


@pytest.fixture
def follow(start_godot):
    """Have Godot follow topics of a service on this machine."""

    def start(port, *topics, script="follow.gd", **more):
        arguments = ("",) if script == "follow.gd" else ()
        return start_godot(script, "127.0.0.1", port, *arguments, *topics, **more)

    return start


@pytest.fixture
def publisher():
    """A publisher in place of the service that sends the messages of the test."""
    with zmq.Context() as context, context.socket(zmq.XPUB) as publisher:
        publisher.linger = 0
        publisher.sndhwm = 10_000
        publisher.bind("tcp://127.0.0.1:*")
        yield publisher


class Wire:
    """A publisher that sends what it is given at once, as one piece."""

    def __init__(self, answering):
        self.heard, self._lines = b"", []
        self.port = answering(self._answer).port

    def _answer(self, line):
        line.sendall(GREETING + READY)
        self._lines.append(line)
        with suppress(OSError):
            while some := line.recv(4096):
                self.heard += some

    @property
    def connections(self):
        return len(self._lines)

    def subscribed(self, *topics):
        """Wait until topics have been subscribed to."""
        wait_until(lambda: all(b"\1" + name.encode() + b"\0" in self.heard for name in topics))

    def send(self, *messages, part=None):
        """Send messages, or a part of all their bytes; return when the other's system has them."""
        data = b"".join(large(len(each)) + each for each in messages)
        self._lines[-1].sendall(data[part] if part else data)
        wait_until(lambda: not any(ioctl(self._lines[-1], TIOCOUTQ, bytes(4))))


@pytest.fixture
def wire(answering):
    return Wire(answering)


def port_at(socket):
    return int(socket.last_endpoint.rpartition(b":")[2])


def told_of(script, topic):
    return [told for told in script.results if told.get("topic") == topic]


def states(script):
    return [told["state"] for told in script.results if "state" in told]


def state(name):
    return lambda told: told.get("state") == name


def topic(name, more=lambda _told: True):
    return lambda told: told.get("topic") == name and more(told)


def test_a_line_that_cuts_everything_into_bytes_and_is_torn(follow, stage, line):
    stage.is_playing, slow = True, line(stage.port)
    script = follow(slow.port, "blob/scene/mine", "blob/controls")
    script.until(topic("blob/controls"))
    slow.tear()
    script.until(lambda _told: len(told_of(script, "blob/scene/mine")) == 2)
    script.end()
    assert [told["sha256"] for told in told_of(script, "blob/scene/mine")] == [
        hashlib.sha256(stage.character.scene).hexdigest()
    ] * 2
    assert states(script) == ["CONNECTING", "CONNECTED", "OFFLINE", "CONNECTED"]


def test_a_scene_that_takes_longer_than_silence_may_comes_once(follow, wire, given_clock):
    """It comes in five parts with two seconds between them."""
    script = follow(wire.port, "worm", script="slow_scene.gd", clock=given_clock)
    wire.subscribed("service/characters")
    wire.send(message("service/characters", Kind.CHARACTERS, b'[{"name": "worm"}]'))
    [name] = wait_until(lambda: re.findall(rb"\x01(worm/scene/\w+)\0", wire.heard))
    scene = name.ljust(64, b"\0") + recorded("scene")[64:]
    part = len(scene) // 5 + 9
    wire.send(scene, part=slice(0, part))
    script.until(lambda told: "receiving" in told)
    for start in range(part, 5 * part, part):
        given_clock.turn(2.0)
        wire.send(scene, part=slice(start, start + part))
    script.until(topic("scene"))
    script.end()
    assert states(script) == ["CONNECTING", "CONNECTED"]
    assert len(told_of(script, "scene")) == wire.connections == wire.heard.count(b"\1worm/scene/") == 1


def test_a_service_that_is_silent_is_taken_for_gone_until_it_speaks_again(follow, wire, given_clock):
    script = follow(wire.port, clock=given_clock)
    for number in (1, 2):
        wait_until(lambda number=number: wire.connections == number)
        wire.send(message("service/status", Kind.STATUS))
        script.until(lambda _told, number=number: states(script).count("CONNECTED") == number)
        given_clock.turn(6.1)
        script.until(lambda _told, number=number: states(script).count("OFFLINE") == number)
        given_clock.turn(0.3)
    script.end()


def test_a_foreign_publisher_on_the_port_is_no_service(follow, publisher, given_clock):
    script = follow(port_at(publisher), clock=given_clock)
    subscribed(publisher, "service/status")
    for content in (b"weather", bytes(120)):
        publisher.send(b"service/status\0" + content)
    given_clock.turn(6.1)
    script.until(state("OFFLINE"))
    script.end()
    assert states(script) == ["CONNECTING", "OFFLINE"]


def test_another_protocol_version_is_refused_with_both_versions_even_as_the_last_message(follow, publisher):
    script = follow(port_at(publisher))
    subscribed(publisher, "service/status")
    publisher.send(message("service/status", Kind.STATUS))
    script.until(state("CONNECTED"))
    script.process.send_signal(signal.SIGSTOP)
    try:
        publisher.linger = 10_000
        publisher.send(message("service/status", Kind.STATUS, major=2, minor=3))
        context = publisher.context
        publisher.close()
        context.term()  # all has been sent
    finally:
        script.process.send_signal(signal.SIGCONT)
    assert "2.3" in script.until(state("REFUSED"))["reason"]
    script.end()
    assert states(script) == ["CONNECTING", "CONNECTED", "REFUSED"]


def subscribed(publisher, *topics, on=True):
    """Wait until just these topics have been subscribed to."""
    come = {publisher.recv() for _ in topics}
    assert come == {bytes([on]) + name.encode() + b"\0" for name in topics}


def test_two_who_follow_share_a_connection_and_who_comes_late_is_told(follow, publisher):
    script = follow(port_at(publisher), script="share.gd")

    def step(number):
        publisher.send(message("step", Kind.STATUS, sequence=number))
        script.until(lambda told: told.get("step") == number)

    def perform(number):
        publisher.send(message("dog/performer", Kind.PERFORMER, sequence=number))
        publisher.send(message("dog/controls", Kind.CONTROLS, sequence=number))
        script.until(topic("dog/controls", lambda told: told["sequence"] == number))

    subscribed(publisher, "service/status", "step", "dog/performer", "dog/controls")
    perform(1)
    step(1)
    script.until(lambda told: told.get("who") == "other")
    perform(2)
    step(2)
    perform(3)
    assert publisher.poll(200) == 0  # the second one still follows
    step(3)
    subscribed(publisher, "dog/performer", "dog/controls", on=False)
    script.end()
    heard = [(told["who"], told["topic"], told["sequence"]) for told in script.results if "who" in told]
    assert heard == [
        *(("one", name, 1) for name in ("dog/performer", "dog/controls")),
        ("other", "dog/performer", 1),  # what was said before it came, but no frame of that time
        *((who, name, 2) for name in ("dog/performer", "dog/controls") for who in ("one", "other")),
        *(("other", name, 3) for name in ("dog/performer", "dog/controls")),
    ]
    assert all(told["same"] for told in script.results if told.get("step", 0) > 1)


def test_a_receiver_removed_by_another_one_is_not_called(follow, wire):
    script = follow(wire.port, script="unfollow.gd")
    wire.subscribed("service/status", "dog/performer", "late")

    def performed(number):
        return message("dog/performer", Kind.PERFORMER, sequence=number)

    wire.send(performed(1))
    script.until(lambda told: told.get("sequence") == 1)
    wire.send(message("late", Kind.STATUS))
    script.until(lambda _told: len(script.results) == 2)
    for number, *before in ((2,), (3, message("late", Kind.STATUS)), (4,)):
        wire.send(*before, performed(number))  # they come together
        script.until(lambda told, number=number: told.get("sequence") == number)
    [*heard, end] = script.end()
    assert [(told["who"], told["sequence"]) for told in heard] == [("one", number) for number in (1, 1, 2, 3, 4)]
    assert sorted(end["remembered"]) == ["late", "service/status"]


def test_a_paused_follower_gets_the_newest_frames_and_the_last_of_other_messages(follow, publisher):
    names = ("dog/controls", "dog/handles", "dog/performer")
    script = follow(port_at(publisher), *names, script="late.gd")
    subscribed(publisher, "service/status", *names)
    publisher.send(message("service/status", Kind.STATUS))
    script.until(lambda told: "looks_away" in told)
    for number in range(600):
        publisher.send(message("dog/controls", Kind.CONTROLS, sequence=number))
        publisher.send(message("dog/performer", Kind.PERFORMER, sequence=number))
    publisher.send(message("dog/handles", Kind.HANDLES, sequence=7))
    time.sleep(0.5)  # until all of it is with the system
    script.end()
    frames, handles, performers = ([told["sequence"] for told in told_of(script, name)] for name in names)
    assert (frames, handles, performers) == (list(range(600 - 512, 600)), [7], [599])


def test_the_status_is_kept(follow, publisher):
    script = follow(port_at(publisher), "dog/controls")
    subscribed(publisher, "service/status", "dog/controls")
    for payload in (b"no json", b"[1]", b'{"stages": [1]}'):
        publisher.send(message("service/status", Kind.STATUS, payload=payload))
        script.until(state("CONNECTED"))
    publisher.send(message("dog/controls", Kind.CONTROLS))
    script.until(topic("dog/controls"))
    assert script.end()[-1]["status"] == {"stages": [1]}
