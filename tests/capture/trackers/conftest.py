"""A video of squats, and what MediaPipe finds in it."""

import json
from contextlib import closing

import numpy as np
import pytest

from capture.sensors.camera import Options, Video
from capture.trackers.mediapipe import LANDMARK_WEIGHTS, MediaPipePose

HEIGHT = 1.65
"""Of the performer, in metres."""


@pytest.fixture(scope="session")
def clip(camera, real_data):
    """Images of squats, and joints of a reference's landmarks in pixels and in metres."""
    folder = real_data / "video" / "tfjs"
    with closing(Video("video:squats", folder / "pose_squats.mp4", Options("squats"))) as video:
        pictures = [video.read(1.0) for _ in range(65)]
    reference = [json.loads((folder / f"pose_squats{kind}.full.json").read_text()) for kind in ("", "_3d")]
    return pictures, LANDMARK_WEIGHTS @ np.array(reference[0])[..., :2], LANDMARK_WEIGHTS @ np.array(reference[1])


@pytest.fixture(scope="session")
def squats(clip):
    """The joints (T, 20, 3) that are found in the clip."""
    with closing(MediaPipePose(HEIGHT)) as tracker:
        people = [tracker.track(picture) for picture in clip[0]]
    assert [[(person.user, person.channels) for person in each] for each in people] == [[(1, None)]] * len(people)
    return np.stack([person.positions for [person] in people])
