import numpy as np
import pytest
from numpy.testing import assert_allclose

from capture.clip import SkeletonClip
from capture.cuts import cut_frames
from capture.skeleton import JOINT_INDEX, LIMBS, OPPOSITE
from capture.timeline import resample

from .bodies import STANDS

BODY = STANDS + np.array([0, 1, 2.5])
SEEN = np.ones((60, 20), np.float32)


def walk(fps, speed):
    """Return times and positions of a body that is carried along x."""
    times = np.arange(60) / fps
    return times, BODY + speed * times[:, None, None] * [1, 0, 0]


@pytest.mark.parametrize("fps", [10, 30, 120])
def test_a_sprinter_is_no_cut_and_a_displacement_is_one_at_any_rate(fps):
    times, positions = walk(fps, 11.0)
    assert not len(cut_frames(times, positions, SEEN)[1])
    positions[40:] += [0, 0, 2.9]
    assert [each.tolist() for each in cut_frames(times, positions, SEEN)] == [[39], [40]]


def test_errors_of_single_limbs_and_exchanged_sides_are_no_cuts():
    times, positions = walk(30, 1.0)
    for k, limb in enumerate(LIMBS.values()):
        positions[10 * k, [JOINT_INDEX[joint] for joint in limb]] += [0, 2, 0]
    positions[55] = positions[55, OPPOSITE]
    assert not len(cut_frames(times, positions, SEEN)[1])


def test_a_performer_who_is_back_elsewhere_after_a_gap_is_a_cut():
    times, positions = walk(30, 0.0)
    confidence = SEEN.copy()
    confidence[20:50], positions[20:50] = 0, np.nan
    for away, cuts in ((0.8, [[], []]), (2.0, [[19], [50]])):
        positions[50:] = BODY + np.array([away, 0, 0])
        assert [each.tolist() for each in cut_frames(times, positions, confidence)] == cuts


@pytest.mark.parametrize("fps", [24, 30, 50, 97])
def test_no_frame_of_a_timeline_is_between_the_two_sides_of_a_cut(fps):
    times, positions = walk(25, 0.5)
    positions[30:] += [3, 0, 0]
    turns = np.tile([1.0, 0, 0, 0], (60, 20, 1))
    clip = SkeletonClip("test", 0, times, positions, SEEN, orientations=turns)
    timeline = resample(clip, fps)
    carried = timeline.positions - BODY
    after = timeline.times >= times[30] - 1e-6
    expected = np.where(after, 3 + 0.5 * timeline.times, np.minimum(0.5 * timeline.times, 0.5 * times[29]))
    assert_allclose(carried[..., 0], expected[:, None].repeat(20, 1), atol=1e-5)
    assert (timeline.confidence == 1).all()
    assert np.isfinite(timeline.orientations).all()
    assert timeline.gaps == ()


@pytest.mark.parametrize("frames", [[], [29]])
@pytest.mark.parametrize("lost", [1, 5, 12])
def test_joints_and_frames_that_are_lost_before_or_after_a_cut_are_on_one_side_of_it(frames, lost):
    head, hand, foot = (JOINT_INDEX[name] for name in ("head", "hand_left", "foot_left"))
    gaps = {head: slice(30 - lost, 30), hand: slice(30, 30 + lost), foot: slice(0)}
    times, positions = walk(30, 0.0)
    positions[30:] += [3, 0, 0]
    confidence = SEEN.copy()
    confidence[frames] = 0
    for joint, gap in gaps.items():
        confidence[gap, joint] = 0
    positions[confidence == 0] = np.nan
    timeline = resample(SkeletonClip("test", 0, times, positions, confidence), 97)
    carried = (timeline.positions - BODY)[..., 0]
    for joint, gap in gaps.items():
        begin = times[gap.stop if gap.start == 30 else 30] - 1e-6
        assert_allclose(carried[:, joint], np.where(timeline.times < begin, 0, 3), atol=1e-9)
    after, back = (times[frame] - 1e-6 for frame in (30, 30 + lost))
    assert not timeline.confidence[(timeline.times >= after) & (timeline.times < back), hand].any()
