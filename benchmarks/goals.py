"""Goals, and the measurements that they are compared with."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from benchmarks import character_cost
from benchmarks.character_cost import in_process
from benchmarks.processes import MODULE
from engine_bridge.inspection import benchmark
from engine_bridge.inspection.benchmark import number

LONG, SHORT = character_cost.CONVERTED_FRAMES, 180
"""Numbers of frames of two recordings whose conversion is compared."""


@dataclass(frozen=True)
class Goal:
    """A row of the table: a value that should be at most the limit, or at least if `least`; None if not measurable."""

    what: str
    value: float | None
    limit: float
    unit: str
    least: bool = False

    def line(self) -> str:
        """Return the goal as a row of a Markdown table."""
        goal = f"{'≥' if self.least else '≤'} {_plain(self.limit, f'{self.limit:g}')} {self.unit}".rstrip()
        if self.value is None:
            return f"| {self.what} | {goal} | – | |"
        measured = f"{_plain(self.value, number(self.value))} {self.unit}".rstrip()
        above, below = (self.limit, self.value) if self.least else (self.value, self.limit)
        off = f", {number(above / below)} × the goal" if below else ""
        return f"| {self.what} | {goal} | {measured} | {'met' if above <= below else f'missed{off}'} |"


def _plain(value: float, text: str) -> str:
    """Return the text of a measurement, or an integer with all digits."""
    return f"{value:,}" if isinstance(value, int) else text


def table(folder: Path, character: dict[str, Any], points: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the goals and their measurements as lines of text, then all values of the run.

    Parameters
    ----------
    folder : Path
        Folder from `character_cost.prepare`.
    character : dict
        Result of `character_cost.prepare`.
    points : list
        Result of `scaling.measured`.
    """
    report = character_cost.measure(folder, character, character_cost.TIMED_FRAMES, character_cost.PROCESSES)
    avx2 = in_process(folder, "yardstick", module=MODULE)
    character_cost.write_log(folder, islice(benchmark.performance(), SHORT))
    short = in_process(folder, "convert")
    character_cost.write_log(folder, islice(benchmark.performance(), LONG))

    text = benchmark.describe(report, character_cost.FIGURES, character_cost.RATIOS).splitlines()
    yield from (*text[:2], "", "| what | goal | measured | |", "| --- | --- | --- | --- |")
    yield from (goal.line() for goal in _goals(report, avx2, short["peak_mb"], points))
    yield from ("", "These are all values of the run:", "", "```text", *text[3:])
    if "avx2_ms" in avx2:
        yield f"{'avx2_ms':20}{number(avx2['avx2_ms']):>8} ms   positions and normals of a frame by a loop in C"
    else:
        yield f"no comparison with a loop in C: {avx2['missing']}"
    yield "```"


def _goals(
    report: dict[str, Any], avx2: dict[str, Any], short_mb: float | None, points: list[dict[str, Any]]
) -> list[Goal]:
    figures, ratios = report["figures"], report["ratios"]
    solve = [point["solve_ms"] for point in points]
    each = [point["vertices_ms"] / point["vertices"] for point in points]
    largest = points[-1]
    memory, peak = largest["precompute_peak_mb"], figures["peak_mb"]
    return [
        Goal("a frame, controls only", figures["solve_ms"], 0.15, "ms"),
        Goal("… the slowest of all sizes above the fastest", 100 * (max(solve) / min(solve) - 1), 15, "%"),
        Goal("positions and normals / the same by AVX2 in C", _quotient(avx2, "vertices_ms", "avx2_ms"), 2, "×"),
        Goal("… the most expensive vertex at any size / the cheapest (linear)", max(each) / min(each), 2, "×"),
        Goal("ARAP iteration / controls", ratios["arap_to_solve"], 100, "×", least=True),
        Goal("ARAP iteration / frame", ratios["arap_to_frame"], 25, "×", least=True),
        Goal(
            f"99th percentile / median, controls (a constant loop: {number(ratios['p99_to_constant'])})",
            ratios["p99_to_solve"],
            2,
            "×",
        ),
        Goal("99th percentile / median, frame", ratios["p99_to_frame"], 2, "×"),
        Goal("pre-computation, cold", figures["precompute_s"], 1, "s"),
        Goal(f"… of {largest['vertices']:,} vertices", largest["precompute_s"], 30, "s"),
        Goal(f"… of {largest['vertices']:,} vertices, peak memory", None if memory is None else memory / 1e3, 4, "GB"),
        Goal("second start from the cache, after imports", figures["cached_load_ms"], 50, "ms"),
        Goal("`puppetline --help`", figures["startup_ms"], 150, "ms"),
        Goal(f"convert, {LONG:,} frames, to .glb", figures["convert_s"], 2.5, "s"),
        Goal("… peak memory", peak, 500, "MB"),
        Goal(
            f"… peak memory / that of {SHORT} frames", None if not peak or not short_mb else peak / short_mb, 1.1, "×"
        ),
        Goal("memory of a running character", figures["character_mb"], 60, "MB"),
    ]


def _quotient(found: dict[str, Any], a: str, b: str) -> float | None:
    return found[a] / found[b] if a in found and b in found else None
