import numpy as np
import pytest

from capture.clip import SkeletonClip
from capture.formats import msrc12
from capture.formats.options import ReadOptions
from capture.skeleton import JOINT_INDEX
from capture.timeline import MAX_FRAMES, choose, resample
from puppetline.errors import SkeletonLogError

HEAD, SPINE = JOINT_INDEX["head"], JOINT_INDEX["spine"]


def clip(times, x, confidence=1.0, user=0):
    """Return a clip with every joint at (x, 10 x, joint number); confidence 0 makes NaN."""
    times = np.asarray(times, dtype=float)
    x = np.broadcast_to(np.asarray(x, dtype=float).reshape(len(times), -1), (len(times), 20))
    positions = np.stack([x, 10 * x, np.broadcast_to(np.arange(20.0), x.shape)], axis=2)
    confidence = np.broadcast_to(np.asarray(confidence, dtype=np.float32), x.shape).copy()
    positions[confidence == 0] = np.nan
    return SkeletonClip("test", user, times, positions, confidence)


def random_clip(times, seed=0):
    positions = np.random.default_rng(seed).normal(size=(len(times), 20, 3))
    return SkeletonClip("test", 0, np.asarray(times), positions, np.ones((len(times), 20), dtype=np.float32))


@pytest.mark.parametrize("start", [0.0, 17.3, 1.7e9])
def test_a_clip_on_the_clock_is_unchanged(start):
    recorded = random_clip(start + np.arange(500) / 30)
    timeline = resample(recorded, 30.0)
    np.testing.assert_array_equal(timeline.positions, recorded.positions)
    np.testing.assert_array_equal(timeline.confidence, recorded.confidence)
    np.testing.assert_allclose(timeline.times, recorded.times - start, rtol=0, atol=1e-6)
    assert timeline.gaps == ()
    assert timeline.held == 0
    assert timeline.summary() == "500 frames at 30 per second"


