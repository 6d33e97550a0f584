import numpy as np
import pytest

from capture.fusion.walking import MAX_WALK_METRES, SPEED_PERIOD_SECONDS, WALKING_METRES_PER_SECOND, Walk
from capture.skeleton import JOINT_INDEX, OPPOSITE, SkeletonFrame

SURE = np.ones(20, dtype=np.float32)
FORWARDS, SIDEWAYS, UP = np.array([0, 0, -1.0]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0])


@pytest.fixture
def walked(walk):
    """Follow a performer who faces the sensor and moves evenly, at 30 Hz; return the distance walked forwards."""

    def follow(*velocities, seconds=1.0, body=None, pause=0.0):
        found, time, place = Walk(), 0.0, np.zeros(3)
        for velocity in velocities:
            for _ in range(round(30 * seconds)):
                found.follow(SkeletonFrame(time, 1, (walk.positions[0] if body is None else body) + place, SURE))
                time, place = time + 1 / 30, place + velocity / 30
            time += pause
        return found.forwards

    return follow


def test_walked_distance_counts(walked):
    """31 frames are three strides of ten frames each."""
    assert walked(FORWARDS, seconds=31 / 30) == pytest.approx(1.0)
    assert walked(-FORWARDS, seconds=31 / 30) == pytest.approx(-1.0)
    assert walked(FORWARDS, -FORWARDS, seconds=5.0) == pytest.approx(MAX_WALK_METRES - 5 + 1 / 3, abs=0.2)


def test_exchanging_the_sides_exchanges_the_ways(walked, walk):
    assert walked(FORWARDS, body=walk.positions[0][OPPOSITE]) == pytest.approx(-walked(FORWARDS), rel=1e-9)


@pytest.mark.parametrize(
    "velocity", [SIDEWAYS, UP, -0.95 * WALKING_METRES_PER_SECOND * FORWARDS, SIDEWAYS - 0.9 * FORWARDS]
)
def test_stepping_sideways_jumping_and_stepping_back_slowly_do_not_count(walked, velocity):
    assert walked(velocity, seconds=5.0) == 0


def test_the_distance_is_limited(walked):
    assert walked(FORWARDS, seconds=5.0) == MAX_WALK_METRES


def test_a_gap_resets_the_distance_and_unknown_joints_do_not_count(walked, walk):
    assert walked(FORWARDS, 0 * FORWARDS, seconds=0.4, pause=3 * SPEED_PERIOD_SECONDS) == 0
    body = walk.positions[0].copy()
    body[JOINT_INDEX["hip_left"]] = np.nan
    assert walked(FORWARDS, body=body) == 0
