"""When pictures were taken, on our clock: from a device's own times, and from when its pictures came.

The quickest pictures on their way set the difference between the two clocks. It falls at once and rises slowly, so that
neither a picture that came late nor a clock that runs a little slow moves it far.

Whether a device's clock can be used at all is seen by the quickest pictures of one span of time and the next: the
difference stays. Until that was seen, pictures are taken to be of the moment at which they come; and so they are again
where the device's clock runs too slow or too fast for several spans, stands still, or counts in another unit.
"""

import math
from collections import deque

SPAN = 1.0
"""Seconds whose quickest picture is compared with that of the seconds before."""
OFF = 0.02
"""Seconds a second by which a device's clock may be slow or fast; crystals are a thousand times better."""
SPANS = 3
"""Spans in a row that tell that it is slower or faster than that: anything may delay pictures for one."""

_EASE = 2.0  # seconds in which a longer difference is taken over


class DeviceClock:
    """Brings a device's times to our clock.

    Attributes
    ----------
    trusted : bool
        Whether the device's own times are used.
    """

    def __init__(self) -> None:
        self.trusted = False
        self._taken = math.inf  # of the picture before, on the device's clock
        self._moment = -math.inf  # and on ours
        self._ahead = 0.0  # seconds by which our clock is
        self._begun = math.nan  # of the span
        self._quickest = self._before = math.inf, math.nan  # difference in this span and the one before, and when
        self._losses: deque[float] = deque(maxlen=SPANS)  # seconds a second that the device's clock lost, by span

    def moment(self, taken: float, now: float) -> float:
        """Return when a picture was taken: not after `now`, and not before the picture before.

        Parameters
        ----------
        taken, now : float
            Seconds on the device's clock, and on ours when the picture came.
        """
        ahead = now - taken
        self._judge(ahead, now)
        if taken <= self._taken or ahead < self._ahead:  # the device's clock was set anew, or this one was quicker
            self._ahead = ahead
        else:
            self._ahead += (ahead - self._ahead) * (1 - math.exp((self._taken - taken) / _EASE))
        self._taken = taken
        self._moment = max(self._moment, min(now, taken + self._ahead) if self.trusted else now)
        return self._moment

    @property
    def pace(self) -> float | None:
        """Seconds, to a hundredth, that pass on the device's clock in one of ours, where that makes it useless."""
        if len(self._losses) == SPANS and (min(self._losses) > OFF or max(self._losses) < -OFF):
            return round(1 - sorted(self._losses)[SPANS // 2], 2) + 0.0  # and not −0
        return None

    def _judge(self, ahead: float, now: float) -> None:
        """Compare the clocks at the end of each span."""
        if math.isnan(self._begun):
            self._begun = now
        if now - self._begun >= SPAN:
            (quickest, when), (before, earlier) = self._quickest, self._before
            if before < math.inf:
                self._losses.append((quickest - before) / max(when - earlier, SPAN))
                if self.pace is not None:
                    self.trusted = False
                elif not self.trusted and abs(self._losses[-1]) <= OFF:
                    self.trusted, self._ahead = True, quickest
            self._begun, self._before, self._quickest = now, self._quickest, (math.inf, math.nan)
        self._quickest = min(self._quickest, (ahead, now))
