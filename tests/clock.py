"""Clocks that tests turn instead of waiting."""

import asyncio
import heapq
import itertools
import math
import selectors
import threading
from contextlib import contextmanager

from puppetline import clock


class GivenClock:
    """A clock that stands until something waits or the test advances it; implements `puppetline.clock.Clock`.

    A wait in the thread that made the clock ends at once if what it waits for has happened, and otherwise moves the
    clock to its own end: only what `call_at` does on the way can still happen. Other threads wait until it has happened
    or somebody has moved the clock.
    """

    def __init__(self, start=1000.0):
        self._now, self._date = start, 1.7e9 - start
        self._calls, self._numbers = [], itertools.count()
        self._thread = threading.get_ident()
        self._stands = False

    def now(self):
        return self._now

    def wall(self):
        return self._date + self._now

    def block(self, until, wait):
        if self._stands and threading.get_ident() == self._thread:
            return wait(0.001)
        if threading.get_ident() != self._thread or until == math.inf:
            while not (found := wait(0.001)) and self._now < until:
                pass
            return found
        if not (found := wait(0)) and until <= self._now:
            self.advance(1e-6)  # or what is due now except for a rounding error would be due for ever
        while not found and self._now < until:
            self.advance_to(min(until, self._calls[0][0] if self._calls else math.inf))
            found = wait(0)
        return found

    @contextmanager
    def standing(self):
        """Have the clock stand in the block, where waits end after a moment: for what others do in their own time."""
        self._stands = True
        try:
            yield
        finally:
            self._stands = False

    def call_at(self, moment, do):
        """Have a function called when the clock comes to a time."""
        heapq.heappush(self._calls, (moment, next(self._numbers), do))

    def advance(self, seconds):
        """Advance the clock by a number of seconds."""
        self.advance_to(self._now + seconds)

    def advance_to(self, moment):
        """Advance the clock to a time, unless that has passed; do on the way what is to be done until then."""
        while self._calls and self._calls[0][0] <= moment:
            due, _, do = heapq.heappop(self._calls)
            self._now = max(self._now, due)
            do()
        self._now = max(self._now, moment)


class GivenLoop(asyncio.SelectorEventLoop):
    """An event loop on the given clock: its sleeps end when the clock has come to their end.

    In the thread that made the clock, a sleep moves it there, as soon as nothing else is to be done; in other threads,
    somebody else moves it.
    """

    def __init__(self):
        super().__init__(_OnClock())

    def time(self):
        return clock.now()


class _OnClock(selectors.DefaultSelector):
    """Waits for files on the given clock."""

    def select(self, timeout=None):
        if timeout is not None and timeout <= 0:
            return super().select(0)
        wait = super().select
        if timeout is None:
            return clock.block(math.inf, lambda seconds: wait(None if seconds == math.inf else seconds))
        return clock.block(clock.now() + timeout, wait)
