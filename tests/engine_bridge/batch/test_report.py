import re
from xml.etree import ElementTree

import numpy as np
import pytest

from engine_bridge.batch.histogram import BIN_COUNT, histogram
from engine_bridge.batch.report import badness
from engine_bridge.batch.row import Row


def row(**values):
    return Row("done", "p/a.glb", "/a.log", "/p.toml", "own", 1, "morph", **values)


@pytest.mark.parametrize("is_logarithmic", [False, True])
def test_a_histogram_has_bars_in_proportion_to_counts(is_logarithmic):
    values = np.random.default_rng(1).uniform(1, 2, 500)
    if is_logarithmic:
        values = np.exp(5 * values)
    picture = ElementTree.fromstring(histogram(values, "duration"))
    bars = picture.findall("rect")
    counts = np.array([int(bar.find("title").text.split()[0]) for bar in bars])
    assert (len(bars), counts.sum()) == (BIN_COUNT, 500)
    heights = np.array([float(bar.get("height")) for bar in bars])
    np.testing.assert_allclose(heights / heights.max(), counts / counts.max(), atol=0.001)
    low, high = values.min(), values.max()
    middle = np.sqrt(low * high) if is_logarithmic else (low + high) / 2
    labels = [text.text for text in picture.findall("text")]
    assert labels[:5:2] == [f"{value:.3g}" for value in (low, middle, high)]
    assert labels[6] == "duration" + ", logarithmic" * is_logarithmic


def test_equal_values_are_one_bar():
    picture = ElementTree.fromstring(histogram([0.5] * 7, "error"))
    counts = [int(re.match(r"\d+", title.text)[0]) for title in picture.iter("title")]
    assert sorted(counts)[-2:] == [0, 7]


def test_the_worst_result_has_the_most_stretched_or_compressed_edges_and_then_the_largest_error():
    rows = [
        row(stretch_p1=0.2, stretch_p99=1.1, error=0.1),
        row(stretch_p1=0.9, stretch_p99=2.0, error=0.2),
        row(stretch_p1=0.9, stretch_p99=2.0, error=0.1),
        row(error=0.3),
    ]
    assert sorted(rows[2:] + rows[:2], key=badness, reverse=True) == rows
