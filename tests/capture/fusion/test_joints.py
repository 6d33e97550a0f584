import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.fusion.joints import DECAY_SECONDS, MAX_AGE_SECONDS, Observation, fuse, is_swapped
from capture.skeleton import JOINT_INDEX, OPPOSITE, SkeletonFrame

from .virtual_sensors import WALK

HAND = JOINT_INDEX["hand_left"]
SURE = np.ones(20, dtype=np.float32)
WEIGHT = np.exp(-0.03 / DECAY_SECONDS)


def observation(time, x=0.0, speed=0.0, confidence=1.0):
    positions, velocities = np.full((20, 3), float(x)), np.full((20, 3), float(speed))
    return Observation(time, positions, velocities, np.full(20, confidence, dtype=np.float32))


@pytest.mark.parametrize(
    ("observations", "expected"),
    [
        ([(1.0, 0.3)], 0.3),
        ([(1.0, 0.0), (1.0, 0.08)], 0.04),
        ([(1.0, 0.0), (1.0, 1.7, 0.0, 0.5)], 0.1),  # an inferred joint has a sixteenth of the weight
        ([(1.0, 0.0), (0.97, 0.08)], 0.08 * WEIGHT / (1 + WEIGHT)),
        ([(1.0, 0.5), (0.97, 0.44, 2.0), (1.02, 0.54, 2.0)], 0.5),  # motion is extrapolated
        ([(1.0, 0.4), (1.0 - MAX_AGE_SECONDS - 0.01, 9.0)], 0.4),
    ],
)
def test_observations_are_averaged_by_confidence_and_age(observations, expected):
    positions, confidence = fuse([observation(*each) for each in observations], 1.0)
    assert_allclose(positions, expected)
    assert (confidence == 1).all()


def frame(time, positions, confidence=SURE):
    return SkeletonFrame(time, 1, np.broadcast_to(positions, (20, 3)), confidence)


def test_velocities_are_of_joints_known_twice_within_a_short_time_and_not_too_fast():
    sure, places = SURE.copy(), np.zeros((20, 3))
    sure[HAND] = 0
    before = Observation.after(None, frame(1.0, 0.0, sure))
    known = np.arange(20)[:, None] != HAND
    assert_allclose(Observation.after(before, frame(1.1, 0.5)).velocities, np.where(known, [5.0] * 3, 0))
    assert not Observation.after(before, frame(1.0 + 2 * MAX_AGE_SECONDS, 1.0)).velocities.any()
    places[HAND, 0], places[0, 0] = 0.34, 0.32  # in a thirtieth of a second: 10.2 and 9.6 m/s
    velocities = Observation.after(Observation.after(None, frame(1.0, 0.0)), frame(1 + 1 / 30, places)).velocities
    assert_allclose(velocities[:, 0], np.where(np.arange(20) == 0, 9.6, 0))


def fused_hand(*hands, before=None):
    """Return the hand of performers at the origin whose left hands are at x with a confidence, 1 by default."""
    observations = []
    for hand in (*hands, before):
        x, confidence = hand if isinstance(hand, tuple) else (hand, 1.0)
        observations.append(seen := observation(1.0))
        seen.positions[HAND, 0], seen.confidence[HAND] = x, confidence
    *observations, last = observations
    positions, confidence = fuse(observations, 1.0, None if before is None else last.positions)
    assert_array_equal(np.delete(positions, HAND, axis=0), 0)
    assert (np.delete(confidence, HAND) == 1).all()
    return positions[HAND, 0], confidence[HAND]


GUESS, LOST = (0.34, 0.5), (np.nan, 0.0)


@pytest.mark.parametrize(
    ("hands", "before", "expected"),
    [
        *(
            (hands, before, 0.01)
            for hands in ([0.42, 0, 0.02], [0, 0.42, 0.02], [0, 0.02, 0.42])
            for before in (None, 0.42)
        ),
        *((hands, before, x) for hands in ([0, 0.4], [0.4, 0]) for before, x in ((0.05, 0), (0.35, 0.4))),
        ([0, GUESS], 0.34, 0.02),  # a tracked joint prevails
        ([(0, 0.5), GUESS], 0.34, (0.17, 0.5)),  # all inferred positions count
        ([0, 0.149], 0, 0.0745),  # up to fifteen centimetres, they are of one mind
        ([0, 0.151], 0, 0),
        ([LOST, 0.4], 0, 0.4),
        ([LOST, 0.4, 0.5], None, 0.45),
        ([LOST, (0.4, 0.5)], None, (0.4, 0.5)),
        ([LOST], None, LOST),
    ],
)
def test_of_positions_apart_those_count_that_most_or_the_previous_one_confirm(hands, before, expected):
    expected = expected if isinstance(expected, tuple) else (expected, 1)
    assert fused_hand(*hands, before=before) == pytest.approx(expected, nan_ok=True)


@pytest.mark.parametrize("number", [0, 100, 200])
def test_swapped_sides_are_detected(number):
    body = WALK.positions[number]
    assert not is_swapped(body + 0.02, SURE, body, SURE)
    assert is_swapped(body[OPPOSITE] + 0.02, SURE, body, SURE)
    half = SURE.copy()
    half[np.arange(20) < OPPOSITE] = 0  # only one side is known, and it is where the other one is
    assert is_swapped(body[OPPOSITE], half, body, SURE)
    assert not is_swapped(body, SURE * 0, body, SURE)
