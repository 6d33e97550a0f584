"""Faults for `benchmarks.live_soak`, inflicted on a running service in turn until standard input is closed."""

import os
import random
import signal
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zmq

from benchmarks.datagrams import bodies
from benchmarks.live_peers import say, take_part
from capture.network.osc import BUNDLE, bundle, encode
from engine_bridge.service.protocol.header import subscription

HALF_OPEN_ROUNDS = 3
"""Number of rounds after which half-open connections are closed."""

CLOCK_STEPS_SECONDS = (3600, -3600, 86_400, -86_400, 30 * 365 * 86_400, -1, 0)
"""Offsets of the wall clock, one after the other, in seconds."""

GREETING = b"\xff" + bytes(8) + b"\x7f\x03\x00" + b"NULL".ljust(20, b"\0") + bytes(32)
READY = b"\x05READY\x0bSocket-Type"
HANDSHAKE = [
    GREETING,
    *(
        b"\x04" + bytes([len(READY) + 4 + len(kind)]) + READY + struct.pack(">I", len(kind)) + kind
        for kind in (b"SUB", b"DEALER")
    ),
]
"""ZMTP 3's greeting, and the READY commands of clients of the stream and of the control socket."""


def _packed(*elements: tuple[int, bytes]) -> bytes:
    """Return a bundle whose elements state the given sizes."""
    return BUNDLE + bytes(8) + b"".join(struct.pack(">i", size) + content for size, content in elements)


def _nested(depth: int) -> bytes:
    packet = encode("/a")
    for _ in range(depth):
        packet = bundle(packet)
    return packet


HOSTILE_DATAGRAMS = (
    _packed((-4, b"")),
    _nested(400),
    b"/\xff\xfe\xfd\0\0\0\0,\0\0\0",
    BUNDLE + struct.pack(">II", 0xFFFF_FFFF, 0) + struct.pack(">i", 12) + encode("/joint"),
    encode("/" + 25 * "*" + "b"),
    _packed((0x7FFF_FFFC, b"")),
    b"/blob\0\0\0,b\0\0" + struct.pack(">i", -1),
    b"/joint\0\0,sifff\0\0head\0\0\0\0" + struct.pack(">ifff", 1, float("nan"), float("inf"), 0.0),
    encode("joint", "head", 1, 0.0, 0.0, 2000.0),
    encode("/joint", "head", 1, 1e30, -1e30, 1e30),
    encode("/joint", "head", -(2**31), 0.0, 0.0, 2000.0),
    encode("/joint", "nose", 1, 0.0, 0.0, 0.0),
    encode("/lost_user", "everybody"),
    b"",
    b"\0",
    bytes(65_000),
    b"/" * 65_000,
)
"""Datagrams that make readers of OSC hang or crash, and datagrams that are only wrong."""

WRONG_BODIES = (
    b"",
    b"\0",
    b"null",
    b"[" * 60_000,
    b'{"do": "ping", "do": 1}',
    b'{"do": "fly"}',
    b'{"do": ["ping"]}',
    b'{"do": "record_start", "name": "../../etc/passwd"}',
    b'{"do": "choose_user", "character": "nobody", "user": 1e400}',
    b'{"do": "calibrate"}',
    b'{"do": "mirror", "character": "one", "on": "maybe"}',
    b"\x81\xa2do\xa4ping\xc1",
    b"\xdf\xff\xff\xff\xff",
    b"\xff" * 1000,
)


