"""Bends of fingers of constructed and drawn hands, and the hands in a video."""

from contextlib import closing

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from capture.skeleton import JOINT_INDEX
from capture.trackers.hands import FLAT_DEGREES, Hand, HandChannels, Hands, bends, straightness
from capture.trackers.mediapipe import MediaPipePose

from .conftest import HEIGHT
from .drawn_hands import WRIST, body, draw, four, landmarks


def test_a_flat_hand_is_open_a_fist_is_not_and_a_finger_points():
    assert_array_equal(straightness(bends(landmarks(0))), 1)
    assert_array_equal(straightness(bends(landmarks(85))), 0)
    assert_array_equal(straightness(bends(landmarks([0, 85, 85, 85]))), [1, 0, 0, 0])
    half = straightness(bends(landmarks(45)))
    assert ((half > 0.3) & (half < 0.95)).all()
    assert_allclose(bends(landmarks(40))[1:, 1:], 40, atol=2)


def test_each_joint_of_a_finger_has_a_channel_that_falls_to_zero_without_the_hand():
    channels, bent = HandChannels(), FLAT_DEGREES.copy()
    bent[1, 0] += 60
    found = channels.step(10.0, [Hand(np.zeros((2, 2)), np.zeros(3), bent), None])
    assert {name for name, value in found.items() if value > 0.01} == {"hand_open_left", "index_1_left"}
    assert found["index_1_left"] == pytest.approx(0.5)
    assert not any(name.endswith("right") for name in found)
    assert max(channels.step(12.0, [None, None]).values()) < 1e-5


@pytest.fixture
def hands(camera):
    with closing(Hands()) as hands:
        yield hands


@pytest.mark.slow
@pytest.mark.parametrize(("turned", "size"), [(-30, 1.0), (-15, 0.5), (0, 1.0), (0, 0.5), (30, 0.5)])
def test_the_hand_opens_as_far_as_a_drawn_one(hands, turned, size):
    channels, found, drawn = HandChannels(), [], []
    for bend in range(0, 91, 10):
        image = draw(bend, turned, size)
        hand = [hands.find(image, body(size))[0] for _ in range(3)][-1]
        assert_allclose(hand.pixels[0], size * WRIST, atol=12 * size)
        found.append(channels.step(10.0 + bend, [hand, None])["hand_open_left"])
        drawn.append(straightness(bends(landmarks(bend))).mean())
    assert np.corrcoef(drawn, found)[0, 1] >= 0.95
    assert min(found[:3]) >= 0.9
    assert found[-1] <= 0.2


@pytest.mark.slow
def test_of_four_hands_those_that_do_not_end_the_performers_arms_are_ignored_with_one_message(hands, caplog):
    (image, arms), alone, elsewhere = four(90, 0, 40, 90), draw(0), body()
    elsewhere[[13, 15, 17, 19]] += [130, -60]
    for _ in range(2):
        found = [hands.find(image, arms) for _ in range(4)][-1]
        assert_allclose([hand.pixels[0] for hand in found], arms[[15, 16]], atol=12)
        assert [straightness(hand.bends).mean() for hand in found] == pytest.approx([0.58, 1], abs=0.15)
        assert [hands.find(alone, elsewhere)[0] for _ in range(3)] == [None] * 3
    other_side = body()[[1, 0, *range(2, 13), 14, 13, 16, 15, 18, 17, 20, 19, *range(21, 33)]]
    assert hands.find(draw(90, 30), other_side)[1] is None
    assert caplog.messages == [
        "more hands than the performer's are in view; those that do not end its arms are ignored"
    ]


@pytest.mark.slow
def test_faces_and_hands_move_head_and_hands_only_and_those_of_the_video_are_seen(clip, squats):
    with closing(MediaPipePose(HEIGHT, face=True, hands=True)) as tracker:
        full = [tracker.track(picture)[0] for picture in clip[0][:10]]
    off = np.linalg.norm([one.positions - other for one, other in zip(full, squats, strict=False)], axis=-1)
    moved = [JOINT_INDEX[name] for name in ("head", "wrist_left", "wrist_right", "hand_left", "hand_right")]
    assert np.median(np.delete(off, moved, axis=1), axis=0).max() < 0.02
    assert (np.median(off[:, moved], axis=0) < 0.06).all()
    looks = Rotation.from_quat([person.orientations[JOINT_INDEX["shoulder_center"]][[1, 2, 3, 0]] for person in full])
    assert 20 < np.median(looks.as_rotvec(degrees=True)[:, 1]) < 35  # to her left
    assert np.isfinite(full[-1].orientations).any(axis=1).sum() == 1
    assert {"hand_open_left", "hand_open_right", "mouth_open"} <= full[-1].channels.keys()
    assert full[-1].channels["hand_open_right"] > 0.5
