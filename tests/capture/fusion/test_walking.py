import numpy as np
import pytest

from capture.fusion.walking import MAX_WALK_METRES, SPEED_PERIOD_SECONDS, WALKING_METRES_PER_SECOND, Walk
from capture.skeleton import JOINT_INDEX, OPPOSITE

from ...recordings import tracked_frame
from .virtual_sensors import WALK

BODY = WALK.positions[0]
FORWARDS, SIDEWAYS, UP = np.array([0, 0, -1.0]), np.array([1.0, 0, 0]), np.array([0, 1.0, 0])


def walked(*velocities, seconds=1.0, body=BODY, pause=0.0):
    """Return the distance that a performer walks forwards who faces the sensor and moves evenly, at 30 Hz."""
    found, time, place = Walk(), 0.0, np.zeros(3)
    for velocity in velocities:
        for _ in range(round(30 * seconds)):
            found.follow(tracked_frame(time, body + place))
            time, place = time + 1 / 30, place + velocity / 30
        time += pause
    return found.forwards


def test_walked_distance_counts_up_to_a_limit():
    """31 frames are three strides of ten frames each."""
    assert walked(FORWARDS, seconds=31 / 30) == pytest.approx(1.0)
    assert walked(-FORWARDS, seconds=31 / 30) == pytest.approx(-1.0)
    assert walked(FORWARDS, seconds=31 / 30, body=BODY[OPPOSITE]) == pytest.approx(-1.0)
    assert walked(FORWARDS, seconds=5.0) == MAX_WALK_METRES
    assert walked(FORWARDS, -FORWARDS, seconds=5.0) == pytest.approx(MAX_WALK_METRES - 5 + 1 / 3, abs=0.2)


@pytest.mark.parametrize(
    "velocity", [SIDEWAYS, UP, -0.95 * WALKING_METRES_PER_SECOND * FORWARDS, SIDEWAYS - 0.9 * FORWARDS]
)
def test_stepping_sideways_jumping_and_stepping_back_slowly_do_not_count(velocity):
    assert walked(velocity, seconds=5.0) == 0


def test_a_gap_resets_the_distance_and_unknown_joints_do_not_count():
    assert walked(FORWARDS, 0 * FORWARDS, seconds=0.4, pause=3 * SPEED_PERIOD_SECONDS) == 0
    body = BODY.copy()
    body[JOINT_INDEX["hip_left"]] = np.nan
    assert walked(FORWARDS, body=body) == 0