class Faults:
    """Every public method except `names` and `run` is a fault.

    Parameters
    ----------
    stream, control : str
        Endpoints of the service.
    source : int
        Port of its source.
    process : int
        Its process id.
    puppet : str
        A puppet file that it has loaded, which faults change.
    takes : str
        Its folder of takes.
    clock : str or None
        File with the offset of its wall clock (clock.c).
    characters : list of str
    pause : float
        Seconds between two faults.
    seed : int
    """

    def __init__(
        self,
        stream: str,
        control: str,
        source: int,
        process: int,
        puppet: str,
        takes: str,
        clock: str | None,
        characters: list[str],
        pause: float,
        seed: int = 1,
    ) -> None:
        self._stream, self._control = stream, control
        self._ports = [int(endpoint.rpartition(":")[2]) for endpoint in (stream, control)]
        self._source, self._process = source, process
        self._puppet, self._takes = Path(puppet), Path(takes)
        self._text = self._puppet.read_text(encoding="utf-8")
        self._clock = None if clock is None else Path(clock)
        self._characters, self._pause = characters, pause
        self._random = random.Random(seed)
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._half_open: list[list[socket.socket]] = []
        self._frames = [together[0] for together in bodies(1)]
        self._steps = 0
        self._takes_made = 0
        self._udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.done: Counter[str] = Counter()

    def hostile_datagrams(self) -> None:
        for datagram in HOSTILE_DATAGRAMS:
            self._send(datagram)

    def mutilated_datagrams(self) -> None:
        for _ in range(100):
            frame = bytearray(self._random.choice(self._frames))
            for _ in range(self._random.randint(1, 8)):
                frame[self._random.randrange(len(frame))] = self._random.randrange(256)
            cut = self._random.randrange(len(frame)) if self._random.random() < 0.3 else len(frame)
            self._send(bytes(frame[:cut]))

    def random_datagrams(self) -> None:
        for _ in range(100):
            self._send(self._random.randbytes(self._random.randrange(400)))

    def a_sender_whose_clock_steps(self) -> None:
        for user in (901, 902):
            for _ in range(20):
                stamp = self._random.uniform(-1e9, 1e9)
                for joint in ("head", "torso", "l_hand"):
                    self._send(encode("/joint", joint, 0, user, 0.0, 100.0, 2500.0, 1.0, stamp))

    def many_performers(self) -> None:
        for user in range(1000, 1060):
            self._send(bundle(encode("/joint", "head", user, 0.0, 1500.0, 4000.0)))

    def killed_in_handshake(self) -> None:
        for port in self._ports:
            for said in (GREETING[:1], GREETING[:11], GREETING[:-1], GREETING, GREETING + HANDSHAKE[1][:9]):
                with self._connected(port) as client:
                    client.sendall(said)
                    client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset

    def half_open(self) -> None:
        opened = []
        for port in self._ports:
            for said in (b"", GREETING[:10], GREETING):
                client = socket.create_connection(("127.0.0.1", port))
                client.sendall(said)
                opened.append(client)
        self._half_open.append(opened)
        if len(self._half_open) > HALF_OPEN_ROUNDS:
            for client in self._half_open.pop(0):
                client.close()

    def garbage_on_the_ports(self) -> None:
        said = (
            b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n",
            self._random.randbytes(2000),
            GREETING + self._random.randbytes(2000),
            *(
                b"".join(HANDSHAKE[:1]) + ready + rest
                for ready in HANDSHAKE[1:]
                for rest in (
                    b"\x02" + struct.pack(">Q", 2**62),
                    b"\x00\xff" + bytes(100),
                    b"\x02" + struct.pack(">Q", 500_000) + bytes(500_000),
                    b"\xff" * 300,
                    b"\x04\xff" + bytes(255),
                )
            ),
        )
        for port in self._ports:
            for each in said:
                with self._connected(port) as client:
                    client.settimeout(0.2)
                    client.sendall(each)

    def wrong_requests(self) -> None:
        with self._context.socket(zmq.DEALER) as client:
            client.linger = 0
            client.connect(self._control)
            for _ in range(10):
                for body in WRONG_BODIES:
                    client.send_multipart([body] * self._random.choice((1, 1, 1, 2, 5)))
                while client.poll(20):
                    client.recv_multipart()

    def requests_without_waiting(self) -> None:
        with self._context.socket(zmq.DEALER) as client:
            client.linger = 0
            client.connect(self._control)
            for number in range(300):
                client.send_json({"do": "describe", "id": number}, zmq.NOBLOCK)
            client.poll(50)

    def random_subscriptions(self) -> None:
        for _ in range(4):
            with self._context.socket(zmq.SUB) as client:
                client.linger = 0
                for _ in range(30):
                    client.subscribe(self._random.randbytes(self._random.randrange(70)))
                for _ in range(10):
                    client.subscribe(
                        subscription(f"{self._random.choice(self._characters)}/scene/{self._random.random()}")
                    )
                client.subscribe(self._random.choice((b"", b"one/", subscription("one/vertices16"))))
                client.connect(self._stream)
                client.poll(100)

    def requests_in_mid_performance(self) -> None:
        name = self._random.choice(self._characters)
        self._ask("mirror", character=name, on=self._random.random() < 0.5)
        self._ask("calibrate", character=name)
        self._ask("choose_user", character=name, user=self._random.choice((1, 2, 3, 4, 901, None)))

    def reload_by_signal(self) -> None:
        self._write(self._text.replace('name = "', f'name = "{self._random.choice("ab")}', 1))
        os.kill(self._process, signal.SIGHUP)

    def reload_by_request(self) -> None:
        self._write(self._text)
        self._ask("reload")

    def reload_of_a_broken_file(self) -> None:
        self._write(self._text[: self._random.randrange(len(self._text))] + "]")
        self._ask("reload")
        self._write(self._text)
        self._ask("reload")

    def a_take(self) -> None:
        self._takes_made += 1
        name = f"take{self._takes_made}"
        self._ask("record_start", name=name)
        time.sleep(0.5)
        self._ask("record_stop")
        (self._takes / f"{name}.log").unlink(missing_ok=True)

    def a_stall(self) -> None:
        os.kill(self._process, signal.SIGSTOP)
        time.sleep(self._random.choice((0.05, 0.3, 1.5)))
        os.kill(self._process, signal.SIGCONT)

    def a_step_of_the_wall_clock(self) -> None:
        if self._clock is not None:
            with self._clock.open("r+b") as clock:  # not replaced, because the service maps it
                clock.write(struct.pack("q", CLOCK_STEPS_SECONDS[self._steps % len(CLOCK_STEPS_SECONDS)]))
            self._steps += 1

    def _send(self, datagram: bytes) -> None:
        self._udp.sendto(datagram, ("127.0.0.1", self._source))

    def _write(self, text: str) -> None:
        beside = self._puppet.with_suffix(".new")
        beside.write_text(text, encoding="utf-8")
        beside.replace(self._puppet)

    def _ask(self, do: str, **arguments: Any) -> None:
        """Send a request and wait for the reply, which may be an error."""
        with self._context.socket(zmq.REQ) as client:
            client.linger = 0
            client.connect(self._control)
            client.send_json({"do": do, **arguments})
            if client.poll(20_000):
                client.recv_json()
                self.done["answered"] += 1
            else:
                self.done["no answer"] += 1

    @contextmanager
    def _connected(self, port: int) -> Iterator[socket.socket]:
        """Connect; the service may close the connection."""
        with socket.create_connection(("127.0.0.1", port)) as client:
            try:
                yield client
            except OSError:
                self.done["closed by the service"] += 1

    @classmethod
    def names(cls) -> list[str]:
        """List the faults."""
        return [name for name in vars(cls) if not name.startswith("_") and name not in ("names", "run")]

    def run(self, ended: threading.Event) -> dict[str, int]:
        """Inflict the faults in turn; return how often."""
        say("ready")
        try:
            while not ended.is_set():
                for name in self.names():
                    if ended.wait(self._pause):
                        break
                    getattr(self, name)()
                    self.done[name] += 1
        finally:
            os.kill(self._process, signal.SIGCONT)
            self._write(self._text)
            self._context.destroy(linger=0)
        return dict(self.done)


if __name__ == "__main__":
    take_part({"faults": lambda ended, **arguments: Faults(**arguments).run(ended)})
