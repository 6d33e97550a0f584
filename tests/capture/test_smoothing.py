import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.skeleton import INFERRED, JOINT_INDEX, LOST, TRACKED
from capture.smoothing import JointFilter, Smoothing
from puppetline.errors import PuppetlineError

EQ_4_ONLY = {"jitter_radius": 0.0, "max_deviation": math.inf}
HEAD = JOINT_INDEX["head"]
ALL_TRACKED = np.full(20, TRACKED, dtype=np.float32)


def run(smoothing, times, positions, confidence=None, joint_filter=None):
    """Feed whole arrays (T,), (T, 20, 3), (T, 20) through a filter, a new one by default."""
    joint_filter = joint_filter or JointFilter(smoothing)
    if confidence is None:
        confidence = np.ones(positions.shape[:2], dtype=np.float32)
    return np.array([joint_filter.step(*frame) for frame in zip(times, positions, confidence, strict=True)])


def random_walk(count, seed=0, step=0.03):
    return np.random.default_rng(seed).normal(scale=step, size=(count, 20, 3)).cumsum(axis=0)


def kinect_sdk(raw, smoothing, correction, prediction, jitter, deviation, inferred):
    """Filter one joint (T, 3) with the SDK's loop, the first trend of the paper's Eq. 4, and jitter from frame two.

    Without jitter and deviation, it is Eq. 4.
    """
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


EQ_4 = [(1 - alpha, gamma, 1.5, 0, math.inf) for alpha in (0.05, 0.36, 1) for gamma in (0, 1 / 9, 0.5, 1)]
DEFAULT, SMOOTH, VERY_SMOOTH = (0.5, 0.5, 0.5, 0.05, 0.04), (0.5, 0.1, 0.5, 0.1, 0.1), (0.7, 0.3, 1.0, 1.0, 1.0)


@pytest.mark.parametrize("sdk", [DEFAULT, SMOOTH, VERY_SMOOTH, (0.25, 1 / 3, 1.5, 0, math.inf), *EQ_4])
def test_is_the_kinect_sdk_filter_at_30_hz_after_the_start(sdk):
    p = random_walk(150)
    inferred = np.random.default_rng(1).random((150, 20)) < 0.3
    smoothing, correction, prediction, jitter, deviation = sdk
    confidence = np.where(inferred, INFERRED, TRACKED).astype(np.float32)
    smoothing = Smoothing(1 - smoothing, correction, jitter, deviation, prediction)
    out = run(smoothing, np.arange(150) / 30, p, confidence)
    for joint in range(20):
        expected = kinect_sdk(p[:, joint], *sdk, inferred[:, joint])
        assert_allclose(out[:, joint], expected, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("alpha", "gamma"),
    [(0.2, 0.9), (0.36, 1 / 9), (0.5, 0.5), (0.75, 1 / 3), (0.75, 1 / 3 + 1e-9), (0.01, 1.0), (1.0, 0.4), (1.0, 1.0)],
)
def test_straight_motion_between_15_hz_frames_has_the_same_output_at_30_and_60_hz(alpha, gamma):
    """The recursion's eigenvalues are equal, nearly equal, real or complex."""
    corners = random_walk(60, step=0.1)
    smoothing = Smoothing(alpha, gamma, prediction=0.7, **EQ_4_ONLY)
    slow = run(smoothing, np.arange(60) / 15, corners)[1:]
    for times_faster in (2, 4, 7):
        between = np.arange(59 * times_faster + 1) / times_faster
        left = np.minimum(between.astype(int), 58)
        part = (between - left)[:, None, None]
        positions = (1 - part) * corners[left] + part * corners[left + 1]
        fast = run(smoothing, between / 15, positions)[times_faster::times_faster]
        assert_allclose(fast, slow, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("position", "confidence"), [(np.nan, TRACKED), (7.0, LOST)])
def test_a_lost_joint_holds_its_last_output_and_starts_afresh(position, confidence):
    p, sure, times = random_walk(30), np.ones((30, 20), dtype=np.float32), np.arange(30) / 30
    lost, smoothing = slice(10, 17), Smoothing(prediction=1.0)
    expected = run(smoothing, times, p)
    p[lost, HEAD], sure[lost, HEAD] = position, confidence
    expected[lost, HEAD] = expected[9, HEAD]
    expected[17:, HEAD] = run(smoothing, times[17:], p[17:])[:, HEAD]
    assert_array_equal(run(smoothing, times, p, sure), expected)
    p[:3, HEAD] = np.nan  # until it is first seen
    assert np.argwhere(np.isnan(run(smoothing, times, p, sure)[..., 0])).tolist() == [[k, HEAD] for k in range(3)]


def test_reset_forgets_everything_even_the_time_and_results_are_copies():
    p, joint_filter = random_walk(10), JointFilter(Smoothing())
    run(None, 100 + np.arange(10) / 30, p, joint_filter=joint_filter)
    joint_filter.reset()
    again = run(None, np.arange(10) / 30, p, joint_filter=joint_filter)
    assert_array_equal(again, run(Smoothing(), np.arange(10) / 30, p))
    last = joint_filter.step(1.0, p[0], 0 * ALL_TRACKED)
    last += 5.0
    assert_array_equal(joint_filter.step(2.0, p[0], 0 * ALL_TRACKED), again[-1])


def test_time_that_does_not_increase_is_refused():
    joint_filter = JointFilter(Smoothing())
    joint_filter.step(1.0, np.zeros((20, 3)), ALL_TRACKED)
    with pytest.raises(ValueError, match=r"."):
        joint_filter.step(1.0, np.zeros((20, 3)), ALL_TRACKED)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("alpha", 0.0), ("alpha", 1.1), ("gamma", -0.1), ("gamma", math.nan), ("jitter_radius", math.inf)),
        *(("max_deviation", 0.0), ("prediction", -1.0)),
    ],
)
def test_a_value_out_of_range_is_named(name, value):
    with pytest.raises(PuppetlineError) as caught:
        Smoothing(**{name: value})
    assert caught.value.where == f"smoothing, {name}"
