"""Throughput, efficiency, memory and overhead of `puppetline batch`.

    python -m benchmarks.batch --data FOLDER --clips 600       # the table of docs/performance.md: about 6 minutes
    python -m benchmarks.batch --clips 40                      # without recordings of sensors: minutes

Each updates the table of docs/performance.md. The recordings are those of the folder, in parts of at most four seconds,
and others made from them by resampling and mirroring. Each is converted with three example characters by two workers;
some of them, evenly chosen, also by one. Rates are between the first and the last result, so that the start of the
workers is not included.
"""

import argparse
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import psutil
from puppetline.examples.performances import PERFORMANCES

from benchmarks.documents import DOCUMENT, replaced
from capture.clip import SkeletonClip
from capture.formats import read_log
from capture.formats.options import ReadOptions
from capture.recording import Recorder
from capture.skeleton import mirrored
from capture.timeline import Timeline, choose, resample
from engine_bridge.batch.recordings import find_recordings
from engine_bridge.batch.store import OWN_FOLDER, RECORD_FOLDER
from engine_bridge.character.examples import prepare
from engine_bridge.export.convert import convert_timeline
from engine_bridge.performance.clip import load_timeline
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from puppetline.errors import PuppetlineError

CHARACTERS = ("human", "dog", "dinosaur")

SPEEDS = (1.0, 0.8, 1.25, 0.9, 1.1, 0.7, 1.4)
"""Speeds at which recordings are resampled; each is also mirrored."""

MAX_SECONDS = 4.0
"""Duration after which a recording is cut into several. Clips of NTU RGB+D have 2.3 seconds on average."""

ONE_WORKER_CLIPS = 200
"""Largest number of recordings that one worker converts."""

SHORT_CLIPS, SHORT_FRAMES = 60, 30
"""Number of recordings of one second with which the overhead is measured, and of frames of each."""

WARM_RESULTS = 10
"""Number of results after which the memory of a worker should not grow any more."""

POLL_SECONDS = 0.25
"""Time between two measurements of memory, in seconds."""

KEEP_SECONDS = 30.0
"""Age of a result at which it is deleted, in seconds: 6,000 results would take 90 GB."""

NTU_CLIPS, NTU_FRAMES = 56_880, 4_000_000
"""Number of clips of NTU RGB+D, and of its frames ("more than 4 million", A. Shahroudy et al. 2016)."""


@dataclass(frozen=True)
class Run:
    """A batch that was measured.

    Attributes
    ----------
    made, failed : int
        Numbers of results and failures.
    per_hour : float
        Results per hour between the first and the last.
    seconds : float
        Duration of the command, with its start.
    memory : dict
        Memory of each worker process: pairs of the number of results of the batch and megabytes.
    rows : list of dict
        Rows of the results and failures.
    """

    made: int
    failed: int
    per_hour: float
    seconds: float
    memory: dict[int, list[tuple[int, float]]]
    rows: list[dict]


def sources(data: Path | None) -> Iterator[SkeletonClip]:
    """Yield the longest-tracked performer of each recording, or example performances without a folder."""
    if data is None:
        yield from (perform() for perform in PERFORMANCES.values())
        return
    for recording in find_recordings([str(data / "logs"), str(data / "bvh")], data / "none", ReadOptions()).found:
        try:
            yield choose(read_log(recording.path))[0]
        except PuppetlineError as error:
            print(f"  not used: {error}")


def variants(clips: list[SkeletonClip]) -> Iterator[Timeline]:
    """Yield endless parts of clips at other speeds and mirrored."""
    while True:
        for speed in SPEEDS:
            for is_mirrored in (False, True):
                for clip in clips:
                    fast = replace(clip, times=clip.times / speed)
                    timeline = resample(fast, 30.0)
                    positions = mirrored(timeline.positions) if is_mirrored else timeline.positions
                    length = int(30 * MAX_SECONDS)
                    for start in range(0, max(len(positions) - 15, 1), length):
                        part = slice(start, start + length)
                        yield Timeline(30.0, positions[part], timeline.confidence[part], ())


