"""Measure the live service: the real command with real senders and clients on loopback.

python -m benchmarks.live [--data FOLDER] [--quick] [--only latency,people,crowd,recovery,soak] [--keep FILE]

This takes three quarters of an hour on an otherwise idle machine; --quick takes four minutes and tests the benchmark.
FOLDER is searched for armadillo.obj as by `benchmarks.performance`. FILE (JSON) gets all values, and keeps those of
parts that were measured earlier.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from benchmarks import character_cost, live_numbers, live_soak
from benchmarks.character_cost_process import WARM_UP
from benchmarks.goals import Goal
from benchmarks.own_cache import own_cache
from engine_bridge.inspection.benchmark import CHARACTER, machine

PARTS = ("latency", "people", "crowd", "recovery", "soak")

PERFORMERS, CLIENTS = 8, 100

Say = Callable[[str], None]


@dataclass(frozen=True)
class Plan:
    """Durations and numbers of the measurements."""

    latency_seconds: float = 60.0
    people_seconds: float = 30.0
    crowd_rate: float = 240.0
    crowd_frames: int = 100_000
    recoveries: int = 9
    soak_frames: int = live_soak.FRAMES
    soak_pause: float = 0.5


QUICK = Plan(10.0, 10.0, 240.0, 4_000, 2, 20_000, 0.02)


def measure(
    folder: Path, character: dict[str, Any], plan: Plan, parts: tuple[str, ...], say: Say, keep: Path | None = None
) -> dict[str, Any]:
    """Measure parts one after the other.

    Parameters
    ----------
    folder : Path
        Folder from `character_cost.prepare`.
    character : dict
        Result of `character_cost.prepare`.
    plan : Plan
    parts : tuple of str
        Some of `PARTS`.
    say : callable
        Called with the name of the next step.
    keep : Path, optional
        File with earlier measurements, to which each part is added when it is complete.

    Returns
    -------
    dict
        A value for each part, ``character``, ``machine``, and ``load``: the mean number of running processes in the
        minute before each part.
    """
    puppet, scratch = folder / CHARACTER, folder / "live"
    say("compiling")
    live_numbers.latency(scratch / "first", puppet, 30.0, 90)
    found: dict[str, Any] = {"load": {}}
    if keep is not None and keep.exists():
        found = json.loads(keep.read_text(encoding="utf-8"))
    found |= {"character": character, "machine": machine()}
    todo: dict[str, Callable[[], Any]] = {
        "latency": lambda: {
            f"{rate:g}": live_numbers.latency(scratch, puppet, rate, round(rate * plan.latency_seconds))
            for rate in (30.0, 60.0)
        },
        "people": lambda: live_numbers.people(scratch, puppet, PERFORMERS, plan.people_seconds),
        "crowd": lambda: live_numbers.crowd(scratch, puppet, CLIENTS, plan.crowd_rate, plan.crowd_frames),
        "recovery": lambda: live_numbers.recovery(scratch, puppet, plan.recoveries, say),
        "soak": lambda: live_soak.soak(scratch / "soak", folder / WARM_UP, plan.soak_frames, plan.soak_pause, say),
    }
    for part in parts:
        say(part)
        load = os.getloadavg()[0]
        found[part] = todo[part]()
        found["load"][part] = load
        if keep is not None:
            keep.write_text(json.dumps(found, indent=2, default=float), encoding="utf-8")
    return found


def table(found: dict[str, Any]) -> Iterator[str]:
    """Yield the result of `measure` as lines of Markdown."""
    character, system = found["character"], found["machine"]
    loads = ", ".join(f"{load:.1f} {part}" for part, load in found["load"].items())
    yield (
        f"{character['name']}: {character['vertices']:,} vertices; {system['processor']}, {system['cores']} cores; "
        f"{system['system']}; Python {system['python']}; load before: {loads}"
    )
    yield from ("", "| what | goal | measured | |", "| --- | --- | --- | --- |")
    yield from (goal.line() for goal in _goals(found))
    yield from ("", "Other measurements:", "", "| what | measured |", "| --- | --- |")
    yield from (f"| {what} | {value} |" for what, value in _facts(found))


def _goals(found: dict[str, Any]) -> Iterator[Goal]:
    for rate, each in found.get("latency", {}).items():
        yield Goal(
            f"{rate} Hz, datagram received → controls in another process, median", each["received_p50_ms"], 3, "ms"
        )
        yield Goal("… 99th percentile", each["received_p99_ms"], 8, "ms")
        yield Goal("… datagram sent → controls, median", each["sent_p50_ms"], 3, "ms")
        yield Goal("… 99th percentile", each["sent_p99_ms"], 8, "ms")
    if "people" in found:
        yield Goal(f"{PERFORMERS} characters at 30 Hz, share of one core", 100 * found["people"]["cpu"], 100, "%")
    if "crowd" in found:
        crowd = found["crowd"]
        spread = crowd["memory_mb"]["most"] - crowd["memory_mb"]["least"]
        clients = f"{CLIENTS} clients, {live_numbers.STALLED_CLIENTS} of which never read, {crowd['frames']:,} frames"
        yield Goal(f"{clients}: frames that the others lost", crowd["lost"], 0, "")
        yield Goal("… memory, ± around its midpoint", spread / 2, 5, "MB")
    if "recovery" in found:
        recovery = found["recovery"]
        back = [then - start for then, start in zip(recovery["performing"], recovery["start"], strict=True)]
        for what, seconds in (
            (f"source back after {live_numbers.SILENCE_SECONDS:g} s → performing", recovery["silent"]),
            ("service killed, and back → performing", back),
            ("a new client → scene and controls", recovery["client"]),
        ):
            yield Goal(f"{what}, median", median(seconds), 1, "s")
            yield Goal("… the slowest", max(seconds), 1, "s")
    if "soak" in found:
        soak = found["soak"]
        yield Goal("soak, frames", soak["frames"], live_soak.FRAMES, "", least=True)
        yield Goal("… exceptions that escaped", soak["faults"] + soak["tracebacks"], 0, "")
        yield Goal("… frames that a good client lost", soak["lost"], 0, "")
        yield Goal("… memory at the end / after a tenth of it", abs(100 * soak["memory_mb"]["growth"]), 2, "%")


def _facts(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for rate, each in found.get("latency", {}).items():
        yield (
            f"{rate} Hz: frames; share of one core; the slowest",
            (f"{each['frames']:,}; {100 * each['cpu']:.1f} %; {each['received_max_ms']:.1f} ms received → controls"),
        )
    if "people" in found:
        yield (f"{PERFORMERS} characters: frames streamed", f"{100 * found['people']['performed']:.1f} % of those sent")
    if "crowd" in found:
        crowd = found["crowd"]
        yield (
            "clients: source; share of one core; readers without a gap",
            (f"{crowd['rate']:g} Hz; {100 * crowd['cpu']:.0f} %; {crowd['without_gap']} of {crowd['readers']}"),
        )
        yield "… memory, MB, by tenths", _series(crowd["memory_mb"]["series"])
    if "recovery" in found:
        recovery = found["recovery"]
        for name, what in (
            ("start", "call of the command after a kill → it serves"),
            ("first_frame", "… → first frame at a client"),
            ("performing", "… → performing"),
        ):
            yield what, f"{median(recovery[name]):.2f} s, {max(recovery[name]):.2f} s the slowest"
    if "soak" in found:
        soak = found["soak"]
        yield "soak", f"{soak['seconds'] / 60:.0f} min, {soak['frames'] / soak['seconds']:.0f} frames per second"
        yield ("… faults", ", ".join(f"{number} × {name.replace('_', ' ')}" for name, number in soak["done"].items()))
        yield "… datagrams refused; clients refused", f"{sum(soak['refused'].values()):,}; {soak['clients_refused']:,}"
        yield "… memory, MB, by tenths", _series(soak["memory_mb"]["series"])


def _series(values: list[float]) -> str:
    return " ".join(f"{value:.1f}" for value in values)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a folder that contains armadillo.obj")
    parser.add_argument("--quick", action="store_true", help="short measurements")
    parser.add_argument("--only", default=",".join(PARTS), help=f"a part of {','.join(PARTS)}")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="file to add the values to")
    options = parser.parse_args()
    mesh = min(options.data.rglob("armadillo.obj"), default=None) if options.data else None
    with tempfile.TemporaryDirectory() as folder, own_cache(Path(folder)):
        subject = Path(folder) / "subject"
        subject.mkdir()
        character = character_cost.prepare(subject, mesh, 60)
        found = measure(
            subject,
            character,
            QUICK if options.quick else Plan(),
            tuple(options.only.split(",")),
            lambda text: print(text, file=sys.stderr, flush=True),
            options.keep,
        )
    print("\n".join(table(found)))


if __name__ == "__main__":
    main()
