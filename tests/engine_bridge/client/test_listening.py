from dataclasses import replace

import pytest
import zmq
from zmq.auth.thread import ThreadAuthenticator

from engine_bridge.client.listening import describe, listen
from engine_bridge.service.outputs.zeromq import ZeroMqOutput
from engine_bridge.service.protocol.scene import StreamedCharacter
from puppetline import clock
from puppetline.errors import ServiceError

from ..refusals import refused
from ..service.outputs.frames import Open, frame_of

STEP_SECONDS = 0.01


@pytest.fixture
def in_steps(given_clock, monkeypatch):
    """Do something whenever the client has taken all messages that were sent; each time takes 10 ms.

    A step returns the number of messages that it has sent. Where it has sent none, the client waits for a moment, so
    that its own requests can arrive.
    """

    def do(step, patience=100):
        class Socket(zmq.Socket):
            under_way = 0

            def poll(self, timeout=None, flags=zmq.POLLIN):
                if self.type != zmq.SUB:  # that is how it learns of refusals
                    return super().poll(timeout, flags)
                if not self.under_way:
                    self.under_way = step()
                    given_clock.advance(STEP_SECONDS)
                return super().poll(60_000 if self.under_way else patience)

            def recv(self, *arguments, **options):
                self.under_way -= self.type == zmq.SUB
                return super().recv(*arguments, **options)

        monkeypatch.setattr(zmq.Context, "_socket_class", Socket)

    return do


class Service:
    """A service that plays a frame at each step and leaves out every tenth; the client is stopped after the 300th."""

    def __init__(self, characters):
        self.context = zmq.Context()
        self.publisher = ZeroMqOutput(self.context, [Open()], characters)
        self.address = self.publisher.endpoints[0]
        self.characters, self.sequence, self.played = characters, 0, []

    def step(self):
        sent = self.publisher.statistics.sent
        (socket,) = self.publisher.sockets
        while socket.poll(0):
            self.publisher.handle(socket)
        if self.sequence >= 300:
            raise KeyboardInterrupt
        self.publisher.send_due()
        self.sequence += 2 if self.sequence % 10 == 8 else 1
        if self.sequence == 50:
            self.characters = [replace(each, revision=2) for each in self.characters]
            self.publisher.announce(self.characters)
        self.played.append(self.sequence)
        for character in self.characters:
            came = {"time": self.sequence / 100, "received": clock.now_ns() - 5_000_000}
            self.publisher.offer(frame_of(character, self.sequence, state="performing", user=7, **came))
        return self.publisher.statistics.sent - sent

    def close(self):
        self.publisher.close()
        self.context.term()


@pytest.fixture
def playing(prepared_blob, until_end, in_steps):
    def play(*names):
        service = until_end(Service([StreamedCharacter(name, prepared_blob, 1) for name in names]))
        in_steps(service.step)
        return service

    return play


def test_a_report_says_what_came(playing, prepared_blob):
    service = playing("dog", "cat")
    report = listen(service.address, kinds=("controls", "vertices"))
    assert [heard.topic for heard in report.heard] == ["cat/controls", "cat/vertices", "dog/controls", "dog/vertices"]
    n = len(prepared_blob.character.vertices)
    for heard in report.heard:
        size = 128 + (24 * n if "vertices" in heard.topic else 48 * 30)
        assert heard.bytes == heard.messages * size
        first, last = service.played[-heard.messages], service.played[-1]
        assert heard.missing == last - first + 1 - heard.messages > 20
        assert heard.restarts == 0
        assert 5 <= heard.latency_ms["p50"] <= heard.latency_ms["p95"] <= heard.latency_ms["p99"]
        assert heard.latency_ms["p99"] <= heard.latency_ms["max"]
        assert (heard.state, heard.user) == ("performing", 7)
    assert set(report.scenes) == {"dog", "cat"}
    counts = {"vertices": n, "triangles": len(prepared_blob.character.triangles)}
    assert report.scenes["dog"].items() >= (counts | {"revision": 2}).items()  # requested again after the change
    assert report.refused == 0
    text = describe(report)
    assert f"dog: revision 2, {n:,} vertices" in text
    assert "dog/controls: performing" in text


def test_only_what_was_named_is_followed_and_latency_is_unknown_for_a_service_with_another_clock(playing):
    address = playing("dog", "cat").address.removeprefix("tcp://").replace("127.0.0.1", "0.0.0.0")
    report = listen(address, characters=["cat"], kinds=("handles",))
    (heard,) = report.heard
    assert (heard.topic, heard.latency_ms) == ("cat/handles", None)
    assert set(report.scenes) == {"cat"}
    assert "latency" not in describe(report)


def test_a_silence_is_told_once_while_the_client_goes_on(in_steps):
    told = []
    in_steps(lambda: 0, patience=0)
    with zmq.Context() as context, context.socket(zmq.XPUB) as silent:
        address = f"tcp://127.0.0.1:{silent.bind_to_random_port('tcp://127.0.0.1')}"
        with pytest.raises(ServiceError) as error:
            listen(address, seconds=0.3, notice=told.append)
    assert (error.value.where, error.value.found) == (address, "no message within 5 s")
    assert [text.partition("; ")[0] for text in told] == [f"{address}: found no message within 3 s"]


def test_the_duration_counts_from_the_first_message(playing, in_steps, given_clock):
    service, begun, silences = playing("dog"), clock.now(), [2.0]

    def step():
        if not silences:
            return service.step()
        given_clock.advance(silences.pop())
        return 0

    in_steps(step)
    report = listen(service.address, seconds=0.5)
    assert report.seconds == pytest.approx(0.5, abs=2 * STEP_SECONDS)
    assert clock.now() - begun >= 2.5


def interrupt(_text):
    raise KeyboardInterrupt


@pytest.mark.parametrize("token", [None, "another-token-of-some-length"])
def test_a_service_that_refuses_the_token_is_told_from_none(token):
    context = zmq.Context()
    guard = ThreadAuthenticator(context)
    guard.start()
    guard.configure_plain(passwords={"puppetline": "the right one"})
    with context.socket(zmq.XPUB) as locked:
        locked.plain_server = True
        port = locked.bind_to_random_port("tcp://127.0.0.1")
        with pytest.raises(ServiceError) as error:
            listen(f"127.0.0.1:{port}", token=token, notice=interrupt)
        assert "--token-file" in error.value.fix
    guard.stop()
    context.destroy(linger=0)


def test_a_name_that_no_character_has_is_refused():
    assert refused(ServiceError, listen, "127.0.0.1:1", seconds=0.1, characters=("a/b",)).where == "--character"


def test_messages_that_are_none_are_counted(in_steps):
    with zmq.Context() as context, context.socket(zmq.XPUB) as odd:
        odd.linger = 0
        requests = []

        def talk():
            if b"\1service/characters\0" in requests:  # the client has taken the answer
                raise KeyboardInterrupt
            requests.append(odd.recv())
            if requests[-1] == b"\1service/characters\0":
                odd.send(b"service/characters\0nonsense")
                return 1
            return 0

        in_steps(talk)
        address = f"127.0.0.1:{odd.bind_to_random_port('tcp://127.0.0.1')}"
        report = listen(address)
    assert (report.refused, report.heard) == (1, [])
    assert "1 not understood" in describe(report)