def write(timeline: Timeline, path: Path) -> None:
    """Write a recording in Puppetline's own format."""
    with Recorder(path) as recorder:
        for number in range(len(timeline.positions)):
            recorder.write(timeline.frame(number))


def memory_of(process: psutil.Process) -> dict[int, float]:
    """Return the resident memory of each worker process in megabytes."""
    memory = {}
    for child in process.children(recursive=True):
        try:
            if any("spawn_main" in part for part in child.cmdline()):
                memory[child.pid] = child.memory_info().rss / 1e6
        except psutil.NoSuchProcess:
            continue
    return memory


def delete_old(output: Path) -> None:
    """Delete results of a batch that were made some time ago."""
    for result in output.glob("*/*.glb"):
        if time.time() - result.stat().st_mtime > KEEP_SECONDS:
            result.unlink()


def measured(logs: Path, puppets: list[Path], output: Path, workers: int) -> Run:
    """Run a batch and measure it."""
    chosen = [each for puppet in puppets for each in ("--puppet", str(puppet))]
    command = [sys.executable, "-m", "puppetline", "batch", str(logs), *chosen, "-o", str(output), "--no-report"]
    start = time.perf_counter()
    process = subprocess.Popen([*command, "--workers", str(workers), "--json"], stdout=subprocess.PIPE, text=True)
    records = output / OWN_FOLDER / RECORD_FOLDER
    memory: dict[int, list[tuple[int, float]]] = {}
    while process.poll() is None:
        count = sum(1 for _ in records.rglob("*.json"))
        for pid, size in memory_of(psutil.Process(process.pid)).items():
            memory.setdefault(pid, []).append((count, size))
        delete_old(output)
        time.sleep(POLL_SECONDS)
    seconds = time.perf_counter() - start
    assert process.stdout is not None
    result = json.loads(process.stdout.read())
    times = sorted(path.stat().st_mtime for path in records.rglob("*.json"))
    rows = [row for path in records.rglob("*.json") for row in json.loads(path.read_text())["rows"]]
    per_hour = 3600 * (len(times) - 1) / (times[-1] - times[0])
    return Run(result["made"], len(result["failures"]), per_hour, seconds, memory, rows)


def loop(logs: Path, puppet: Path, folder: Path) -> float:
    """Return the seconds per recording of a loop in one process with a character that is prepared once."""
    settings, prepared = Settings(), load_prepared(puppet)
    folder.mkdir()
    times = []
    for log in sorted(logs.iterdir()):
        timeline, notes = load_timeline(log, settings)
        convert_timeline(prepared, timeline, folder / f"{log.stem}.glb", log.stem, settings, notes)
        times.append(time.perf_counter())
    return (times[-1] - times[0]) / (len(times) - 1)


def growth(run: Run) -> list[str]:
    """Return the memory of each worker after the first results and at the end."""
    lines = []
    for number, samples in enumerate(run.memory.values(), 1):
        warm = [size for count, size in samples if count >= WARM_RESULTS * len(run.memory)]
        if warm:
            lines.append(
                f"{np.median(warm[: len(warm) // 10 + 1]):.0f} → {np.median(warm[-len(warm) // 10 - 1 :]):.0f}"
            )
            lines[-1] += f", at most {max(warm):.0f} MB (worker {number})"
    return lines


def extrapolated(run: Run) -> str:
    """Return the time for NTU RGB+D, from a straight line through the times of the results against their frames."""
    done = [row for row in run.rows if row["state"] == "done"]
    lines = []
    for puppet in sorted({row["puppet"] for row in done}):
        rows = [row for row in done if row["puppet"] == puppet]
        each, start = np.polyfit([row["frames"] for row in rows], [row["conversion_seconds"] for row in rows], 1)
        hours = NTU_CLIPS * (start + each * NTU_FRAMES / NTU_CLIPS) / 3600
        lines.append(f"{Path(puppet).stem}: {1000 * start:.0f} ms + {1000 * each:.2f} ms per frame, {hours:.1f} hours")
    return "; ".join(lines)


