import math

import numpy as np
import pytest

from capture.skeleton import INFERRED, JOINT_INDEX, LOST, TRACKED
from capture.smoothing import JointFilter, Smoothing, _decay
from puppetline.errors import PuppetlineError

EQ_4_ONLY = {"jitter_radius": 0.0, "max_deviation": math.inf}
HEAD = JOINT_INDEX["head"]
ALL_TRACKED = np.full(20, TRACKED, dtype=np.float32)


def run(smoothing, times, positions, confidence=None):
    """Feed whole arrays (T,), (T, 20, 3), (T, 20) through a new filter."""
    joint_filter = JointFilter(smoothing)
    if confidence is None:
        confidence = np.ones(positions.shape[:2], dtype=np.float32)
    return np.array([joint_filter.step(*frame) for frame in zip(times, positions, confidence, strict=True)])


def random_walk(count, seed=0, step=0.03):
    return np.random.default_rng(seed).normal(scale=step, size=(count, 20, 3)).cumsum(axis=0)


def eq_4(p, beta, gamma, k=0.0):
    """Return the result of the paper's recursion, frame by frame."""
    smoothed, trend = p[1], p[1] - p[0]
    out = [p[0], smoothed + k * trend]
    for measurement in p[2:]:
        previous = smoothed
        smoothed = beta * measurement + (1 - beta) * (previous + trend)
        trend = gamma * (smoothed - previous) + (1 - gamma) * trend
        out.append(smoothed + k * trend)
    return np.array(out)


def kinect_sdk(raw, smoothing, correction, prediction, jitter, deviation, inferred):
    """Filter one joint (T, 3) with the SDK's loop, Eq. 4's first trend, and the jitter rule from frame two."""
    filtered, trend, out = raw[0], np.zeros(3), []
    for n, p in enumerate(raw):
        widen = 2.0 if inferred[n] else 1.0
        move = np.linalg.norm(p - filtered)
        if n > 0 and move <= widen * jitter:
            part = move / (widen * jitter)
            p = p * part + filtered * (1 - part)
        previous = filtered
        if n == 1:
            filtered, trend = p, p - previous
        elif n > 1:
            filtered = (1 - smoothing) * p + smoothing * (previous + trend)
            trend = correction * (filtered - previous) + (1 - correction) * trend
        ahead = filtered + prediction * trend
        off = np.linalg.norm(ahead - raw[n])
        if off > widen * deviation:
            ahead = raw[n] + (ahead - raw[n]) * (widen * deviation / off)
        out.append(ahead)
    return np.array(out)


@pytest.mark.parametrize("alpha", [0.05, 0.36, 0.5, 0.75, 1.0])
@pytest.mark.parametrize("gamma", [0.0, 1 / 9, 1 / 3, 0.5, 1.0])
def test_is_eq_4_at_30_hz(alpha, gamma):
    p = random_walk(200)
    out = run(Smoothing(alpha, gamma, prediction=1.5, **EQ_4_ONLY), np.arange(200) / 30, p)
    np.testing.assert_allclose(out, eq_4(p, alpha, gamma, k=1.5), rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    "sdk",
    [(0.5, 0.5, 0.5, 0.05, 0.04), (0.5, 0.1, 0.5, 0.1, 0.1), (0.7, 0.3, 1.0, 1.0, 1.0)],
    ids=["default", "smooth", "very smooth"],
)
def test_is_the_kinect_sdk_filter_at_30_hz_after_the_start(sdk):
    p = random_walk(150)
    inferred = np.random.default_rng(1).random((150, 20)) < 0.3
    smoothing, correction, prediction, jitter, deviation = sdk
    out = run(
        Smoothing(1 - smoothing, correction, jitter, deviation, prediction),
        np.arange(150) / 30,
        p,
        np.where(inferred, INFERRED, TRACKED).astype(np.float32),
    )
    for joint in range(20):
        expected = kinect_sdk(p[:, joint], *sdk, inferred[:, joint])
        np.testing.assert_allclose(out[:, joint], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("alpha", "gamma"), [(0.2, 0.9), (0.36, 1 / 9), (0.5, 0.5), (0.75, 1 / 3), (1.0, 0.4), (1.0, 1.0)]
)
def test_straight_motion_between_15_hz_frames_has_the_same_output_at_30_and_60_hz(alpha, gamma):
    corners = random_walk(60, step=0.1)
    smoothing = Smoothing(alpha, gamma, prediction=0.7, **EQ_4_ONLY)
    slow = run(smoothing, np.arange(60) / 15, corners)[1:]
    for times_faster in (2, 4, 7):
        between = np.arange(59 * times_faster + 1) / times_faster
        left = np.minimum(between.astype(int), 58)
        part = (between - left)[:, None, None]
        positions = (1 - part) * corners[left] + part * corners[left + 1]
        fast = run(smoothing, between / 15, positions)[times_faster::times_faster]
        np.testing.assert_allclose(fast, slow, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("alpha", "gamma"), [(0.75, 1 / 3), (0.75, 1 / 3 + 1e-9), (0.36, 1 / 9), (0.5, 0.5), (0.01, 1.0)]
)
def test_fractional_powers_multiply_to_integer_powers(alpha, gamma):
    """Equal, nearly equal, real and complex eigenvalues."""
    step = np.array([[1 - alpha, 1 - alpha], [-gamma * alpha, 1 - gamma * alpha]])
    np.testing.assert_allclose(_decay(alpha, gamma, 1.0), step, rtol=0, atol=1e-15)
    for n in (2, 3, 20):
        root = _decay(alpha, gamma, 1 / n)
        np.testing.assert_allclose(np.linalg.matrix_power(root, n), step, rtol=0, atol=1e-13)
        whole = np.linalg.matrix_power(step, n)
        np.testing.assert_allclose(_decay(alpha, gamma, float(n)), whole, rtol=0, atol=1e-13)


