import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.fusion.clocks import MAX_GAP_SECONDS, clock_offsets, sampled


@pytest.mark.parametrize("clock", [0.0, 0.1234, -3.7, 1e6])
def test_a_clock_that_is_ahead_is_found_to_a_millisecond_whatever_the_pose(walk, virtual_sensor, here, behind, clock):
    first, other = virtual_sensor(here).record(walk), virtual_sensor(behind, clock).record(walk)
    (found, alike), *_ = clock_offsets(first, other, 3)
    assert found == pytest.approx(clock, abs=1e-3)
    assert alike > 0.99


def test_frames_between_those_of_the_first_are_found_by_the_parabola(walk, virtual_sensor, here, beside):
    first, other = virtual_sensor(here).record(walk), virtual_sensor(beside, 0.5).record(walk, phase=0.011)
    assert clock_offsets(first, other, 1)[0][0] == pytest.approx(0.5, abs=1e-3)


def test_a_part_of_a_motion_is_found_in_the_complete_motion(walk, virtual_sensor, here, beside):
    first, other = virtual_sensor(here).record(walk), virtual_sensor(beside, 2.0).record(walk)
    part = SkeletonClip("", 1, other.times[90:210], other.positions[90:210], other.confidence[90:210])
    assert clock_offsets(first, part, 1)[0][0] == pytest.approx(2.0, abs=5e-3)


def test_without_motion_there_is_no_clock_offset(walk):
    positions = np.repeat(walk.positions[:1], len(walk.times), axis=0)
    assert clock_offsets(walk, SkeletonClip("", 1, walk.times, positions, walk.confidence), 3) == []


def test_samples_are_interpolated_between_frames_but_not_across_gaps(walk):
    positions, confidence = sampled(walk, (walk.times[3:9] + walk.times[4:10]) / 2)
    np.testing.assert_allclose(positions, (walk.positions[3:9] + walk.positions[4:10]) / 2, atol=1e-12)
    assert (confidence == 1).all()
    exact, _ = sampled(walk, walk.times)
    np.testing.assert_allclose(exact, walk.positions, atol=1e-12)
    lost = walk.confidence.copy()
    lost[20 : 20 + int(MAX_GAP_SECONDS * 30) + 1, 5] = 0
    clip = SkeletonClip("", 1, walk.times, np.where(lost[..., None] > 0, walk.positions, np.nan), lost)
    positions, confidence = sampled(clip, walk.times[[21, 40]])
    assert np.isnan(positions[0, 5]).all()
    assert (confidence[0, 5], confidence[1, 5]) == (0, 1)
    assert np.isfinite(np.delete(positions, 5, axis=1)).all()


def test_outside_a_recording_all_joints_are_lost(walk):
    positions, confidence = sampled(walk, np.array([-1.0, walk.times[-1] + 0.1]))
    assert np.isnan(positions).all()
    assert not confidence.any()
