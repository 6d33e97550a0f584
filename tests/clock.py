"""A clock that tests turn instead of waiting."""

import time


class Clock:
    """The monotonic clock of this process: all threads see it advance."""

    def __init__(self, patch):
        self._skipped = 0.0
        monotonic, monotonic_ns = time.monotonic, time.monotonic_ns
        patch.setattr(time, "monotonic", lambda: monotonic() + self._skipped)
        patch.setattr(time, "monotonic_ns", lambda: monotonic_ns() + int(1e9 * self._skipped))

    def advance(self, seconds):
        """Advance the clock by a number of seconds."""
        self._skipped += seconds

    def advance_to(self, time_):
        """Advance the clock to a time, unless that has passed."""
        self.advance(max(0.0, time_ - time.monotonic()))
