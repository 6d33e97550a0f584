import numpy as np
import pytest
from puppetline.examples.kinect_noise import (
    ABSENCE_SECONDS,
    FAST_METRES_PER_SECOND,
    FRAMES_PER_SECOND,
    GUESS_FACTOR,
    NOMINAL_DEPTH_METRES,
    with_kinect_noise,
)
from puppetline.examples.performer import REST, posed
from scipy.interpolate import CubicSpline

from capture.clip import SkeletonClip
from capture.skeleton import INFERRED, JOINT_INDEX, JOINTS, LOST, TRACKED

LIMBS = [
    j for j, name in enumerate(JOINTS) if name.split("_")[0] in {"elbow", "wrist", "hand", "knee", "ankle", "foot"}
]
TRUNK = [j for j in range(len(JOINTS)) if j not in LIMBS]


def standing(frames, distance=NOMINAL_DEPTH_METRES):
    """Return a clip of a performer who stands still."""
    pose = posed({part: np.array([rest]) for part, rest in REST.items()}, distance)
    confidence = np.ones((frames, len(JOINTS)), dtype=np.float32)
    return SkeletonClip("test", 1, np.arange(frames) / FRAMES_PER_SECOND, np.repeat(pose, frames, axis=0), confidence)


def errors(noisy, true):
    return noisy.positions - CubicSpline(true.times, true.positions)(noisy.times)


def runs(flags):
    """Lengths of the runs of True in a one-dimensional array that neither begin nor end with it."""
    changes = np.flatnonzero(np.diff(flags))
    return np.diff(changes)[~flags[changes[:-1]]]


@pytest.fixture(scope="module")
def still():
    return standing(6000)


@pytest.fixture(scope="module")
def noisy(still):
    before = still.positions.copy()
    made = with_kinect_noise(still, 1)
    np.testing.assert_array_equal(still.positions, before)
    return made


def test_only_joints_of_the_limbs_are_lost_or_stray_alone_and_not_for_long(still, noisy):
    lost = noisy.confidence == LOST
    off = np.nan_to_num(np.linalg.norm(errors(noisy, still), axis=2)) > 0.08
    assert not (lost | off)[:, TRUNK].any()
    lengths = [length for joint in LIMBS for length in runs(lost[:, joint])]
    assert min(lengths) == 3
    assert np.percentile(lengths, 95) <= 15  # two may meet
    assert {length for joint in LIMBS for length in runs(off[:, joint])} == {1, 2}
    assert 0.005 < lost.mean() < 0.011
    assert 0.005 < 1 - len(noisy.times) / len(still.times) < 0.02  # frames are lost as well
    assert np.diff(np.round(noisy.times * FRAMES_PER_SECOND)).min() >= 1
    assert 0.0003 < off.mean() < 0.0015
    assert np.all(noisy.confidence[off] == TRACKED)
    assert not np.any(noisy.confidence == INFERRED)  # none is fast or hidden


def test_errors_grow_with_the_square_of_the_distance():
    near, far = standing(300, 2.0), standing(300, 4.0)
    noisy_near, noisy_far = with_kinect_noise(near, 1), with_kinect_noise(far, 1)
    assert not np.array_equal(noisy_near.positions, with_kinect_noise(near, 2).positions)
    growth = errors(noisy_far, far)[:, TRUNK] / errors(noisy_near, near)[:, TRUNK]
    depth = (far.positions[0, TRUNK, 2] / near.positions[0, TRUNK, 2]) ** 2
    np.testing.assert_allclose(growth, np.broadcast_to(depth[:, None], growth.shape), rtol=1e-6)


def test_hands_before_the_torso_and_fast_joints_are_guessed_with_larger_errors():
    clip = standing(6000)
    clip.positions[:, JOINT_INDEX["hand_left"]] = [0.0, 0.3, 2.2]
    clip.positions[:, JOINT_INDEX["foot_right"], 0] += 0.2 * np.sin(10.0 * clip.times)
    noisy = with_kinect_noise(clip, 1)
    guessed = noisy.confidence == INFERRED
    assert set(np.flatnonzero(guessed.any(axis=0))) == {JOINT_INDEX["hand_left"], JOINT_INDEX["foot_right"]}
    speed = np.abs(2.0 * np.cos(10.0 * noisy.times))
    begins = np.flatnonzero(np.diff(guessed[:, JOINT_INDEX["foot_right"]].astype(int)) == 1) + 1
    assert np.all(speed[begins] > FAST_METRES_PER_SECOND - 0.01)

    hand = guessed[:, JOINT_INDEX["hand_left"]]
    off = np.linalg.norm(errors(noisy, clip)[:, JOINT_INDEX["hand_left"]], axis=1)
    assert 0.15 < hand.mean() < 0.3
    assert np.nanmedian(off[hand]) == pytest.approx(GUESS_FACTOR * np.nanmedian(off[~hand]), rel=0.15)


def test_the_whole_body_is_lost_for_a_while_where_it_is_away_and_nothing_else_changes():
    clip = standing(300)
    here, away = with_kinect_noise(clip, 1), with_kinect_noise(clip, 1, away=4.0)
    gone = (here.times >= 4.0) & (here.times < 4.0 + ABSENCE_SECONDS)
    np.testing.assert_array_equal(away.times, here.times)
    np.testing.assert_array_equal(away.confidence, np.where(gone[:, None], LOST, here.confidence))
    np.testing.assert_array_equal(away.positions, np.where(gone[:, None, None], np.nan, here.positions))
