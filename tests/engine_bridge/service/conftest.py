"""Services and stages with a small character, senders of skeletons, and clients."""

import itertools
import json
import os
import random
import signal
import socket
import subprocess
import threading
import time
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np
import pytest
import zmq
from puppetline.examples.performances import PERFORMANCES
from pythonosc.osc_bundle_builder import IMMEDIATELY, OscBundleBuilder
from pythonosc.osc_message import OscMessage

from capture.skeleton import JOINTS
from engine_bridge.service.control.control_socket import request
from engine_bridge.service.monitoring.status import (
    CharacterStatus,
    ClientsStatus,
    LatencyStatus,
    OutputStatus,
    SensorStatus,
    ServiceStatus,
    StageStatus,
    Status,
    TimelineStatus,
    TimelineTake,
    UserStatus,
)
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.players.player_settings import PlayerSettings
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.stages.stage import Stage, StageSettings
from puppetline.errors import ServiceError

from ...capture.network.conftest import TWENTY, message
from ...waiting import wait_until
from .client import TIMEOUT_SECONDS, Client
from .in_process import AtOnce, InProcess
from .outputs.frames import messages

PLAYER_SETTINGS, STAGE_SETTINGS = PlayerSettings(), StageSettings()


@pytest.fixture(scope="session")
def executor():
    return AtOnce()


@pytest.fixture(scope="module")
def dog(prepared_blob):
    """Return the small figure as a character of a service."""
    return StreamedCharacter("dog", prepared_blob, 1)


@pytest.fixture
def make_player(prepared_blob, executor):
    """Make players of the small figure."""

    def make(name="dog", settings=PLAYER_SETTINGS, idle=None, prepared=prepared_blob):
        return CharacterPlayer(StreamedCharacter(name, prepared, 1), settings, executor, idle)

    return make


@pytest.fixture
def make_stage(make_player):
    """Make stages with characters of the small figure."""

    def make(names=("dog",), player_settings=PLAYER_SETTINGS, settings=STAGE_SETTINGS, **more):
        return Stage("stage", [make_player(name, player_settings, **more) for name in names], settings)

    return make


@pytest.fixture(scope="session")
def kung_fu():
    """Return the frames of an example performance: a performer stands still for a second, then walks."""
    return tuple(PERFORMANCES["kung_fu"]().frames())


@pytest.fixture(scope="session")
def moved():
    """Return a function that changes the time, the user or the position of a frame."""

    def move(frame, by=(0.0, 0.0, 0.0), **changed):
        return replace(frame, positions=frame.positions + np.array(by), **changed)

    return move


OSCELETON = {joint: name for name, joint in TWENTY.items()}


