"""The measurements of `benchmarks.live`: latency, many performers, many clients, and recovery."""

import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zmq
from numpy.typing import NDArray

from benchmarks.live_peers import PERFORMING, free_tcp_ports, free_udp_port, listener, sender, serving, settings
from engine_bridge.service.protocol.header import TOPIC_BYTES, subscription

CALIBRATION_FRAMES = (30.0, 90)
"""Rate and number of each sender's first frames: three seconds, in which the performer is calibrated."""

SILENCE_SECONDS = 3.0
"""How long a source sends nothing, in seconds."""

SAVED_SECONDS = 7.0
"""Time after which a calibration is on the disk, in seconds."""

SAMPLE_SECONDS = 0.5
"""Time between two samples of the memory, in seconds."""

STALLED_CLIENTS = 10
"""Number of clients that never read."""

Say = Callable[[str], None]


def latency(folder: Path, puppet: Path, rate: float, frames: int) -> dict[str, float]:
    """Measure the latency of one performer's frames in another process, and the service's processor time.

    Returns
    -------
    dict
        Milliseconds from the time in the header (the datagram was read and decoded) to the arrival of the controls, and
        from the time at which the datagram was sent; the service's share of one core; the number of frames.
    """
    port = free_udp_port()
    with serving(folder / f"latency{rate:g}", settings({"one": puppet}, port)) as service:
        client = listener(service.stream, ["one/controls"], times=True)
        performer = sender(port, [CALIBRATION_FRAMES, (rate, frames)])
        time.sleep(CALIBRATION_FRAMES[1] / CALIBRATION_FRAMES[0] + 1.0)
        cpu = _cpu_share(service.cpu_seconds, frames / rate - 2.0)
        sent = np.array(performer.result())
        time.sleep(0.5)
        [heard] = client.end()
    times = np.array(heard["times"])
    times = times[(times[:, 0] == PERFORMING) & (times[:, 1] >= sent[CALIBRATION_FRAMES[1]])]
    if not len(times):
        raise SystemExit(f"no frame of a performer arrived:\n{service.log}")
    received, arrived = times[:, 1], times[:, 2]
    of_datagram = sent[np.searchsorted(sent, received) - 1]
    return {
        **_percentiles("received", arrived - received),
        **_percentiles("sent", arrived - of_datagram),
        "cpu": cpu,
        "frames": len(times),
        "lost": heard["one/controls"]["lost"],
    }


def people(folder: Path, puppet: Path, number: int, seconds: float) -> dict[str, float]:
    """Measure the service's share of one core while `number` performers drive as many characters with a client.

    Returns
    -------
    dict
        The share, the number of frames that the client lost, and the share of the performers' frames that it received.
    """
    port = free_udp_port()
    names = [f"character{n}" for n in range(1, number + 1)]
    with serving(folder / "people", settings(dict.fromkeys(names, puppet), port)) as service:
        client = listener(service.stream, [f"{name}/controls" for name in names], times=True)
        performers = sender(port, [CALIBRATION_FRAMES, (30.0, round(30 * (seconds + 2)))], number)
        time.sleep(CALIBRATION_FRAMES[1] / CALIBRATION_FRAMES[0] + 1.0)
        begun = time.monotonic_ns()
        cpu = _cpu_share(service.cpu_seconds, seconds)
        ended = time.monotonic_ns()
        performers.result()
        [heard] = client.end()
    times = np.array(heard.pop("times"))
    performed = (times[:, 0] == PERFORMING) & (times[:, 2] >= begun) & (times[:, 2] < ended)
    return {
        "cpu": cpu,
        "lost": sum(each["lost"] for each in heard.values()),
        "performed": np.count_nonzero(performed) / (number * 30 * (ended - begun) * 1e-9),
    }


