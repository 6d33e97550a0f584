from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.fusion.clocks import MAX_GAP_SECONDS, clock_offsets, sampled

from .virtual_sensors import BESIDE, HERE, WALK, VirtualSensor, part


def test_a_part_of_a_motion_is_found_in_the_complete_motion_and_without_motion_there_is_no_offset():
    other = part(VirtualSensor(BESIDE, 2.0).record(WALK), 90, 210)
    assert clock_offsets(VirtualSensor(HERE).record(WALK), other, 1)[0][0] == pytest.approx(2.0, abs=5e-3)
    still = np.repeat(WALK.positions[:1], len(WALK.times), axis=0)
    assert clock_offsets(WALK, replace(WALK, positions=still), 3) == []


def test_samples_are_interpolated_between_frames_but_not_across_gaps_or_outside_the_recording():
    times = WALK.times
    positions, confidence = sampled(WALK, (times[3:9] + times[4:10]) / 2)
    assert_allclose(positions, (WALK.positions[3:9] + WALK.positions[4:10]) / 2, atol=1e-12)
    assert (confidence == 1).all()
    assert_allclose(sampled(WALK, times)[0], WALK.positions, atol=1e-12)
    lost = WALK.confidence.copy()
    lost[20 : 20 + int(MAX_GAP_SECONDS * 30) + 1, 5] = 0
    clip = replace(WALK, positions=np.where(lost[..., None] > 0, WALK.positions, np.nan), confidence=lost)
    positions, confidence = sampled(clip, np.array([times[21], times[40], -1.0, times[-1] + 0.1]))
    known = np.ones((4, 20), bool)
    known[0, 5], known[2:] = False, False
    assert_array_equal(confidence, known)
    assert_array_equal(np.isfinite(positions), np.repeat(known[..., None], 3, axis=2))
