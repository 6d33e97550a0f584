import numpy as np
import pytest
from puppetline.examples.kinect_noise import ABSENCE_SECONDS
from puppetline.examples.performances import PERFORMANCES, clean
from puppetline.examples.performer import REST, posed

from capture.body import typical_bone_length
from capture.formats import read_log
from capture.skeleton import INFERRED, JOINT_INDEX, LOST, PARENTS, TRACKED

NAMES = list(PERFORMANCES)
RATE = 30.0


def paths(clip):
    """Each joint's (T, 3) path by name."""
    return {name: clip.positions[:, j] for name, j in JOINT_INDEX.items()}


def between(clip, start, end):
    return (clip.times >= start) & (clip.times <= end)


def bone_variation(positions):
    """Standard deviation of each bone's length by its mean."""
    lengths = np.array(
        [
            np.linalg.norm(positions[:, JOINT_INDEX[joint]] - positions[:, JOINT_INDEX[parent]], axis=1)
            for joint, parent in PARENTS.items()
        ]
    )
    return np.nanstd(lengths, axis=1) / np.nanmean(lengths, axis=1)


# --- the motion -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_bones_keep_their_length(name):
    joint = paths(clean(name))
    for child, parent in PARENTS.items():
        lengths = np.linalg.norm(joint[child] - joint[parent], axis=1)
        np.testing.assert_allclose(lengths, typical_bone_length(child), rtol=0, atol=1e-9, err_msg=child)


