"""Recordings of events that a test has, and values that are equal for equal events."""

from capture.recording import Recorder
from capture.skeleton import SkeletonFrame


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