def write_logs(clips: list[SkeletonClip], folder: Path, count: int) -> None:
    """Write a number of recordings."""
    folder.mkdir()
    for number, timeline in zip(range(count), variants(clips), strict=False):
        write(timeline, folder / f"{number:05}.log")


def some_of(logs: Path, folder: Path) -> Path:
    """Return a folder with some recordings, evenly chosen."""
    folder.mkdir()
    found = sorted(logs.iterdir())
    for path in found[:: math.ceil(len(found) / ONE_WORKER_CLIPS)]:
        (folder / path.name).hardlink_to(path)
    return folder


def write_short(clips: list[SkeletonClip], folder: Path) -> None:
    """Write recordings of one second."""
    folder.mkdir()
    second = slice(0, SHORT_FRAMES)
    for number, timeline in zip(range(SHORT_CLIPS), variants(clips), strict=False):
        part = Timeline(timeline.fps, timeline.positions[second], timeline.confidence[second], ())
        write(part, folder / f"{number}.log")


def table(count: int, one: Run, two: Run, overhead: tuple[float, float]) -> list[str]:
    """Return the rows of the table in the document."""
    batch, alone = overhead
    seconds = sum(row["seconds"] or 0 for row in two.rows)
    return [
        "| measure | number | goal |",
        "| --- | --- | --- |",
        f"| {count:,} recordings with {len(CHARACTERS)} characters: results, failed, motion "
        f"| {two.made:,}, {two.failed:,}, {seconds / 3600:.2f} hours | – |",
        f"| results per hour, one worker and two | {one.per_hour:,.0f} and {two.per_hour:,.0f} | – |",
        f"| two workers / one | {two.per_hour / one.per_hour:.2f} × | ≥ 1.7 × |",
        f"| whole command, one worker ({one.made:,} results) and two "
        f"| {one.seconds:,.0f} s and {two.seconds:,.0f} s | – |",
        f"| memory of a worker, after {WARM_RESULTS} results → at the end | {'; '.join(growth(two)) or '–'} | flat |",
        f"| recording of one second, in a batch / in a loop in one process "
        f"| {batch:.3f} / {alone:.3f} s = {batch / alone:.2f} × | ≤ 1.3 × |",
        f"| NTU RGB+D, {NTU_CLIPS:,} clips with one worker, extrapolated from costs per clip and frame "
        f"| {extrapolated(one)} | – |",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="folder with real recordings in logs and bvh")
    parser.add_argument("--clips", type=int, default=40, help="number of recordings, at most 2,000 in the docs")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        scratch = Path(temporary)
        puppets = [prepare(name, scratch)[1] for name in CHARACTERS]
        clips = list(sources(arguments.data))
        write_short(clips, scratch / "short")
        alone = loop(scratch / "short", puppets[0], scratch / "alone")
        batch = 3600 / measured(scratch / "short", puppets[:1], scratch / "short_out", 1).per_hour
        write_logs(clips, scratch / "logs", arguments.clips)
        print(f"{arguments.clips} recordings from {len(clips)}, with {', '.join(CHARACTERS)}", flush=True)
        one = measured(some_of(scratch / "logs", scratch / "some"), puppets, scratch / "one", 1)
        two = measured(scratch / "logs", puppets, scratch / "two", 2)
    lines = table(arguments.clips, one, two, (batch, alone))
    print("\n".join(lines))
    DOCUMENT.write_text(replaced(DOCUMENT.read_text(encoding="utf-8"), "batch", lines), encoding="utf-8")


if __name__ == "__main__":
    main()
