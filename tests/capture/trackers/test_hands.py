"""Straightness of fingers of constructed hands, and the hands in a video."""

import numpy as np
import pytest

from capture.sensors.camera import Options, Video
from capture.trackers.hands import HandChannels, straightness
from capture.trackers.mediapipe import MediaPipePose

from .drawn_hands import body, draw, landmarks


def hand(*bends):
    """Return landmarks (21, 3) of a hand whose fingers bend by these degrees at each of their three joints."""
    points = np.zeros((21, 3))
    for finger, bend in enumerate(bends):
        at = np.array([0.02 * finger, 0.09, 0.0])
        for k, length in enumerate((0.0, 0.04, 0.025, 0.02)):
            angle = np.radians(bend) * k
            at = at + length * np.array([0.0, np.cos(angle), -np.sin(angle)])
            points[5 + 4 * finger + k] = at
    return points


def test_a_flat_hand_is_open_a_fist_is_not_and_a_finger_points():
    np.testing.assert_array_equal(straightness(hand(0, 0, 0, 0)), 1)
    np.testing.assert_array_equal(straightness(hand(85, 85, 85, 85)), 0)
    np.testing.assert_array_equal(straightness(hand(0, 85, 85, 85)), [1, 0, 0, 0])
    half = straightness(hand(45, 45, 45, 45))
    assert ((half > 0.3) & (half < 0.95)).all()


@pytest.mark.slow
@pytest.mark.parametrize(("turned", "least"), [(-30, 0.85), (0, 0.8), (30, 0.85)])
def test_the_hand_opens_as_far_as_a_drawn_one(camera, turned, least):
    """Half bent fingers that point at the camera, those of 60 and 70 degrees, count as straight."""
    hands, bends = HandChannels(), range(0, 91, 10)
    found = []
    for number, bend in enumerate(bends):
        for again in (1.0, 1.5):
            channels = hands.step(10 * number + 5 * again, draw(bend, turned), body())
        found.append(channels["hand_open_right"])
    hands.close()
    drawn = [straightness(landmarks(bend)).mean() for bend in bends]
    assert np.corrcoef(drawn, found)[0, 1] >= least
    assert min(found[:3]) >= 0.9
    assert found[-1] <= 0.2


@pytest.mark.slow
def test_channels_do_not_change_the_joints_and_the_hands_of_the_video_are_open(camera, real_data):
    video = Video("video:squats", real_data / "video" / "tfjs" / "pose_squats.mp4", Options("squats"))
    pictures = [video.read(1.0) for _ in range(20)]
    video.close()
    found = []
    for options in (Options("0"), Options("0", face=True, hands=True)):
        tracker = MediaPipePose(channels=options.channels)
        found.append([tracker.track(picture)[0] for picture in pictures])
        tracker.close()
    bare, full = found
    assert {person.channels for person in bare} == {None}
    for one, other in zip(bare, full, strict=True):
        np.testing.assert_array_equal(one.positions, other.positions)
    assert {"hand_open_left", "hand_open_right", "mouth_open"} <= full[-1].channels.keys()
    assert full[-1].channels["hand_open_left"] > 0.5