class Sender:
    """Sends skeletons as OSCeleton does with -xr and -r: one bundle per performer and frame, in millimetres."""

    def __init__(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.uri = f"osc:{self.port}?units=mm&mirrored=0"

    def send(self, frame, user=1):
        bundle = OscBundleBuilder(IMMEDIATELY)
        for joint, position, sure in zip(JOINTS, frame.positions, frame.confidence, strict=True):
            if sure > 0:
                values = OSCELETON[joint], user, *map(float, 1000 * position)
                bundle.add_content(OscMessage(message("/joint", "sifff", *values)))
        self.raw(bundle.build().dgram)

    def raw(self, datagram):
        self.socket.sendto(datagram, ("127.0.0.1", self.port))

    def close(self):
        self.socket.close()

    def lose(self, user=1):
        self.raw(message("/lost_user", "i", user))

    def play(self, frames, interval=1 / 60, user=1, until=lambda: False):
        """Send frames at an interval, up to the last one or until a condition holds; return their number."""
        sent = 0
        for sent, frame in enumerate(frames, 1):
            if until():
                return sent - 1
            self.send(frame, user)
            time.sleep(interval)
        return sent

    @contextmanager
    def playing(self, frames, **options):
        """Play frames again and again until the end of the block."""
        stop = threading.Event()
        options["until"] = stop.is_set
        performer = threading.Thread(target=self.play, args=(itertools.cycle(frames),), kwargs=options)
        performer.start()
        try:
            yield
        finally:
            stop.set()
            performer.join()


class Served:
    """The command `puppetline serve` in a process."""

    def __init__(self, commands, *arguments, env=None):
        told = ("--log-format", "json", *arguments)
        self.process = commands.start("serve", *told, stderr=subprocess.PIPE, env=os.environ | (env or {}))
        self.log, self._clients = [], []
        for line in self.process.stderr:
            self.log.append(line)
            if line.startswith("{") and json.loads(line)["event"] == "serving":
                break
        else:
            raise AssertionError(self.log)
        addresses = json.loads(line)["fields"]
        self.stream, self.control = addresses["stream"][0], addresses["control"][0]
        self.port, self.control_port = (int(each.rpartition(":")[2]) for each in (self.stream, self.control))
        self._read = threading.Thread(target=self.log.extend, args=[self.process.stderr])
        self._read.start()

    def logged(self, event):
        """Wait for an event in the log."""

        def found():
            events = (json.loads(line) for line in self.log[:] if line.startswith("{"))
            return next((each for each in events if each["event"].startswith(event)), None)

        wait_until(found, TIMEOUT_SECONDS)
        return found()

    def client(self, *topics):
        self._clients.append(Client(self.stream, *topics))
        return self._clients[-1]

    def ask(self, do, token=None, **arguments):
        """Make a request; return the result, or the error as a dict."""
        try:
            return request(self.control, do, token=token and token.decode(), timeout=TIMEOUT_SECONDS, **arguments)
        except ServiceError as error:
            return error.parts

    def stop(self, number=signal.SIGTERM):
        """Send a signal and return the exit code."""
        self.process.send_signal(number)
        return self.ended()

    def ended(self):
        code = self.process.wait(TIMEOUT_SECONDS)
        self._read.join()
        for client in self._clients:
            client.close()
        self._clients.clear()
        return code


@pytest.fixture
def sender(until_end):
    return until_end(Sender())


class Receiver:
    """A socket that takes datagrams."""

    def __init__(self, address=("127.0.0.1", 0), family=socket.AF_INET):
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self.socket.bind(address)
        self.socket.setblocking(False)

    @property
    def port(self):
        return self.socket.getsockname()[1]

    def datagrams(self):
        """Return all datagrams that have come."""
        came = []
        with suppress(BlockingIOError):
            while True:
                came.append(self.socket.recv(65536))
        return came

    def messages(self):
        """Return what python-osc reads in them, see `messages`."""
        return messages(self.datagrams())

    def close(self):
        self.socket.close()


@pytest.fixture
def receiver(until_end):
    """Take what targets of OSC are sent."""
    return until_end(Receiver())


@pytest.fixture
def manager(tmp_path, monkeypatch, until_end):
    """Take what is said to systemd."""
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    for name in ("WATCHDOG_USEC", "WATCHDOG_PID"):
        monkeypatch.delenv(name, raising=False)
    return until_end(Receiver(str(tmp_path / "notify"), socket.AF_UNIX))


@contextmanager
def services(commands, folder):
    """Return a function that starts services with their state in a folder; kill those that still run at the end."""
    started = []

    def start(*arguments, env=None):
        free = () if "--config" in arguments else ("--port", 0, "--no-announce", "--takes", folder / "takes")
        mine = {"XDG_STATE_HOME": str(folder / "state"), **(env or {})}
        started.append(Served(commands, *free, *arguments, env=mine))
        return started[-1]

    yield start
    for service in started:
        if service.process.poll() is None:
            service.process.kill()
        service.ended()
        service.process.stderr.close()


@pytest.fixture
def serve(tmp_path, own_cache, commands):
    """Start `puppetline serve` on free ports with its own state."""
    with services(commands, tmp_path) as start:
        yield start


@pytest.fixture(scope="module")
def serve_module(tmp_path_factory, own_cache, commands):
    """Start `puppetline serve` for all tests of a module that only read."""
    with services(commands, tmp_path_factory.mktemp("service")) as start:
        yield start


@pytest.fixture
def play(tmp_path, monkeypatch, given_clock, until_end):
    """Open services in this process on the given clock, with the arguments of `puppetline serve`; see `InProcess`."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("PUPPETLINE_TOKEN", raising=False)
    monkeypatch.setattr("capture.network.source.MAX_AGE_NS", -1)  # what the system says of its own clock
    monkeypatch.setattr("engine_bridge.service.outputs.zeromq.QUEUED_OTHERS", 100_000)  # no client is too slow

    def start(*arguments):
        free = () if "--config" in arguments else ("--port", 0, "--no-announce", "--takes", tmp_path / "takes")
        return until_end(InProcess(given_clock, (*free, *arguments)))

    return start


@pytest.fixture
def play_file(play, blob_puppet, tmp_path):
    """Play a service of a service file: more of [network] and other tables, and a stage of figures with names."""

    def start(tables="", names=("dog",), source="osc:0", stage="", puppet=blob_puppet):
        path = tmp_path / "service.toml"
        characters = (f'[[stage.character]]\nname = "{name}"\npuppet = "{puppet}"\n' for name in names)
        stages = f'[[stage]]\nsource = "{source}"\n{stage}\n' + "".join(characters)
        path.write_text(f"announce = false\n[network]\nport = 0\n{tables}\n{stages}")
        return play("--config", path)

    return start


@pytest.fixture
def context():
    """Return a ZeroMQ context, whose sockets are closed after the test."""
    made = zmq.Context()
    yield made
    made.destroy(linger=0)


@pytest.fixture
def listen(until_end):
    """Connect a client to an endpoint."""
    return lambda endpoint, *topics: until_end(Client(endpoint, *topics))


@pytest.fixture(scope="session")
def free_port():
    """Find a free TCP port followed by another one, outside the range from which the system chooses."""

    def find():
        while True:
            port = random.randrange(20_000, 32_000)
            with socket.socket() as one, socket.socket() as next_one, suppress(OSError):
                one.bind(("127.0.0.1", port))
                next_one.bind(("127.0.0.1", port + 1))
                return port

    return find


@pytest.fixture
def status():
    """Return a status with a value in every field."""
    return Status(
        service=ServiceStatus(version="1.2.3", uptime=3725.5, pid=7, memory=123_000_000, cpu=0.25),
        stages=[
            StageStatus(
                name="kinect",
                source="osc:7110",
                frames=900,
                rate=29.97,
                dropped=4,
                refused={"[red]not OSC": 2, "short": 1},
                faults=0,
                latency_ms=LatencyStatus(p50=1.234, p95=2.5, p99=None, max=9.0),
                users=[
                    UserStatus(1, "performing", "dog", seen=0.02, distance=2.0, height=1.684, reach=0.6),
                    UserStatus(5, "waiting", None, seen=1.5, distance=3.0, height=None, reach=None),
                ],
                sensor=SensorStatus(tilt=5.0, height=1.0, roll=0.0),
                recording="evening",
            )
        ],
        characters=[
            CharacterStatus("dog", "kinect", 1, "performing", frames=890, rate=29.9, residual=0.0123, limited=7),
            CharacterStatus("cat", "kinect", None, "waiting", frames=10, rate=0.0, residual=None, limited=0),
        ],
        clients=ClientsStatus(connected=3, refused=2, limit=64),
        outputs=[
            OutputStatus("zeromq", "tcp://127.0.0.1:7400", sent=5000, bytes=10, skipped=None, failed=0),
            OutputStatus("osc", "127.0.0.1:9000", sent=90, bytes=2000, skipped=12, failed=1),
            OutputStatus("websocket", "ws://127.0.0.1:7402", 70, bytes=500, skipped=5, failed=0, clients=2, refused=4),
        ],
        timeline=TimelineStatus(1.25, 77.5, 0.0, 9.5, 0.5, False, True, [TimelineTake("cat", "rehearsal", 0.5, 9.0)]),
    )


@pytest.fixture
def silent(status):
    """Return a status without performers, characters and outputs."""
    stage = replace(status.stages[0], latency_ms=LatencyStatus(), users=[], refused={}, recording=None)
    return replace(status, stages=[stage], characters=[], outputs=[], timeline=None)
