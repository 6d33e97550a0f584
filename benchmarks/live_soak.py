"""Run a live service for many frames while all faults of `live_faults` are inflicted on it.

python -m benchmarks.live_soak PUPPET [--frames N] [--pause SECONDS]

Performers send a frame as soon as the previous one has been streamed. So the service is always busy, and drops nothing
except while it stalls. A good client is connected from beginning to end and must lose nothing.
"""

import argparse
import json
import random
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zmq
from numpy.typing import NDArray

from benchmarks import datagrams
from benchmarks.live_faults import Faults
from benchmarks.live_peers import PERFORMING, Peer, Service, free_udp_port, serving, settings
from engine_bridge.puppet import puppet_file
from engine_bridge.service.protocol.header import PAYLOAD_OFFSET, TOPIC_BYTES, Header, subscription

CHARACTERS = ("one", "two", "three", "four")

FRAMES = 1_000_000

REPLY_TIMEOUT_SECONDS = 0.03
"""Time after which a performer sends the next frame although the last one was not streamed, in seconds."""

CALIBRATION_PERIOD_SECONDS = 0.01
"""Time between two frames during calibration, which takes a time and not a number of frames, in seconds."""

MAX_STAY_FRAMES = 4000
"""Largest number of frames for which a performer stays."""

ABSENCE_SECONDS = (0.1, 0.7, 2.0)
"""How long performers stay away, in seconds."""

WARM_UP_SHARE = 0.1
"""Share of the frames before the memory is compared with the end."""

MAX_SECONDS = 45 * 60.0
"""Longest duration, in seconds."""

CLOCK = Path(__file__).with_name("clock.c")


