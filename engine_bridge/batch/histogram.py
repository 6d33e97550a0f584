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
    is_logarithmic = data.min() > 0 and data.max() / data.min() > LOGARITHMIC_RATIO
    counts, edges = np.histogram(np.log(data) if is_logarithmic else data, BIN_COUNT)
    ticks = np.linspace(edges[0], edges[-1], 5)
    if is_logarithmic:
        edges, ticks = np.exp(edges), np.exp(ticks)
    step, top = WIDTH / BIN_COUNT, HEIGHT - BOTTOM
    bars = "".join(
        f'<rect x="{index * step + 0.5:.1f}" y="{top - height:.1f}" width="{step - 1:.1f}" height="{height:.1f}">'
        f"<title>{count} from {start:.3g} to {end:.3g}</title></rect>"
        for index, (count, height, start, end) in enumerate(
            zip(counts.tolist(), counts / counts.max() * (top - 18), edges, edges[1:], strict=False)
        )
    )
    numbers = "".join(
        f'<text x="{WIDTH * index / 4:.0f}" y="{top + 14}" text-anchor="{anchor}">{tick:.3g}</text>'
        for index, (tick, anchor) in enumerate(zip(ticks, ("start", "middle", "middle", "middle", "end"), strict=True))
    )
    return (
        f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{label}">{bars}'
        f'<line x1="0" y1="{top}" x2="{WIDTH}" y2="{top}"/>{numbers}'
        f'<text x="0" y="11">highest bar: {int(counts.max()):,}</text>'
        f'<text x="{WIDTH / 2}" y="{HEIGHT - 5}" text-anchor="middle">{label}'
        f"{', logarithmic' if is_logarithmic else ''}</text></svg>"
    )
