import numpy as np
import pytest

from capture.smoothing import FRAMES_PER_SECOND, Smoothing
from engine_bridge.studio.backend.smoothing_preview import preview, preview_of

UNSMOOTHED = Smoothing(alpha=1.0, gamma=0.0, jitter_radius=0.0, max_deviation=np.inf)


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


def swinging(noise):
    """Return times and positions of a joint that swings along y for three seconds."""
    times = np.arange(90) / FRAMES_PER_SECOND
    positions = np.zeros((90, 3))
    positions[:, 1] = 0.3 * np.sin(2 * np.pi * 0.8 * times)
    return times, positions + np.random.default_rng(1).normal(scale=noise, size=(90, 3))


def test_a_live_joint_without_smoothing_is_as_it_was_measured_with_the_noise_that_was_added():
    found = preview_of(UNSMOOTHED, *swinging(0.01))
    assert np.allclose(found.smoothed, found.measured, atol=1e-12)
    assert np.ptp(found.measured) > 0.5
    assert found.jitter_mm == found.measured_mm == pytest.approx(10.0, rel=0.15)
    assert found.lag_ms == pytest.approx(0.0, abs=1e-6)
    assert (found.rise_ms, found.overshoot_mm) == (None, None)


def test_a_strong_smoothing_lags_behind_a_live_joint_and_calms_it_and_one_at_rest_has_no_lag():
    strong = Smoothing(alpha=0.3, gamma=0.3, jitter_radius=1.0, max_deviation=1.0, prediction=0.0)
    found = preview_of(strong, *swinging(0.005))
    assert found.jitter_mm < 0.5 * found.measured_mm
    assert found.lag_ms > 30
    assert preview_of(strong, np.arange(30) / 30, np.zeros((30, 3))).lag_ms is None
