"""A device and a tracker that do what a test says, and a source watched as the service watches it."""

import queue
import time
from contextlib import ExitStack
from select import select

import numpy as np
import pytest

from capture.events import Tick
from capture.sensors.picture import Lens, Person, Picture
from capture.sensors.source import SensorSource

PATIENCE = 10.0
"""Seconds after which a test gives up."""

LENS = Lens(4, 3, 4.0)


class ScriptedDevice:
    """Gives the pictures that are put into it; what is put in and is an exception is raised."""

    name = "a scripted device"

    def __init__(self):
        self.pictures = queue.SimpleQueue()
        self.closed = 0

    def show(self, *times, color=None):
        """Put in pictures that were taken at those times."""
        for taken in times:
            self.pictures.put(Picture(taken, LENS, color, None))

    def read(self, timeout):
        try:
            picture = self.pictures.get(timeout=timeout)
        except queue.Empty:
            return None
        if isinstance(picture, Exception):
            raise picture
        return picture

    def close(self):
        self.closed += 1


class ScriptedTracker:
    """Finds the people that were last put into it, or raises what is an exception; remembers the pictures' times.

    A person's positions are all the picture's time.
    """

    name = "a scripted tracker"

    def __init__(self, *users):
        self.users = users
        self.seen = []
        self.closed = 0

    def track(self, picture):
        self.seen.append(picture.time)
        if isinstance(self.users, Exception):
            raise self.users
        positions = np.full((20, 3), picture.time, dtype=np.float32)
        return [Person(user, positions, np.ones(20, dtype=np.float32)) for user in self.users]

    def close(self):
        self.closed += 1


class Watched:
    """A source, waited for as the service waits."""

    def __init__(self, source):
        self.source = source

    def events(self, count=1, until=None):
        """Return what comes until that many events have come, ticks not counted."""
        found = []
        give_up = time.monotonic() + PATIENCE
        while not (until(found) if until else len(found) >= count):
            assert time.monotonic() < give_up, found
            self.wait()
            found += [event for event in self.source.receive() if not isinstance(event, Tick)]
        return found

    def wait(self):
        """Wait until the source wants to be called."""
        select([self.source.fileno()], [], [], max(0, min(self.source.due() - time.monotonic(), 1)))

    def error(self):
        """Return the error that ends it."""
        with pytest.raises(Exception) as caught:  # noqa: PT011
            self.events(until=lambda _: False)
        assert not isinstance(caught.value, AssertionError), caught.value
        return caught.value


@pytest.fixture
def scripted_device():
    return ScriptedDevice()


@pytest.fixture
def scripted_tracker():
    return ScriptedTracker(1)


@pytest.fixture
def watch():
    """Open a source of a device and a tracker, or of what opens them."""
    with ExitStack() as stack:

        def opened(device, tracker, name="test:", **options):
            source = SensorSource(
                name,
                device if callable(device) else lambda: device,
                tracker if callable(tracker) else lambda _device: tracker,
                **options,
            )
            stack.callback(source.close)
            return Watched(source)

        yield opened
