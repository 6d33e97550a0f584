import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.events import TICK_SECONDS
from engine_bridge.performance.easing import MAX_STEP_SECONDS, Easing, TargetPose
from solver.motion.limbs import bones_of

BONES = bones_of(())
REST = TargetPose(np.zeros((2, 3)), np.zeros((0, 4, 3)), np.zeros(3))
THERE = TargetPose(np.array([[1.0, 0, 0], [0, 2.0, 0]]), np.zeros((0, 4, 3)), np.array([0, 0, 4.0]))


@pytest.fixture
def easing():
    """An easing of a second that has shown the rest pose and begins at 0."""
    made = Easing(BONES, REST, 1.0)
    made.show(0.0, REST)
    made.begin(0.0)
    return made


def test_without_an_easing_places_are_shown_as_they_are():
    easing = Easing(BONES, REST, 1.0)
    assert easing.show(5.0, THERE) is easing.shown is THERE
    assert easing.shown_at == 5.0
    assert easing.finished(5.0)
    easing.seconds = 0.0
    easing.begin(6.0)
    assert easing.show(6.0, REST) is REST


def smooth(t):
    return t * t * (3 - 2 * t)


def test_places_are_shown_a_smooth_share_of_the_way_and_all_of_it_in_the_end(easing):
    times = np.arange(0, 1.25, 0.05)
    shares = [easing.show(time, THERE).targets[0, 0] for time in times]
    assert_allclose(shares, smooth(np.minimum(times, 1)), atol=1e-12)
    assert easing.show(1.3, THERE) is THERE


def test_an_easing_in_the_middle_of_another_begins_where_that_one_is(easing):
    for time in np.arange(0.05, 0.51, 0.05):
        halfway = easing.show(time, THERE)
    assert_allclose(halfway.root, [0, 0, 2], atol=1e-12)
    easing.begin(0.5)
    assert_allclose(easing.show(0.5, REST).root, halfway.root, atol=1e-12)
    assert not easing.finished(1.4)
    assert easing.finished(1.5)


def test_a_pause_of_the_source_is_no_part_of_the_way(easing):
    easing.show(TICK_SECONDS, THERE)
    later = easing.show(60.0, THERE).targets[0, 0]
    assert later == pytest.approx(smooth(TICK_SECONDS + MAX_STEP_SECONDS))
