"""The plots of docs/performance.md."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

BLUE, ORANGE, GREEN, GREY = "#1f6fb4", "#d95f0e", "#238b57", "#6b7280"

STYLE = {
    "figure.facecolor": "white",  # readable on dark pages too
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.titlesize": 11,
    "axes.titlelocation": "left",
    "axes.titlepad": 12,
    "axes.labelcolor": "#374151",
    "axes.grid": True,
    "axes.grid.axis": "y",
    "grid.color": "#e5e7eb",
    "xtick.color": "#374151",
    "ytick.color": "#374151",
    "font.family": "DejaVu Sans",
    "font.size": 9.5,
    "lines.linewidth": 1.8,
    "lines.markersize": 4,
    "svg.hashsalt": "puppetline",
}

Points = Sequence[dict[str, Any]]


def cost(points: Points, path: Path) -> None:
    """Draw time per frame, and time and memory of the pre-computation, against vertices."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.5, 3.9), layout="constrained")
        frame, seconds, memory = figure.subplots(1, 3, width_ratios=(1.5, 1, 1))
        frame.axhline(1000 / 60, color=GREY, linewidth=1, linestyle=(0, (4, 3)))
        frame.text(points[0]["vertices"], 1000 / 60 * 1.15, "60 Hz", color=GREY, fontsize=8.5)
        for name, color, label in (
            ("arap_iteration_ms", ORANGE, "full ARAP,\none iteration"),
            ("vertices_ms", BLUE, "positions\nand normals"),
            ("solve_ms", GREEN, "controls"),
        ):
            _line(frame, points, name, color, label)
        _finish(frame, "A frame, ms")
        _line(seconds, points, "precompute_s", BLUE)
        _finish(seconds, "Pre-computation, s")
        _line(memory, points, "precompute_peak_mb", BLUE)
        _finish(memory, "Its peak memory, MB")
        memory.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        _save(figure, path)


def scaling(points: Points, path: Path) -> None:
    """Draw time and memory of the preparation of a character from its file, with both kinds of fields."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8, 3.9), layout="constrained")
        seconds, memory = figure.subplots(1, 2)
        for axes, name in ((seconds, "cold_s"), (memory, "cold_peak_mb")):
            _line(axes, points, f"exact_{name}", ORANGE, "exact")
            _line(axes, points, name, BLUE, "sampled")
        _finish(seconds, "From the file to the model, s")
        _finish(memory, "Peak memory, MB")
        for axes in (seconds, memory):
            axes.set(xticks=(2e3, 1e4, 1e5, 1e6, 1e7))
            axes.minorticks_off()
        _save(figure, path)


def convergence(found: dict[str, Any], path: Path) -> None:
    """Draw the distance to the converged result against iterations per frame."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7, 4), layout="constrained")
        axes = figure.subplots()
        iterations = found["iterations"]
        for measure, style, label in (("max", "-", "largest"), ("p99", "--", "99th percentile")):
            axes.plot(iterations, found[measure], style, color=BLUE, marker="o", label=label)
        axes.axvline(4, color=GREY, linewidth=1, linestyle=(0, (1, 2)))
        axes.text(4.1, axes.get_ylim()[1], "default", color=GREY, fontsize=8.5, va="top")
        axes.legend(frameon=False)
        axes.set(xscale="log", yscale="log", xlabel="iterations per frame", xticks=iterations)
        axes.set_title("Distance from the converged result, % of the diagonal")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        axes.minorticks_off()
        _save(figure, path)


def _line(axes: Axes, points: Points, name: str, color: str, label: str = "") -> None:
    known = [(point["vertices"], point[name]) for point in points if point.get(name) is not None]
    if not known:
        return
    x, y = zip(*known, strict=True)
    axes.plot(x, y, color=color, marker="o")
    place: dict[str, Any] = {"xytext": (7, 0), "textcoords": "offset points", "va": "center"}
    axes.annotate(label, (x[-1], y[-1]), **place, color=color, fontsize=9, backgroundcolor="white")


def _finish(axes: Axes, title: str) -> None:
    axes.set(xscale="log", yscale="log", xlabel="vertices", xticks=(2e3, 1e4, 1e5, 1e6))
    axes.set_title(title)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _short(value)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.minorticks_off()


def _short(value: float) -> str:
    return f"{value / 1e6:g} M" if value >= 1e6 else f"{value / 1e3:g} k"


def _save(figure: Figure, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Date": None})
