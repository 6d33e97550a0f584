import numpy as np
import pytest

from capture.smoothing import Smoothing
from engine_bridge.studio.smoothing_preview import preview


@pytest.mark.parametrize(
    ("smoothing", "rise", "overshoot", "lag", "noise"),
    [
        (Smoothing(0.5, 0.5, 0.05, 0.04, 0.5), 33, 40, -9, 1.82),
        (Smoothing(0.5, 0.1, 0.1, 0.1, 0.5), 67, 44, 8, 1.11),
        (Smoothing(0.3, 0.3, 1.0, 1.0, 1.0), 367, 59, 116, 0.50),
        (Smoothing(), 0, 20, 7, 1.76),
    ],
    ids=["default", "smooth", "very smooth", "Puppetline"],
)
def test_the_numbers_are_those_of_the_documentation(smoothing, rise, overshoot, lag, noise):
    """Compare with the table of docs/smoothing.md, whose noise is averaged over more frames: some of it is slow."""
    found = preview(smoothing)
    assert round(found.rise_ms) == rise
    assert round(found.overshoot_mm) == overshoot
    assert round(found.lag_ms) == lag
    assert found.jitter_mm == pytest.approx(noise, rel=0.25 if lag > 100 else 0.05)


def test_without_smoothing_the_curve_is_what_was_measured():
    found = preview(Smoothing(alpha=1.0, gamma=0.0, jitter_radius=0.0, max_deviation=np.inf))
    assert np.allclose(found.smoothed, found.measured, atol=1e-12)
    assert len(found.times) == len(found.measured) == 75
    assert found.jitter_mm == pytest.approx(5.0, rel=0.02)
    assert found.lag_ms == pytest.approx(0.0, abs=1e-9)
