"""Histograms as SVG."""

from collections.abc import Sequence

import numpy as np

BIN_COUNT = 30
"""Number of bars."""

WIDTH, HEIGHT, BOTTOM = 420, 170, 36
"""Size of a histogram and height of the axis below it, in pixels."""

LOGARITHMIC_RATIO = 30.0
"""Ratio of the largest to the smallest value above which the axis is logarithmic."""


def histogram(values: Sequence[float], label: str) -> str:
    """Return a histogram as an SVG element.

    Parameters
    ----------
    values : sequence of float
        At least one.
    label : str
        Name of the axis, as plain text without "<" and "&".
    """
    data = np.asarray(values, dtype=np.float64)
    low, high = float(data.min()), float(data.max())
    is_logarithmic = low > 0 and high / low > LOGARITHMIC_RATIO
    scale = np.log if is_logarithmic else np.asarray
    counts, edges = np.histogram(scale(data), BIN_COUNT)
    ticks = np.linspace(edges[0], edges[-1], 5)
    step, top = WIDTH / BIN_COUNT, HEIGHT - BOTTOM
    bars = "".join(
        f'<rect x="{index * step + 0.5:.1f}" y="{top - height:.1f}" width="{step - 1:.1f}" height="{height:.1f}">'
        f"<title>{count} from {_number(_value(start, is_logarithmic))} to "
        f"{_number(_value(end, is_logarithmic))}</title></rect>"
        for index, (count, height, start, end) in enumerate(
            zip(counts.tolist(), counts / counts.max() * (top - 18), edges, edges[1:], strict=False)
        )
    )
    numbers = "".join(
        f'<text x="{WIDTH * index / 4:.0f}" y="{top + 14}" text-anchor="{anchor}">'
        f"{_number(_value(tick, is_logarithmic))}</text>"
        for index, (tick, anchor) in enumerate(zip(ticks, ("start", "middle", "middle", "middle", "end"), strict=True))
    )
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">{bars}'
        f'<line x1="0" y1="{top}" x2="{WIDTH}" y2="{top}"/>{numbers}'
        f'<text x="0" y="11">highest bar: {int(counts.max()):,}</text>'
        f'<text x="{WIDTH / 2}" y="{HEIGHT - 5}" text-anchor="middle">{label}'
        f"{', logarithmic' if is_logarithmic else ''}</text></svg>"
    )


def _value(position: float, is_logarithmic: bool) -> float:
    return float(np.exp(position)) if is_logarithmic else float(position)


def _number(value: float) -> str:
    return f"{value:.3g}"
