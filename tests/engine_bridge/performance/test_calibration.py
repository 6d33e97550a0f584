import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.skeleton import JOINT_INDEX, LOST, TRACKED, SkeletonFrame
from engine_bridge.performance.calibration import RecentFrames, same_body


def frames_of(positions, confidence=None, fps=30.0):
    sure = np.full(positions.shape[:2], TRACKED, dtype=np.float32) if confidence is None else confidence
    return [SkeletonFrame(k / fps, 1, p, c) for k, (p, c) in enumerate(zip(positions, sure, strict=True))]


def after(frames):
    last = RecentFrames()
    for frame in frames:
        last.add(frame)
    return last


@pytest.mark.parametrize("fps", [10.0, 30.0, 120.0])
def test_a_second_of_noise_about_one_pose_is_still_and_gives_that_pose(standing, fps):
    noise = np.random.default_rng(1).normal(0, 0.01, (round(1.1 * fps), 20, 3))
    last = after(frames_of(standing + noise, fps=fps))
    assert last.is_still()
    assert np.linalg.norm(last.pose() - standing, axis=1).max() < 0.02


def test_less_than_a_second_is_not_enough(standing):
    assert not after(frames_of(np.tile(standing, (20, 1, 1)))).is_still()
    assert not RecentFrames().is_still()


def test_slow_motion_of_both_arms_is_not_still_and_one_wild_joint_is(standing):
    moving = np.tile(standing, (33, 1, 1))
    for name in ("wrist_left", "hand_left", "wrist_right", "hand_right"):
        moving[:, JOINT_INDEX[name], 1] += np.linspace(0, 0.15, 33)
    assert not after(frames_of(moving)).is_still()
    guessed = np.tile(standing, (33, 1, 1))
    guessed[:, JOINT_INDEX["foot_left"], 1] += np.linspace(0, 0.5, 33)
    assert after(frames_of(guessed)).is_still()


def test_joints_that_are_lost_are_left_out(standing):
    positions = np.tile(standing, (33, 1, 1))
    confidence = np.full((33, 20), TRACKED, dtype=np.float32)
    hand = JOINT_INDEX["hand_left"]
    positions[::2, hand] = 1e3
    confidence[::2, hand] = LOST
    last = after(frames_of(positions, confidence))
    assert last.is_still()
    np.testing.assert_allclose(last.pose(), standing)
    confidence[:, 4:] = LOST
    assert not after(frames_of(positions, confidence)).is_still()  # four joints say nothing


@pytest.mark.parametrize("name", PERFORMANCES)
def test_performers_of_the_examples_stand_still_at_the_start(name):
    last = RecentFrames()
    found = next(frame.time for frame in PERFORMANCES[name]().frames() if not last.add(frame) and last.is_still())
    assert 0.9 <= found < 1.1


def test_a_body_is_known_again_in_another_pose_and_another_body_is_not(standing, dance):
    assert same_body(standing, dance(30)[20])
    assert not same_body(standing, 0.75 * standing)