def test_interpolates_linearly_with_the_lower_confidence():
    """Samples at 0, 0.1 and 0.2 s, clock of 25 Hz: 0, 0.04, 0.08, 0.12, 0.16, 0.2 s."""
    confidence = np.ones((3, 20), dtype=np.float32)
    confidence[2, HEAD] = 0.5
    timeline = resample(clip([5.0, 5.1, 5.2], [0.0, 1.0, 3.0], confidence), fps=25.0)
    x = [0.0, 0.4, 0.8, 1.4, 2.2, 3.0]
    np.testing.assert_allclose(timeline.positions[:, SPINE, 0], x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(timeline.positions[:, SPINE, 1], 10 * np.array(x), rtol=0, atol=1e-11)
    np.testing.assert_array_equal(timeline.confidence[:, SPINE], [1, 1, 1, 1, 1, 1])
    np.testing.assert_array_equal(timeline.confidence[:, HEAD], [1, 1, 1, 0.5, 0.5, 0.5])


def test_a_straight_motion_at_irregular_times_keeps_its_speed():
    times = np.cumsum(np.random.default_rng(2).uniform(0.005, 0.24, 300))
    timeline = resample(clip(times, 2.0 * times), fps=60.0)
    np.testing.assert_allclose(timeline.positions[:, 0, 0], 2.0 * (timeline.times + times[0]), rtol=0, atol=1e-9)
    assert timeline.confidence.min() == 1.0


def test_a_gap_of_just_max_gap_is_bridged_and_a_longer_one_is_held_and_reported():
    timeline = resample(clip([0.1, 0.35, 1.1], [0.0, 1.0, 5.0]), fps=20.0, max_gap=0.25)
    x = [0.0, 0.2, 0.4, 0.6, 0.8] + 15 * [1.0] + [5.0]
    np.testing.assert_allclose(timeline.positions[:, HEAD, 0], x, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(timeline.confidence[:, HEAD], 6 * [1] + 14 * [0] + [1])
    np.testing.assert_allclose(timeline.gaps, [(0.25, 1.0)], rtol=0, atol=1e-12)
    assert timeline.held == 14 * 20
    assert timeline.summary() == (
        "21 frames at 20 per second, 66.7 % of the joint positions held while lost, 1 gap (longest 0.75 s, from 0.25 s)"
    )


def test_one_lost_joint_is_held_by_itself_and_is_no_gap():
    confidence = np.ones((11, 20), dtype=np.float32)
    confidence[3:8, HEAD] = 0
    confidence[5:7, SPINE] = 0
    timeline = resample(clip(np.arange(11) / 10, np.arange(11.0), confidence), fps=10.0, max_gap=0.3)
    np.testing.assert_array_equal(timeline.positions[:, HEAD, 0], [0, 1, 2, 2, 2, 2, 2, 2, 8, 9, 10])
    np.testing.assert_array_equal(timeline.confidence[:, HEAD], [1, 1, 1, 0, 0, 0, 0, 0, 1, 1, 1])
    np.testing.assert_allclose(timeline.positions[:, SPINE, 0], np.arange(11), rtol=0, atol=1e-12)
    assert timeline.held == 5
    assert timeline.gaps == ()


def test_before_and_after_its_known_samples_a_joint_stays_at_the_nearest_of_them():
    confidence = np.ones((5, 20), dtype=np.float32)
    confidence[:2, HEAD] = 0
    confidence[3:, SPINE] = 0
    timeline = resample(clip(np.arange(5) / 30, np.arange(5.0), confidence))
    np.testing.assert_array_equal(timeline.positions[:, HEAD, 0], [2, 2, 2, 3, 4])
    np.testing.assert_array_equal(timeline.confidence[:, HEAD], [0, 0, 1, 1, 1])
    np.testing.assert_array_equal(timeline.positions[:, SPINE, 0], [0, 1, 2, 2, 2])
    np.testing.assert_array_equal(timeline.confidence[:, SPINE], [1, 1, 1, 0, 0])


def test_a_joint_that_is_never_known_is_nan_and_does_not_count_as_held():
    confidence = np.ones((4, 20), dtype=np.float32)
    confidence[:, HEAD] = 0
    timeline = resample(clip(np.arange(4) / 30, np.arange(4.0), confidence))
    nowhere = np.zeros((4, 20, 3), dtype=bool)
    nowhere[:, HEAD] = True
    np.testing.assert_array_equal(np.isnan(timeline.positions), nowhere)
    np.testing.assert_array_equal(timeline.confidence == 0, nowhere[:, :, 0])
    assert timeline.held == 0


def test_untracked_frames_at_both_ends_are_cut_off():
    confidence = np.ones((8, 20), dtype=np.float32)
    confidence[[0, 1, 7]] = 0
    whole = clip(3.0 + np.arange(8) / 30, np.arange(8.0), confidence)
    np.testing.assert_array_equal(resample(whole).positions, whole.positions[2:7])


def test_one_tracked_frame_makes_one_frame():
    timeline = resample(clip([4.2], [1.5]))
    np.testing.assert_array_equal(timeline.times, [0.0])
    np.testing.assert_array_equal(timeline.positions[0, :, 0], np.full(20, 1.5))
    assert timeline.summary() == "1 frame at 30 per second"


def test_a_clip_without_a_tracked_frame_is_refused():
    with pytest.raises(
        SkeletonLogError, match="the test recording, user 3: found no frame in which any joint is known"
    ):
        resample(clip([0.0, 1.0], [0.0, 1.0], 0.0, user=3))


def test_a_clock_that_jumps_too_far_is_refused_with_the_place_of_the_jump():
    with pytest.raises(SkeletonLogError) as caught:
        resample(clip([0.0, 0.5, 40000.5], [0.0, 1.0, 2.0]))
    assert "1.2e+06 frames at 30 per second (the longest gap is 40000 s, after 0.5 s)" in caught.value.found
    assert caught.value.expected == f"at most {MAX_FRAMES} frames"


def test_an_hour_long_gap_is_held_in_full():
    timeline = resample(clip([0.0, 3600.0], [0.0, 1.0]), fps=5.0)
    np.testing.assert_array_equal(timeline.positions[:, 0, 0], 18000 * [0.0] + [1.0])
    assert timeline.gaps == ((0.0, 3600.0),)


@pytest.mark.parametrize("wrong", [{"fps": 0.0}, {"fps": np.inf}, {"fps": np.nan}, {"max_gap": -0.1}])
def test_a_rate_or_gap_that_makes_no_clock_is_refused(wrong):
    with pytest.raises(ValueError, match="fps"):
        resample(clip([0.0, 1.0], [0.0, 1.0]), **wrong)


def performers():
    return [clip(np.arange(n), np.arange(float(n)), user=user) for user, n in ((4, 1), (2, 5), (7, 3))]


def test_the_performer_tracked_in_most_frames_is_chosen():
    clips = performers()
    longest_but_untracked = clip(np.arange(9), np.arange(9.0), 0.0, user=1)
    taken, note = choose([longest_but_untracked, *clips])
    assert taken is clips[1]
    assert note == (
        "User 2 (5 tracked frames) was chosen; other performers: 1 (0 tracked frames), 4 (1 tracked frame), "
        "7 (3 tracked frames)."
    )


def test_the_requested_performer_is_chosen():
    clips = performers()
    taken, note = choose(clips, user=7)
    assert taken is clips[2]
    assert note == "User 7 (3 tracked frames) was chosen; other performers: 4 (1 tracked frame), 2 (5 tracked frames)."


def test_a_single_performer_has_no_other_performers():
    assert choose(performers()[1:2])[1] == "User 2 (5 tracked frames) was chosen; other performers: none."


def test_an_unknown_performer_is_refused_with_those_that_there_are():
    with pytest.raises(SkeletonLogError) as caught:
        choose(performers(), user=5)
    assert caught.value.where == "the test recording, user"
    assert caught.value.found == "no user 5"
    assert caught.value.expected == "one of 4 (1 tracked frame), 2 (5 tracked frames), 7 (3 tracked frames)"


def test_a_log_without_performers_is_refused():
    with pytest.raises(SkeletonLogError, match="found no performer"):
        choose([])


def test_the_two_second_hole_of_a_real_recording_is_held(real_logs):
    (recorded,) = msrc12.read(real_logs / "msrc12" / "P1_1_1_p06.csv", ReadOptions())
    timeline = resample(recorded)
    ((start, end),) = timeline.gaps
    assert end - start == pytest.approx(2.034, abs=5e-4)
    hole = (timeline.times > start + 1e-3) & (timeline.times < end - 1e-3)
    assert (timeline.confidence[hole] == 0).all()
    assert (timeline.positions[hole] == timeline.positions[hole][0]).all()
    assert (timeline.confidence[~hole] > 0).all()
    assert timeline.held == 20 * hole.sum() == 20 * 61