@pytest.mark.parametrize("name", NAMES)
def test_begins_and_ends_in_the_neutral_pose(name):
    clip = clean(name)
    start = clip.positions[clip.times <= 0.79]
    assert len(start) >= 0.6 * RATE
    np.testing.assert_allclose(start, np.broadcast_to(start[0], start.shape), rtol=0, atol=1e-12)
    end = clip.positions[clip.times >= clip.times[-1] - 0.3]
    np.testing.assert_allclose(end, np.broadcast_to(end[-1], end.shape), rtol=0, atol=1e-12)
    (neutral,) = posed({part: np.array([rest]) for part, rest in REST.items()}, distance=2.5)
    for pose in (start[0], end[-1]):
        np.testing.assert_allclose(pose - pose[0], neutral - neutral[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_standing_feet_do_not_move_and_one_always_stands(name):
    joint = paths(clean(name))
    stands = []
    for side in ("left", "right"):
        ankle, foot = joint[f"ankle_{side}"], joint[f"foot_{side}"]
        on_floor = np.abs(ankle[:, 1] - ankle[0, 1]) < 1e-9
        still = on_floor[1:] & on_floor[:-1]
        for path in (ankle, foot):
            assert np.abs(np.diff(path, axis=0)[still]).max() < 1e-9
        assert ankle[:, 1].min() > ankle[0, 1] - 1e-9
        stands.append(on_floor)
    assert np.all(stands[0] | stands[1])


@pytest.mark.parametrize("name", NAMES)
def test_moves_no_faster_than_a_human(name):
    positions = clean(name).positions
    assert np.linalg.norm(np.diff(positions, axis=0), axis=2).max() * RATE < 12.0
    assert np.linalg.norm(np.diff(positions, 2, axis=0), axis=2).max() * RATE**2 < 150.0


@pytest.mark.parametrize(("hand", "other", "start", "end"), [("right", "left", 1.9, 2.3), ("left", "right", 2.9, 3.3)])
def test_a_punch_goes_towards_the_sensor(hand, other, start, end):
    clip = clean("kung_fu")
    joint, during = paths(clip), between(clip, start, end)
    fist, guard = (joint[f"hand_{side}"][during] for side in (hand, other))
    assert fist[-1, 2] < fist[0, 2] - 0.2
    assert guard[-1, 2] > guard[0, 2] + 0.15
    shoulder = joint[f"shoulder_{hand}"][during][-1]
    arm = (fist[-1] - shoulder) / np.linalg.norm(fist[-1] - shoulder)
    assert arm[2] < -0.95
    assert abs(fist[-1, 1] - shoulder[1]) < 0.15


def test_kung_fu_kicks_high_with_the_right_leg_sweeps_the_arms_and_bows():
    clip = clean("kung_fu")
    joint = paths(clip)
    peak = int(np.argmax(joint["foot_right"][:, 1]))
    assert 4.5 < clip.times[peak] < 5.0
    assert joint["foot_right"][peak, 1] > joint["hip_center"][peak, 1] + 0.1
    assert joint["foot_right"][peak, 2] < joint["hip_center"][peak, 2] - 0.7
    wide = joint["hand_right"][:, 0] - joint["hand_left"][:, 0]
    assert wide[between(clip, 6.5, 7.0)].max() > 1.3
    assert joint["hand_left"][between(clip, 7.0, 7.4), 1].max() > joint["head"][0, 1] + 0.2
    palms = between(clip, 8.2, 9.2)
    assert np.linalg.norm(joint["hand_right"] - joint["hand_left"], axis=1)[palms].max() < 0.12
    assert (joint["head"] - joint["hip_center"])[palms, 2].min() < -0.35


def steps_of(clip):
    """The sides of the steps, in order, and the heights of the ankles over the floor."""
    joint = paths(clip)
    heights = {side: joint[f"ankle_{side}"][:, 1] - joint[f"ankle_{side}"][0, 1] for side in ("left", "right")}
    begun = sorted(
        (frame, side)
        for side, height in heights.items()
        for frame in np.flatnonzero(np.diff((height > 0.05).astype(int)) == 1)
    )
    return [side for _, side in begun], heights


@pytest.mark.parametrize(("name", "count", "lift"), [("roar", 4, 0.2), ("rear", 5, 0.14), ("bark", 3, 0.11)])
def test_a_walk_towards_the_sensor_steps_with_the_right_and_the_left_foot_in_turn(name, count, lift):
    sides, heights = steps_of(clean(name))
    assert sides == ["right", "left", "right", "left", "right"][:count]
    for height in heights.values():
        assert height.max() == pytest.approx(lift, abs=0.02)


def test_roar_raises_both_hands_with_the_trunk_bent_forward_and_looks_to_both_sides():
    clip = clean("roar")
    joint, roars = paths(clip), between(clip, 4.9, 6.0)
    for side in ("left", "right"):
        assert joint[f"hand_{side}"][roars, 1].min() > joint[f"shoulder_{side}"][roars, 1].max() - 0.15
    assert (joint["hip_center"] - joint["head"])[roars, 2].min() > 0.08
    aside = (joint["head"] - joint["hip_center"])[between(clip, 7.0, 8.2), 0]
    assert aside.max() > 0.1
    assert aside.min() < -0.1


def test_rear_raises_both_hands_above_the_head_and_beats_them_three_times():
    clip = clean("rear")
    joint = paths(clip)
    for side in ("left", "right"):
        over = (joint[f"hand_{side}"] - joint["head"])[:, 1]
        assert over[between(clip, 4.5, 4.9)].min() > 0.1
        beats = over[between(clip, 5.3, 7.9)] > 0.0
        assert np.count_nonzero(np.diff(beats.astype(int)) == 1) == 3


def test_bark_sits_gives_the_right_hand_bends_the_left_elbow_three_times_and_wags():
    clip = clean("bark")
    joint, sits = paths(clip), between(clip, 4.0, 8.0)
    height = joint["hip_center"][:, 1] - joint["hip_center"][0, 1]
    np.testing.assert_allclose(height[sits], -0.36, atol=1e-9)
    paw = (joint["hand_right"] - joint["shoulder_right"])[between(clip, 4.9, 5.5)]
    assert paw[:, 2].max() < -0.35
    forearm = joint["wrist_left"] - joint["elbow_left"]
    ahead = -forearm[:, 2] / np.linalg.norm(forearm, axis=1) > 0.75
    opened = clip.times[1:][np.diff(ahead.astype(int)) == 1]
    assert np.diff(opened) == pytest.approx([0.45, 0.45], abs=0.04)
    lean = (joint["shoulder_center"] - joint["spine"])[between(clip, 8.95, 10.9), 0]
    assert np.count_nonzero(np.diff(np.sign(lean))) == 5
    assert np.ptp(lean) > 0.1


def test_walk_comes_three_steps_nearer_waves_and_steps_aside():
    clip = clean("walk")
    joint = paths(clip)
    assert joint["hip_center"][0, 2] - joint["hip_center"][-1, 2] == pytest.approx(0.96)
    assert joint["hip_center"][:, 0].max() == pytest.approx(0.36, abs=0.01)
    wave = between(clip, 3.9, 5.2)
    assert np.all(joint["hand_right"][wave, 1] > joint["shoulder_center"][wave, 1])
    assert np.count_nonzero(np.diff(np.sign(np.diff(joint["hand_right"][wave, 0])))) >= 4
    assert np.all(joint["hand_left"][wave, 1] < joint["hip_center"][wave, 1])


# --- as recorded ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_two_builds_are_the_same(name):
    first, second = PERFORMANCES[name](), PERFORMANCES[name]()
    for field in ("times", "positions", "confidence"):
        np.testing.assert_array_equal(getattr(first, field), getattr(second, field))
    assert first.user == 1


@pytest.mark.parametrize("name", NAMES)
def test_single_joints_drop_out_and_some_are_guessed(name):
    confidence = PERFORMANCES[name]().confidence
    somebody = (confidence > LOST).any(axis=1)
    assert 0.003 < np.mean(confidence[somebody] == LOST) < 0.015
    assert 0.001 < np.mean(confidence[somebody] == INFERRED) < 0.10


@pytest.mark.parametrize("name", NAMES)
def test_the_calibration_pose_is_seen_whole(name):
    clip = PERFORMANCES[name]()
    begin = clip.times <= 0.6
    assert np.all(clip.confidence[begin] == TRACKED)
    assert np.abs(clip.positions[begin] - clean(name).positions[0]).max() < 0.04


def test_the_sensor_loses_the_whole_body_once_in_the_walk():
    clip = PERFORMANCES["walk"]()
    gaps = np.diff(clip.times[(clip.confidence > LOST).any(axis=1)])
    assert gaps.max() == pytest.approx(ABSENCE_SECONDS, abs=0.08)
    assert np.count_nonzero(gaps > 0.25) == 1


def test_bones_vary_and_the_clock_jitters_as_on_a_real_kinect(real_logs):
    (real,) = read_log(real_logs / "msrc12" / "P1_1_1_p19.csv")
    ours = [PERFORMANCES[name]() for name in NAMES]
    variation = np.mean([bone_variation(clip.positions).mean() for clip in ours])
    assert variation == pytest.approx(bone_variation(real.positions).mean(), rel=0.4)

    def spread(clip):
        steps = np.diff(clip.times)
        return np.std(steps[steps < 0.05])

    assert np.mean([spread(clip) for clip in ours]) == pytest.approx(spread(real), rel=0.2)
