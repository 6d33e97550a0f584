"""Measure the page of the studio: the time from a skeleton to its image, images per second, and bytes.

python -m benchmarks.studio [--data FOLDER] [--characters 4] [--seconds 20]

Chromium with Playwright (`make peers`) draws characters of the Armadillo's size without a graphics card (SwiftShader),
so drawing takes the time of the processor. FOLDER is searched for armadillo.obj; the default is an example character
with as many vertices. What the page's scripts take of each image is measured in the same run.
"""

import argparse
import gzip
import itertools
import os
import shutil
import socket
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import character_cost
from benchmarks.datagrams import bodies
from benchmarks.live_peers import free_tcp_ports, free_udp_port
from benchmarks.own_cache import own_cache
from benchmarks.studio_page import SIZE, chromium, command
from engine_bridge.inspection import benchmark
from engine_bridge.studio.web.web_app import PAGE

SKELETONS_PER_SECOND = 60

FOLLOW = """() => {
  window.arrivals = new Map();
  const Original = WebSocket;
  window.WebSocket = class extends Original {
    constructor(address, ...rest) {
      super(address, ...rest);
      if (!String(address).endsWith("/stream")) return;
      this.addEventListener("message", ({ data }) => {
        if (!(data instanceof ArrayBuffer) || data.byteLength < 128) return;
        const view = new DataView(data);
        if (view.getUint8(66) !== 2) return;
        const topic = new TextDecoder().decode(new Uint8Array(data, 0, 64)).replaceAll("\\0", "");
        const [received, published] = [view.getBigUint64(96, true), view.getBigUint64(104, true)];
        window.arrivals.set(`${topic} ${view.getBigUint64(80, true)}`, {
          received: Number(received) / 1e6, published: Number(published) / 1e6, arrived: performance.now(),
        });
      });
    }
  };
}"""
"""JavaScript: note when frames of controls arrive, in milliseconds."""

MEASURE = """async ([name, seconds]) => {
  const images = [], seen = new Map(), scripts = [];
  const end = performance.now() + 1000 * seconds;
  await new Promise((resolve) => {
    const look = (begun) => {
      const now = performance.now();
      images.push(begun);
      scripts.push(now - begun);
      const moment = studio.viewer.moment(name);
      if (moment !== null) {
        if (!seen.has(moment.later)) seen.set(moment.later, { first: now });
        const whole = seen.get(moment.earlier);
        if (whole !== undefined && whole.whole === undefined) whole.whole = now;
      }
      if (now < end) requestAnimationFrame(look);
      else resolve();
    };
    requestAnimationFrame(look);
  });
  const frames = [];
  for (const [sequence, { first, whole }] of seen) {
    const arrival = window.arrivals.get(`${name}/controls ${sequence}`);
    if (arrival !== undefined && whole !== undefined) frames.push({ ...arrival, first, whole });
  }
  return { frames, images, scripts, origin: performance.timeOrigin };
}"""
"""JavaScript: for each frame, when the first image with a part of its motion was drawn, and the one with all of it."""


@contextmanager
def kiosk(puppets: list[Path], port: int, udp: int) -> Iterator[str]:
    """Serve characters with the studio's page; yield the page's address."""
    named = [part for puppet in puppets for part in ("--puppet", str(puppet))]
    given = ["serve", "--source", f"osc:{udp}", "--calibrate", "at_once", *named, "--port", port, "--no-announce"]
    with command(*given, "--studio", 0) as addresses:
        for address in addresses:
            yield address
            return
        raise SystemExit("the service has ended")


@contextmanager
def performing(port: int, performers: int) -> Iterator[None]:
    """Send skeletons at 60 Hz."""
    stop = threading.Event()

    def send() -> None:
        due = time.monotonic()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
            for together in itertools.cycle(bodies(performers)):
                if stop.is_set():
                    return
                for packet in together:
                    udp.sendto(packet, ("127.0.0.1", port))
                due += 1 / SKELETONS_PER_SECOND
                time.sleep(max(0.0, due - time.monotonic()))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        stop.set()
        sender.join()


