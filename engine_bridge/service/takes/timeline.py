"""The one clock of all takes that play."""

import math


class Timeline:
    """A position in seconds that runs, waits or jumps.

    All moments are those of `puppetline.clock`.

    Attributes
    ----------
    start, end : float
        Positions of the first and last frame of all takes.
    speed : float
        Seconds of the timeline per second.
    loop : bool
        Whether it continues at `start` after `end`.
    paused : bool
    """

    def __init__(self) -> None:
        self.start = self.end = 0.0
        self.speed, self.loop, self.paused = 1.0, False, False
        self._position, self._since = 0.0, 0.0

    def position(self, now: float) -> float:
        """Return the position at a moment."""
        return self._position if self.paused else self._position + self.speed * max(0.0, now - self._since)

    def moment(self, position: float) -> float:
        """Return the moment at which a position is reached, or was; infinity while it is paused."""
        return math.inf if self.paused else self._since + (position - self._position) / self.speed

    def stands(self, now: float) -> bool:
        """Tell whether the position does not change now."""
        return self.paused or now < self._since

    def move(self, position: float, moment: float) -> None:
        """Be at a position at a moment, which may be later, and wait there until then."""
        self._position, self._since = position, moment

    def pause(self, on: bool, now: float) -> None:
        """Stop, or continue."""
        self.move(self.position(now), now)
        self.paused = on

    def set_speed(self, speed: float, now: float) -> None:
        """Continue at another speed."""
        self.move(self.position(now), now)
        self.speed = speed
