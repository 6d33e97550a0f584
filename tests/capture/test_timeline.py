import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from capture.clip import SkeletonClip
from capture.skeleton import JOINT_INDEX
from capture.timeline import choose, resample
from puppetline.errors import SkeletonLogError

HEAD, SPINE, NEVER = JOINT_INDEX["head"], JOINT_INDEX["spine"], JOINT_INDEX["foot_left"]


def clip(times, x, lost=(), user=0):
    """Return a clip with every joint at (x, 10 x, joint number) thousandths, except the lost ones."""
    times = np.asarray(times, dtype=float)
    x = np.broadcast_to(np.asarray(x, dtype=float)[:, None], (len(times), 20))
    positions = np.stack([x, 10 * x, np.broadcast_to(np.arange(20.0), x.shape)], axis=2) / 1000
    confidence = np.ones(x.shape, dtype=np.float32)
    for place in lost:
        positions[place], confidence[place] = np.nan, 0
    return SkeletonClip("test", user, times, positions, confidence)


@pytest.mark.parametrize("start", [0.0, 17.3, 1.7e9])
def test_a_clip_on_the_clock_is_unchanged(start):
    recorded = clip(start + np.arange(500) / 30, np.random.default_rng(0).normal(size=500))
    timeline = resample(recorded, 30.0)
    assert_array_equal(timeline.positions, recorded.positions)
    assert_array_equal(timeline.confidence, recorded.confidence)
    assert_allclose(timeline.times, recorded.times - start, rtol=0, atol=1e-6)
    assert (timeline.gaps, timeline.held, timeline.summary()) == ((), 0, "500 frames at 30 per second")


def test_interpolates_linearly_with_the_lower_confidence():
    """Samples at 0, 0.1 and 0.2 s, clock of 25 Hz: 0, 0.04, 0.08, 0.12, 0.16, 0.2 s."""
    recorded = clip([5.0, 5.1, 5.2], [0.0, 1.0, 3.0])
    recorded.confidence[2, HEAD] = 0.5
    timeline = resample(recorded, fps=25.0)
    x = np.array([0.0, 0.4, 0.8, 1.4, 2.2, 3.0])
    assert_allclose(1000 * timeline.positions[:, SPINE, :2], np.stack([x, 10 * x], axis=1), rtol=0, atol=1e-11)
    assert_array_equal(timeline.confidence[:, [SPINE, HEAD]].T, [6 * [1], 3 * [1] + 3 * [0.5]])


def test_a_gap_of_just_max_gap_is_bridged_and_a_longer_one_is_held_and_reported():
    timeline = resample(clip([0.1, 0.35, 1.1], [0.0, 1.0, 5.0]), fps=20.0, max_gap=0.25)
    x = [0.0, 0.2, 0.4, 0.6, 0.8] + 15 * [1.0] + [5.0]
    assert_allclose(1000 * timeline.positions[:, HEAD, 0], x, rtol=0, atol=1e-9)
    assert_array_equal(timeline.confidence[:, HEAD], 6 * [1] + 14 * [0] + [1])
    assert_allclose(timeline.gaps, [(0.25, 1.0)], rtol=0, atol=1e-12)
    assert timeline.held == 14 * 20
    assert timeline.summary() == (
        "21 frames at 20 per second, 66.7 % of the joint positions held while lost, 1 gap (longest 0.75 s, from 0.25 s)"
    )
    assert resample(clip([0.0, 3600.0], [0.0, 1.0]), fps=5.0).gaps == ((0.0, 3600.0),)


def test_a_joint_is_held_by_itself_and_stays_at_its_nearest_sample_at_both_ends():
    lost = [(slice(3, 8), HEAD), (slice(5, 7), SPINE), (slice(2), 0), (slice(9, None), 1), (slice(None), NEVER)]
    timeline = resample(clip(np.arange(11) / 10, np.arange(11.0), lost), fps=10.0, max_gap=0.3)
    x = {HEAD: [0, 1, *6 * [2], 8, 9, 10], SPINE: range(11), 0: [2, 2, *range(2, 11)]}
    sure = {HEAD: [1, 1, 1, *5 * [0], 1, 1, 1], 0: [0, 0, *9 * [1]], NEVER: 11 * [0]}
    x[1], sure[1] = [*range(9), 8, 8], [*9 * [1], 0, 0]
    for joint, expected in x.items():
        assert_allclose(1000 * timeline.positions[:, joint, 0], expected, rtol=0, atol=1e-12)
    for joint, expected in sure.items():
        assert_array_equal(timeline.confidence[:, joint], expected)
    assert np.flatnonzero(np.isnan(timeline.positions).any(axis=(0, 2))).tolist() == [NEVER]
    assert (timeline.held, timeline.gaps) == (5 + 2 + 2, ())


def test_untracked_frames_at_both_ends_are_cut_off():
    whole = clip(3.0 + np.arange(8) / 30, np.arange(8.0), [[0, 1, 7]])
    assert_array_equal(resample(whole).positions, whole.positions[2:7])
    timeline = resample(clip([4.2], [1.5]))
    assert (timeline.times.tolist(), timeline.summary()) == ([0.0], "1 frame at 30 per second")


@pytest.mark.parametrize(
    ("recorded", "found"),
    [
        (clip([0.0, 1.0], [0.0, 1.0], [slice(None)], user=3), "no frame"),
        (clip([0.0, 0.5, 40000.5], [0.0, 1.0, 2.0], user=3), "the longest gap is 40000 s, after 0.5 s"),
    ],
)
def test_a_clip_without_tracked_frames_or_with_too_many_is_refused(recorded, found):
    with pytest.raises(SkeletonLogError) as caught:
        resample(recorded)
    assert caught.value.where == "the test recording, user 3"
    assert found in caught.value.found


@pytest.mark.parametrize("wrong", [{"fps": 0.0}, {"fps": np.inf}, {"fps": np.nan}, {"max_gap": -0.1}])
def test_a_rate_or_gap_that_makes_no_clock_is_refused(wrong):
    with pytest.raises(ValueError, match="fps"):
        resample(clip([0.0, 1.0], [0.0, 1.0]), **wrong)


def test_the_performer_tracked_in_most_frames_or_the_requested_one_is_chosen():
    clips = [clip(np.arange(n), np.arange(n), user=user) for user, n in ((4, 1), (2, 5), (7, 3))]
    longest_but_untracked = clip(np.arange(9), np.arange(9), [slice(None)], user=1)
    taken, note = choose([longest_but_untracked, *clips])
    assert taken is clips[1]
    assert note == (
        "User 2 (5 tracked frames) was chosen; other performers: 1 (0 tracked frames), 4 (1 tracked frame), "
        "7 (3 tracked frames)."
    )
    assert choose(clips, user=7)[0] is clips[2]
    assert choose(clips[:1])[1].endswith("other performers: none.")
    with pytest.raises(SkeletonLogError) as caught:
        choose(clips, user=5)
    assert (caught.value.where, caught.value.found) == ("the test recording, user", "no user 5")
    with pytest.raises(SkeletonLogError):
        choose([])
