import threading
import time
from dataclasses import asdict, replace

import pytest
import zmq
from zmq.auth.thread import ThreadAuthenticator

from engine_bridge.client import listening
from engine_bridge.client.listening import describe, listen
from engine_bridge.service.outputs.zeromq import ZeroMqOutput
from engine_bridge.service.protocol.scene import StreamedCharacter
from puppetline.errors import ServiceError

from ..service.outputs.frames import Open, frame_of


class Playing(threading.Thread):
    """A service that plays 100 frames a second and leaves out every tenth."""

    def __init__(self, characters):
        super().__init__()
        self.context = zmq.Context()
        self.publisher = ZeroMqOutput(self.context, [Open()], characters)
        self.address = self.publisher.endpoints[0]
        self.characters = characters
        self.over = threading.Event()
        self.reload = threading.Event()

    def run(self):
        sequence = 0
        while not self.over.is_set():
            if self.reload.is_set():
                self.reload.clear()
                self.characters = [replace(each, revision=each.revision + 1) for each in self.characters]
                self.publisher.announce(self.characters)
            (socket,) = self.publisher.sockets
            if socket.poll(10):
                self.publisher.handle(socket)
            self.publisher.send_due()
            sequence += 2 if sequence % 10 == 8 else 1
            for character in self.characters:
                came = {"time": sequence / 100, "received": time.monotonic_ns() - 5_000_000}
                self.publisher.offer(frame_of(character, sequence, state="performing", user=7, **came))
        self.publisher.close()
        self.context.term()

    def close(self):
        self.over.set()
        self.join()


@pytest.fixture
def playing(blob_rig, until_end):
    def play(*names):
        service = until_end(Playing([StreamedCharacter(name, blob_rig, 1) for name in names]))
        service.start()
        return service

    return play


def test_a_report_says_what_came(playing, blob_rig):
    report = listen(playing("dog", "cat").address, seconds=1.5, kinds=("controls", "vertices"))
    assert [heard.topic for heard in report.heard] == ["cat/controls", "cat/vertices", "dog/controls", "dog/vertices"]
    n = len(blob_rig.character.vertices)
    for heard in report.heard:
        size = 128 + (24 * n if "vertices" in heard.topic else 48 * 30)
        assert heard.bytes == heard.messages * size
        assert heard.messages > 1
        assert abs(heard.missing - heard.messages / 9) <= 1
        assert heard.restarts == 0
        assert 5 <= heard.latency_ms["p50"] <= heard.latency_ms["p95"] <= heard.latency_ms["p99"]
        assert heard.latency_ms["p99"] <= heard.latency_ms["max"]
        assert (heard.state, heard.user) == ("performing", 7)
    assert set(report.scenes) == {"dog", "cat"}
    assert report.scenes["dog"]["vertices"] == n
    assert report.scenes["dog"]["triangles"] == len(blob_rig.character.triangles)
    assert report.refused == 0
    assert asdict(report)["heard"][0]["topic"] == "cat/controls"
    text = describe(report)
    assert f"dog: revision 1, {n:,} vertices" in text
    assert "dog/controls: performing" in text


def test_only_what_was_named_is_followed(playing):
    service = playing("dog", "cat")
    report = listen(service.address.removeprefix("tcp://"), seconds=0.5, characters=["cat"], kinds=("handles",))
    assert [heard.topic for heard in report.heard] == ["cat/handles"]
    assert set(report.scenes) == {"cat"}


def test_after_a_reload_the_scene_is_requested_again(playing):
    service = playing("dog")
    timer = threading.Timer(0.5, service.reload.set)
    timer.start()
    report = listen(service.address, seconds=1.5)
    timer.join()
    assert report.scenes["dog"]["revision"] == 2


def test_latency_is_unknown_for_a_service_with_another_clock(playing):
    report = listen(playing("dog").address.replace("127.0.0.1", "0.0.0.0"), seconds=0.5)
    assert report.heard[0].latency_ms is None
    assert "latency" not in describe(report)


def test_a_silence_is_told_once_while_the_client_goes_on(monkeypatch):
    monkeypatch.setattr(listening, "NOTICE_SECONDS", 0.2)
    told = []
    with zmq.Context() as context, context.socket(zmq.XPUB) as silent:
        port = silent.bind_to_random_port("tcp://127.0.0.1")
        with pytest.raises(ServiceError, match="found no message within 1 s; expected a running service"):
            listen(f"127.0.0.1:{port}", seconds=1, notice=told.append)
    assert [text.partition("; ")[0] for text in told] == [f"tcp://127.0.0.1:{port}: found no message within 0 s"]


def interrupt(_text):
    raise KeyboardInterrupt


@pytest.mark.parametrize("token", [None, "another one"])
def test_a_service_that_refuses_the_token_is_told_from_none(token):
    context = zmq.Context()
    guard = ThreadAuthenticator(context)
    guard.start()
    guard.configure_plain(passwords={"puppetline": "the right one"})
    with context.socket(zmq.XPUB) as locked:
        locked.plain_server = True
        port = locked.bind_to_random_port("tcp://127.0.0.1")
        with pytest.raises(ServiceError, match=r"found a service that refuses this client; .*--token-file"):
            listen(f"127.0.0.1:{port}", seconds=60, token=token, notice=interrupt)
    guard.stop()
    context.destroy(linger=0)


@pytest.mark.parametrize("wrong", [{"address": "nonsense"}, {"characters": ("a/b",)}, {"address": "carrier://pigeon"}])
def test_an_address_that_cannot_be_listened_to_is_refused(wrong):
    with pytest.raises(ServiceError):
        listen(**{"address": "127.0.0.1:1", "seconds": 0.1, **wrong})


def test_messages_that_are_none_are_counted():
    with zmq.Context() as context, context.socket(zmq.XPUB) as odd:
        odd.linger = 0
        port = odd.bind_to_random_port("tcp://127.0.0.1")

        def talk():
            for _ in range(2):
                odd.poll(5000)
                odd.recv()
            odd.send(b"service/characters\0nonsense")

        thread = threading.Thread(target=talk)
        thread.start()
        report = listen(f"127.0.0.1:{port}", seconds=0.5, characters=["dog"])
        thread.join()
    assert (report.refused, report.heard) == (1, [])
    assert "1 not understood" in describe(report)
