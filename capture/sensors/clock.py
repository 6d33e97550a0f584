"""Times of images on this computer's clock, from a device's own clock and the arrival times of its images.

The images with the smallest delay determine the difference between both clocks. The difference falls immediately and
rises slowly, so that neither a late image nor a slightly slow clock changes it much.

A device's clock is trusted if the smallest delays of consecutive spans of time are about the same. Until then, an image
has its arrival time. The same applies if the device's clock is too slow or too fast for several spans, stands still, or
counts in another unit.
"""

import math
from collections import deque

SPAN_SECONDS = 1.0
"""Length of the spans of time whose smallest delays are compared, in seconds."""
MAX_DRIFT = 0.02
"""Largest rate error of a trusted clock, in seconds per second; crystals are a thousand times better."""
SPAN_COUNT = 3
"""Number of consecutive spans with a larger rate error after which a clock is not trusted; one may just have delays."""

_RISE_SECONDS = 2.0  # time constant with which the difference of the clocks rises


class DeviceClock:
    """Converts a device's times to this computer's clock.

    Attributes
    ----------
    trusted : bool
        Whether the device's own times are used.
    """

    def __init__(self) -> None:
        self.trusted = False
        self._last_taken = math.inf  # time of the last image on the device's clock
        self._last_moment = -math.inf  # the same on this computer's clock
        self._offset = 0.0  # seconds by which this computer's clock is ahead
        self._span_start = math.nan
        self._smallest = self._previous = math.inf, math.nan  # offset of least delay in a span, and when
        self._drifts: deque[float] = deque(maxlen=SPAN_COUNT)  # seconds per second that the device's clock lost

    def moment(self, taken: float, now: float) -> float:
        """Return when an image was taken, which is not after `now` and not before the last image.

        Parameters
        ----------
        taken : float
            Time on the device's clock, in seconds.
        now : float
            Arrival time on this computer's clock, in seconds.
        """
        offset = now - taken
        self._compare(offset, now)
        if taken <= self._last_taken or offset < self._offset:  # the device's clock was reset, or the delay is smaller
            self._offset = offset
        else:
            self._offset += (offset - self._offset) * (1 - math.exp((self._last_taken - taken) / _RISE_SECONDS))
        self._last_taken = taken
        self._last_moment = max(self._last_moment, min(now, taken + self._offset) if self.trusted else now)
        return self._last_moment

    @property
    def rate(self) -> float | None:
        """Seconds of the device's clock per second, rounded to 0.01, if that makes the clock useless; else None."""
        if len(self._drifts) == SPAN_COUNT and (min(self._drifts) > MAX_DRIFT or max(self._drifts) < -MAX_DRIFT):
            return round(1 - sorted(self._drifts)[SPAN_COUNT // 2], 2) + 0.0  # turns −0 into 0
        return None

    def _compare(self, offset: float, now: float) -> None:
        """Compare the clocks at the end of each span."""
        if math.isnan(self._span_start):
            self._span_start = now
        if now - self._span_start >= SPAN_SECONDS:
            (smallest, when), (previous, earlier) = self._smallest, self._previous
            if previous < math.inf:
                self._drifts.append((smallest - previous) / max(when - earlier, SPAN_SECONDS))
                if self.rate is not None:
                    self.trusted = False
                elif not self.trusted and abs(self._drifts[-1]) <= MAX_DRIFT:
                    self.trusted, self._offset = True, smallest
            self._span_start, self._previous, self._smallest = now, self._smallest, (math.inf, math.nan)
        self._smallest = min(self._smallest, (offset, now))
