"""Recordings of events that a test has or makes up, and values that are equal for equal events."""

import numpy as np

from capture.clip import SkeletonClip
from capture.recording import Recorder, as_recorded
from capture.skeleton import LOST, SkeletonFrame


def random_frame(time, user=1, channels=None):
    """Return a frame of random positions, some of which are lost."""
    rng = np.random.default_rng(abs(int(time * 1000)) + user)
    confidence = rng.choice([1.0, 0.7, 0.5, LOST], size=20).astype(np.float32)
    positions = np.where(confidence[:, None] == LOST, np.nan, rng.normal(size=(20, 3)))
    return SkeletonFrame(time, user, positions, confidence, channels=channels)


def tracked_frame(time, positions, user=1):
    """Return a frame of a performer whose joints are all tracked."""
    return SkeletonFrame(time, user, positions, np.ones(20, np.float32))


def random_clip(times, user=1):
    """Return a clip of random frames."""
    frames = [random_frame(time, user) for time in times]
    arrays = (np.array([getattr(frame, what) for frame in frames]) for what in ("time", "positions", "confidence"))
    return SkeletonClip("made", user, *arrays)


def record(path, events):
    """Write events as a recording of the project's own format; return its path."""
    with Recorder(path) as recorder:
        for event in events:
            recorder.write(event)
    return path


def key(event):
    """Return a value that is equal for events that are equal bit for bit."""
    if isinstance(event, SkeletonFrame):
        arrays = event.positions, event.confidence
        return (event.time, event.user, event.channels, *((each.dtype, each.tobytes()) for each in arrays))
    return event


def keys(events):
    """Return values that are equal for equal events, of frames as they are recorded."""
    return [key(as_recorded(event) if isinstance(event, SkeletonFrame) else event) for event in events]