@contextmanager
def browsing(address: str) -> Iterator[Any]:
    """Open the page in Chromium without a graphics card; yield Playwright's page as soon as characters move."""
    with chromium() as browser:
        page = browser.new_page(viewport=SIZE)
        page.add_init_script(f"({FOLLOW})()")
        page.goto(address)
        moving = "studio.state().server?.characters.every(({ name }) => studio.viewer.moment(name))"
        while not page.evaluate(f"studio.state().server?.characters.length && {moving}"):
            page.wait_for_timeout(100)
        yield page


def clock_offset(page: Any) -> float:
    """Return the milliseconds to add to the page's clock for this process's monotonic clock."""
    trips = []
    for _ in range(50):
        before = time.monotonic_ns()
        there = page.evaluate("performance.now()")
        after = time.monotonic_ns()
        trips.append((after - before, (before + after) / 2e6 - there))
    return float(min(trips)[1])


def profile(page: Any, seconds: float) -> dict[str, float]:
    """Return the milliseconds per second that the page's main thread spends in scripts and in all tasks."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")

    def metrics() -> dict[str, float]:
        return {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}

    before = metrics()
    page.wait_for_timeout(1000 * seconds)
    after = metrics()
    passed = after["Timestamp"] - before["Timestamp"]
    return {key: 1000 * (after[key] - before[key]) / passed for key in ("ScriptDuration", "TaskDuration")}


def measured(page: Any, seconds: float) -> Iterator[str]:
    """Yield the lines of a table."""
    name = page.evaluate("studio.state().character")
    offset = clock_offset(page)
    found = page.evaluate(MEASURE, [name, seconds])
    frames = found["frames"]

    def part(title: str, values: list[float]) -> str:
        low, median, high = np.percentile(values, [5, 50, 95])
        return f"| {title} | {median:.1f} | {low:.1f} | {high:.1f} |"

    yield "| ms | median | 5 % | 95 % |"
    yield "| --- | --- | --- | --- |"
    yield part("skeleton received to frame sent", [each["published"] - each["received"] for each in frames])
    yield part("sent to received by the page", [each["arrived"] + offset - each["published"] for each in frames])
    yield part("received to first image that contains it", [each["first"] - each["arrived"] for each in frames])
    yield part("skeleton to first image", [each["first"] + offset - each["received"] for each in frames])
    yield part("skeleton to image of the whole motion", [each["whole"] + offset - each["received"] for each in frames])
    images = np.diff(found["images"])
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN")
    yield f"first paint: {paint:.0f} ms"
    yield f"images per second: {1000 / images.mean():.1f}; frames: {len(frames)}"
    spent = profile(page, min(seconds, 5.0))
    rate = 1000 / images.mean()
    yield (
        f"main thread per image: {spent['ScriptDuration'] / rate:.2f} ms of scripts, "
        f"{spent['TaskDuration'] / rate:.2f} ms in all"
    )


def sizes() -> str:
    """Return the bytes of the page."""
    files = [path for path in PAGE.rglob("*") if path.is_file()]
    return f"bytes of the page with gzip: {sum(len(gzip.compress(path.read_bytes())) for path in files):,}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a folder that contains armadillo.obj")
    parser.add_argument("--characters", type=int, default=4, help="number of characters in the second measurement")
    parser.add_argument("--seconds", type=float, default=20.0, help="duration of each measurement")
    options = parser.parse_args()
    mesh = min(options.data.rglob("armadillo.obj"), default=None) if options.data else None
    print(sizes())
    with tempfile.TemporaryDirectory() as folder, own_cache(Path(folder)):
        character = character_cost.prepare(Path(folder), mesh, 10)
        puppet = Path(folder) / benchmark.CHARACTER
        print(f"{character['name']}: {character['vertices']:,} vertices; load before: {os.getloadavg()[0]:.1f}")
        for count in (1, options.characters):
            puppets = [puppet.with_name(f"character{number}.toml") for number in range(count)]
            for each in puppets:
                shutil.copy(puppet, each)
            udp, tcp = free_udp_port(), free_tcp_ports()
            with performing(udp, count), kiosk(puppets, tcp, udp) as address, browsing(address) as page:
                print(f"\n{count} of them:\n")
                print("\n".join(measured(page, options.seconds)), flush=True)


if __name__ == "__main__":
    main()