class Performer:
    """A performer who enters and leaves at random."""

    def __init__(self, bodies: list[bytes], user: int) -> None:
        self.user = user
        self._bodies = bodies
        self._sent = 0
        self._stay = random.randint(MAX_STAY_FRAMES // 2, MAX_STAY_FRAMES)
        self.sent_at = self.due = 0.0
        self.performing = False

    def send(self, sending: socket.socket, port: int, now: float) -> None:
        """Send the next frame, or leave, with or without a message of the sensor."""
        self._sent += 1
        if self._sent % self._stay == 0:
            self.performing = False
            self.due = now + random.choice(ABSENCE_SECONDS)
            if random.random() < 0.5:
                sending.sendto(datagrams.lost(self.user), ("127.0.0.1", port))
            return
        sending.sendto(self._bodies[self._sent % len(self._bodies)], ("127.0.0.1", port))
        self.sent_at = time.monotonic()
        self.due = now + REPLY_TIMEOUT_SECONDS

    def answered(self, header: Header, now: float) -> None:
        """Note that a frame was streamed."""
        self.performing = header.state == PERFORMING
        if header.received * 1e-9 >= self.sent_at:
            self.due = now if self.performing else self.sent_at + CALIBRATION_PERIOD_SECONDS


class GoodClient:
    """A client that receives all characters and counts what it loses."""

    def __init__(self, endpoint: str) -> None:
        self._context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self._socket = self._context.socket(zmq.SUB)
        self._socket.linger = 0
        self._socket.rcvhwm = 0
        for topic in ("service/status", *(f"{name}/controls" for name in CHARACTERS)):
            self._socket.subscribe(subscription(topic))
        self._socket.connect(endpoint)
        self.frames = self.lost = self.not_finite = self.back_in_time = 0
        self.status: dict[str, Any] = {}
        self._last: dict[bytes, Header] = {}

    def wait(self, seconds: float) -> None:
        self._socket.poll(max(0, round(1000 * seconds)))

    def take(self) -> list[Header]:
        """Return the headers of the messages that have arrived."""
        headers: list[Header] = []
        for _ in range(64):
            try:
                message = self._socket.recv(zmq.NOBLOCK)
            except zmq.Again:
                break
            topic, payload = message[:TOPIC_BYTES], message[PAYLOAD_OFFSET:]
            if topic.startswith(b"service/"):
                self.status = json.loads(payload)
                continue
            header = Header.unpack(message[TOPIC_BYTES:PAYLOAD_OFFSET])
            before = self._last.get(topic)
            if before is not None:
                self.lost += header.sequence - before.sequence - 1
                self.back_in_time += header.time < before.time
            self._last[topic] = header
            self.frames += 1
            if self.frames % 50 == 0:
                self.not_finite += not np.isfinite(np.frombuffer(payload, dtype="<f4")).all()
            headers.append(header)
        return headers

    def close(self) -> None:
        self._context.destroy(linger=0)


def soak(
    folder: Path, puppet: Path, frames: int, pause: float, progress: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Run a service with all faults until `frames` frames have arrived.

    Parameters
    ----------
    folder : Path
        Folder for all files.
    puppet : Path
    frames : int
        Number of frames of all characters together that reach the good client.
    pause : float
        Seconds between two faults.
    progress : callable

    Returns
    -------
    dict
        What was done, what the service counted, and what the good client received.
    """
    folder.mkdir(parents=True, exist_ok=True)
    own = folder / "puppet.toml"
    _copy(puppet, own)
    port = free_udp_port()
    clock = _clock(folder)
    environment = {} if clock is None else clock
    with serving(folder, settings(dict.fromkeys(CHARACTERS, own), port), environment) as service:
        client = GoodClient(service.stream)
        faults = Peer(
            "faults",
            "benchmarks.live_faults",
            stream=service.stream,
            control=service.control,
            source=port,
            process=service.process.pid,
            puppet=str(own),
            takes=str(folder / "takes"),
            clock=environment.get("CLOCK_AHEAD"),
            characters=CHARACTERS,
            pause=pause,
        )
        started = time.monotonic()
        memory = _perform(client, service, port, frames, progress, started + MAX_SECONDS)
        seconds = time.monotonic() - started
        done = faults.end()
        status = _calm(client)
        late = _late_client(service.stream)
        code = service.end()
        client.close()
    settled = memory[round(WARM_UP_SHARE * len(memory)) :]
    first, *_, last = tenths = [float(np.median(part)) for part in np.array_split(settled, 10) if len(part)]
    said = [json.loads(line)["event"].partition(":")[0] for line in service.log.splitlines() if line.startswith("{")]
    events = Counter(said)
    [stage] = status["stages"]
    return {
        "frames": client.frames,
        "seconds": seconds,
        "lost": client.lost,
        "not_finite": client.not_finite,
        "back_in_time": client.back_in_time,
        "late_client": late,
        "exit_code": code,
        "skeletons": stage["frames"],
        "overtaken": stage["dropped"],
        "refused": stage["refused"],
        "clients_refused": status["clients"]["refused"],
        "faults": stage["faults"] + events["internal error"] + events["an internal error cost an event"],
        "tracebacks": service.log.lower().count("traceback"),
        "done": {name: done.get(name, 0) for name in Faults.names()},
        "unanswered": done.get("no answer", 0),
        "logged": dict(events.most_common(20)),
        "clock_steps": clock is not None,
        "memory_mb": {"first": first, "last": last, "growth": last / first - 1, "series": tenths},
    }


def _copy(puppet: Path, own: Path) -> None:
    """Copy a puppet file, with an absolute path of its mesh."""
    loaded = puppet_file.load(puppet)
    mesh = (puppet.parent / loaded.character.mesh).resolve()
    character = loaded.character.model_copy(update={"mesh": str(mesh)})
    puppet_file.dump(loaded.model_copy(update={"character": character}), own)


def _perform(
    client: GoodClient, service: Service, port: int, frames: int, progress: Callable[[str], None], until: float
) -> NDArray[np.float64]:
    """Send frames until `frames` have arrived; return the memory of the service in megabytes, once per second."""
    people = datagrams.bodies(len(CHARACTERS))
    performers = {
        user: Performer([together[user - 1] for together in people], user) for user in range(1, len(CHARACTERS) + 1)
    }
    memory: list[float] = []
    next_sample = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sending:
        while client.frames < frames and (now := time.monotonic()) < until:
            for header in client.take():
                if header.user in performers:
                    performers[header.user].answered(header, now)
            for performer in performers.values():
                if performer.due <= now:
                    performer.send(sending, port, now)
            client.wait(min(performer.due for performer in performers.values()) - time.monotonic())
            if now >= next_sample:
                next_sample = now + 1.0
                memory.append(service.memory() / 1e6)
                if len(memory) % 30 == 0:
                    progress(f"{client.frames:,} frames, {memory[-1]:.1f} MB, {client.lost} lost")
                if service.process.poll() is not None:
                    raise SystemExit(f"the service has ended ({service.process.returncode}):\n{service.log[-5000:]}")
    return np.array(memory)


def _calm(client: GoodClient, seconds: float = 1.5) -> dict[str, Any]:
    """Wait until the service is idle, and return its status."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        client.take()
        client.wait(0.1)
    return client.status


def _late_client(endpoint: str) -> bool:
    """Return whether a new client receives a scene, and frames without gaps."""
    with zmq.Context() as context, context.socket(zmq.SUB) as late:
        late.linger = 0
        for topic in ("one/scene/late", "one/controls"):
            late.subscribe(subscription(topic))
        late.connect(endpoint)
        scene, numbers = False, list[int]()
        while (len(numbers) < 20 or not scene) and late.poll(10_000):
            message = late.recv()
            if message.startswith(b"one/scene"):
                scene = True
            else:
                numbers.append(Header.unpack(message[TOPIC_BYTES:PAYLOAD_OFFSET]).sequence)
    return scene and numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def _clock(folder: Path) -> dict[str, str] | None:
    """Return the environment in which the wall clock steps; None if clock.c cannot be compiled."""
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None or sys.platform != "linux":
        return None
    library, ahead = folder / "clock.so", folder / "clock_ahead"
    done = subprocess.run(
        [compiler, "-O2", "-shared", "-fPIC", "-o", library, CLOCK, "-ldl"], capture_output=True, check=False
    )
    ahead.write_bytes(bytes(8))
    return None if done.returncode else {"LD_PRELOAD": str(library), "CLOCK_AHEAD": str(ahead)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("puppet", type=Path)
    parser.add_argument("--frames", type=int, default=FRAMES)
    parser.add_argument("--pause", type=float, default=0.5, help="seconds between two faults")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = soak(Path(folder), options.puppet, options.frames, options.pause, _progress)
    print(json.dumps(found, indent=2))


def _progress(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