def test_constant_velocity_is_followed_without_lag_whatever_came_before():
    times = np.cumsum(np.random.default_rng(2).uniform(0.01, 0.1, 400))
    line = np.array([0.4, -0.3, 0.9]) * times[:, None, None] + np.zeros((400, 20, 3))
    line[:20] += random_walk(20, step=0.2)
    smoothing = Smoothing(0.3, 0.4, **EQ_4_ONLY)
    np.testing.assert_allclose(run(smoothing, times, line)[-50:], line[-50:], rtol=0, atol=1e-12)


@pytest.mark.parametrize("nan", [True, False], ids=["NaN", "confidence 0"])
def test_a_lost_joint_holds_its_last_output_and_starts_afresh(nan):
    p, confidence, times = random_walk(30), np.ones((30, 20), dtype=np.float32), np.arange(30) / 30
    lost = slice(10, 17)
    if nan:
        p[lost, HEAD] = np.nan
    else:
        p[lost, HEAD] = 7.0
        confidence[lost, HEAD] = LOST
    smoothing = Smoothing(prediction=1.0)
    out = run(smoothing, times, p, confidence)
    np.testing.assert_array_equal(out[lost, HEAD], np.broadcast_to(out[9, HEAD], (7, 3)))
    fresh = run(smoothing, times[17:], p[17:])
    np.testing.assert_array_equal(out[17:, HEAD], fresh[:, HEAD])
    others = np.arange(20) != HEAD
    np.testing.assert_array_equal(out[:, others], run(smoothing, times, random_walk(30))[:, others])


def test_a_joint_is_nan_only_until_it_is_first_seen():
    p = random_walk(6)
    p[:3, HEAD] = np.nan
    p[4, HEAD] = np.nan
    out = run(Smoothing(), np.arange(6) / 30, p)
    expected = np.zeros((6, 20), dtype=bool)
    expected[:3, HEAD] = True
    np.testing.assert_array_equal(np.isnan(out).any(axis=2), expected)


def test_reset_forgets_everything_even_the_time():
    p, joint_filter = random_walk(10), JointFilter(Smoothing())
    for k in range(10):
        joint_filter.step(100.0 + k / 30, p[k], ALL_TRACKED)
    joint_filter.reset()
    again = np.array([joint_filter.step(k / 30, p[k], ALL_TRACKED) for k in range(10)])
    np.testing.assert_array_equal(again, run(Smoothing(), np.arange(10) / 30, p))


def test_results_are_copies():
    joint_filter = JointFilter(Smoothing())
    first = joint_filter.step(0.0, np.zeros((20, 3)), ALL_TRACKED)
    first += 5.0
    held = joint_filter.step(0.1, np.zeros((20, 3)), np.zeros(20, dtype=np.float32))
    np.testing.assert_array_equal(held, np.zeros((20, 3)))


def test_moving_and_turning_the_sensor_moves_and_turns_the_output():
    p, times = random_walk(60), np.arange(60) / 25
    turn, _ = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))
    shift = np.array([0.3, -1.0, 2.0])
    smoothing = Smoothing(prediction=0.5, max_deviation=0.04)
    out = run(smoothing, times, p @ turn.T + shift)
    np.testing.assert_allclose(out, run(smoothing, times, p) @ turn.T + shift, rtol=0, atol=1e-12)


def test_time_that_does_not_increase_is_refused():
    joint_filter = JointFilter(Smoothing())
    joint_filter.step(1.0, np.zeros((20, 3)), ALL_TRACKED)
    with pytest.raises(ValueError, match=r"frame at 1\.0 s after one at 1\.0 s"):
        joint_filter.step(1.0, np.zeros((20, 3)), ALL_TRACKED)


@pytest.mark.parametrize(
    "wrong",
    [
        {"alpha": 0.0},
        {"alpha": 1.1},
        {"gamma": -0.1},
        {"gamma": math.nan},
        {"jitter_radius": math.inf},
        {"max_deviation": 0.0},
        {"prediction": -1.0},
    ],
)
def test_a_value_out_of_range_is_named(wrong):
    ((name, value),) = wrong.items()
    with pytest.raises(PuppetlineError) as caught:
        Smoothing(**wrong)
    assert caught.value.where == f"smoothing, {name}"
    assert caught.value.found == str(value)
