"""Record a take with sound while two characters perform, and count what is missing.

python -m benchmarks.recording [--seconds 600]

A sender sends 30 skeletons per second to the real command. The service hears a sound with a clap every ten seconds, and
streams two characters to a client. Frames in the take are counted beside those that were sent between its first and its
last one. The claps in the take's .wav show its drift.
"""

import argparse
import os
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import zmq

from benchmarks.live_peers import Service, free_udp_port, listener, sender, serving, settings
from capture.events import Cue
from capture.formats import puppetline_log
from capture.skeleton import SkeletonFrame
from capture.sound import SAMPLE_RATE, WavWriter, read_wav
from engine_bridge.character import examples

RATE = 30.0
"""Skeletons per second."""

WARM_UP_SECONDS = 5.0
"""Time before the recording, in seconds."""

CLAP_SECONDS = 10.0
"""Interval of the claps."""


def write_claps(path: Path, seconds: float) -> None:
    """Write a sound with claps of one sample."""
    with WavWriter(path) as writer:
        second = np.zeros(SAMPLE_RATE, np.float32)
        for number in range(round(seconds)):
            second[0] = number % CLAP_SECONDS == 0
            writer.write(second)


def ask(service: Service, do: str, **arguments: Any) -> None:
    """Send a request and wait for its reply."""
    with zmq.Context() as context, context.socket(zmq.REQ) as client:
        client.connect(service.control)
        client.send_json({"do": do, **arguments})
        reply: Any = client.recv_json()
        if not reply["ok"]:
            raise SystemExit(reply["error"])


def measure(folder: Path, seconds: float) -> None:
    """Record, and print the result."""
    names = ("human", "dog")
    puppets = {name: examples.prepare(name, folder)[1] for name in names}
    write_claps(folder / "claps.wav", seconds + 120)
    port = free_udp_port()
    text = settings(puppets, port).replace("[[stage]]\n", f'[[stage]]\nsound = "{folder / "claps.wav"}"\n')
    with serving(folder / "service", text) as service:
        client = listener(service.stream, [f"{name}/controls" for name in names])
        sending = sender(port, [(RATE, round(RATE * (seconds + 3 * WARM_UP_SECONDS)))], users=len(names))
        time.sleep(WARM_UP_SECONDS)
        before = service.cpu_seconds()
        ask(service, "record_start", name="take")
        time.sleep(seconds)
        ask(service, "record_stop")
        used = service.cpu_seconds() - before
        sent = np.array(sending.result()) / 1e9
        (lost,) = client.end()
    events = list(puppetline_log.events(folder / "service" / "takes" / "take.log"))
    times = np.array([each.time for each in events if isinstance(each, SkeletonFrame) and each.user == 1])
    begin = next(each.arguments["at"] for each in events if isinstance(each, Cue) and each.do == "sound")
    first, last = np.searchsorted(sent, times[[0, -1]])  # each arrived after it was sent
    heard, rate = read_wav(folder / "service" / "takes" / "take.wav")
    claps = np.flatnonzero(heard > 0.3) / rate
    claps = claps[np.insert(np.diff(claps) > 1, 0, True)]
    steps = CLAP_SECONDS * np.arange(len(claps))
    drift, off = (claps[-1] - claps[0]) / steps[-1] - 1, np.abs(claps - claps[0] - steps).max()
    print(f"{times[-1] - times[0]:.1f} s, {used:.0f} s of processor time, load {os.getloadavg()[1]:.1f}")
    print(f"skeletons: {last - first + 1:,} sent, {len(times):,} in the take; longest gap {np.diff(times).max():.3f} s")
    for name, each in lost.items():
        print(f"{name}: {each['messages']:,} streamed, {each['lost']} lost")
    print(f"sound: {len(heard) / rate:.2f} s from {begin - times[0]:+.2f} s on, drift {1e6 * drift:.1f} ppm")
    print(f"claps: {len(claps)}, off their times by at most {1000 * off:.1f} ms")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=600.0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as made:
        measure(Path(made), asked.seconds)