def crowd(folder: Path, puppet: Path, clients: int, rate: float, frames: int) -> dict[str, Any]:
    """Send frames to `clients` clients, `STALLED_CLIENTS` of which never read, and measure the service's memory.

    Returns
    -------
    dict
        Number of readers, of readers without a gap, and of frames that the others lost; the service's share of one
        core, its memory after a tenth of the frames (least, most, one value per tenth), and its internal errors.
    """
    port = free_udp_port()
    readers, processes = clients - STALLED_CLIENTS, 3
    with serving(folder / "crowd", settings({"one": puppet}, port, max_clients=2 * clients)) as service:
        each = [readers // processes + (n < readers % processes) for n in range(processes)]
        reading = [listener(service.stream, ["one/controls"], sockets) for sockets in each]
        stalled = listener(service.stream, ["one/controls", "one/vertices16"], STALLED_CLIENTS, reads=False)
        time.sleep(3.0)
        performer = sender(port, [CALIBRATION_FRAMES, (rate, frames)])
        time.sleep(CALIBRATION_FRAMES[1] / CALIBRATION_FRAMES[0])
        memory, begun, used = [], time.monotonic(), service.cpu_seconds()
        while time.monotonic() < begun + frames / rate - 1.0:
            time.sleep(SAMPLE_SECONDS)
            memory.append(service.memory() / 1e6)
        cpu = (service.cpu_seconds() - used) / (time.monotonic() - begun)
        performer.result()
        time.sleep(1.0)
        heard = [one["one/controls"] for peer in reading for one in peer.end()]
        stalled.end()
        faults = service.log.count("internal error")
    last = max(one["last"] for one in heard)
    return {
        "rate": rate,
        "frames": last,
        "readers": len(heard),
        "without_gap": sum(one["lost"] == 0 for one in heard),
        "lost": sum(one["lost"] for one in heard),
        "cpu": cpu,
        "memory_mb": summary(np.array(memory[len(memory) // 10 :])),
        "faults": faults,
    }


def recovery(folder: Path, puppet: Path, times: int, say: Say) -> dict[str, list[float]]:
    """Silence the source, then kill the service, and measure the time until the character moves again.

    Returns
    -------
    dict
        Lists of seconds. ``silent``: from the first datagram after the silence to the first frame of the
        performer at the client. ``start``: from the start of the command until it serves; ``first_frame`` and
        ``performing``: from the same start to the first frame of any kind, and of the performer, at a client that was
        connected all the time. ``client``: from the connection of a new client until it has the scene and controls.
    """
    source, stream = free_udp_port(), free_tcp_ports()
    text = settings({"one": puppet}, source, stream=stream)
    endless = [(30.0, 1_000_000)]
    starts: list[tuple[int, int]] = []
    with serving(folder / "recovery", text) as service:
        client = listener(service.stream, ["one/controls"], times=True)
        performers = [sender(source, endless)]
        sent: list[list[int]] = []
        for number in range(times):
            say(f"silence {number + 1} of {times}")
            time.sleep(SILENCE_SECONDS)
            sent.append(performers[-1].end())
            time.sleep(SILENCE_SECONDS)
            performers.append(sender(source, endless))
        time.sleep(SAVED_SECONDS)
        connecting = [_connecting(service.stream, number) for number in range(times)]
        service.end(signal.SIGKILL)
    for number in range(times):
        say(f"kill {number + 1} of {times}")
        time.sleep(1.0)
        with serving(folder / "recovery", text) as service:
            starts.append((service.started, service.ready))
            time.sleep(SAVED_SECONDS)
            service.end(signal.SIGKILL)
    sent.append(performers[-1].end())
    [heard] = client.end()
    times_heard = np.array(heard["times"])
    arrived = times_heard[:, 2]
    performed = arrived[times_heard[:, 0] == PERFORMING]
    return {
        "silent": [_first(performed, own[0]) for own in sent[1:]],
        "start": [1e-9 * (ready - started) for started, ready in starts],
        "first_frame": [_first(arrived, started) for started, _ in starts],
        "performing": [_first(performed, started) for started, _ in starts],
        "client": connecting,
    }


def summary(values: NDArray[np.float64]) -> dict[str, Any]:
    """Return the smallest and the largest value of a series, and the median of every tenth."""
    tenths = [round(float(np.median(part)), 1) for part in np.array_split(values, 10) if len(part)]
    return {"least": float(values.min()), "most": float(values.max()), "series": tenths}


def _cpu_share(used: Callable[[], float], seconds: float) -> float:
    """Return the share of one core that is used in the next seconds."""
    before, begun = used(), time.monotonic()
    time.sleep(seconds)
    return (used() - before) / (time.monotonic() - begun)


def _percentiles(name: str, nanoseconds: NDArray[np.int64]) -> dict[str, float]:
    p50, p99, most = np.percentile(nanoseconds * 1e-6, (50, 99, 100))
    return {f"{name}_p50_ms": p50, f"{name}_p99_ms": p99, f"{name}_max_ms": most}


def _first(moments: NDArray[np.int64], begin: int) -> float:
    """Return the seconds from the beginning to the first of these times after it."""
    return float(1e-9 * (moments[np.searchsorted(moments, begin)] - begin))


def _connecting(endpoint: str, number: int) -> float:
    """Return the seconds until a new client has controls, and the scene under its own topic."""
    wanted = {b"one/scene/%d" % number, b"one/controls"}
    begun = time.monotonic()
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.linger = 0
        for topic in wanted:
            socket.subscribe(subscription(topic.decode()))
        socket.connect(endpoint)
        while wanted:
            wanted.discard(socket.recv()[:TOPIC_BYTES].rstrip(b"\0"))
    return time.monotonic() - begun
