"""The clock of everything that waits: when something is due, how old it is, when to try again.

Its times are seconds that never decrease, counted from an arbitrary moment. It is the machine's clock unless `use`
gives another. All threads have the same clock, because sources, sounds, stages and outputs compare their times. What
runs in an event loop of asyncio takes the time of the loop.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

_Result = TypeVar("_Result")


class Clock(Protocol):
    """What tells the time and decides how long a wait takes."""

    def now(self) -> float:
        """Return the time in seconds."""

    def wall(self) -> float:
        """Return the date and time as seconds since 1970, which the user may set back."""

    def block(self, until: float, wait: Callable[[float], _Result]) -> _Result:
        """Wait for something that may happen before a time; see `puppetline.clock.block`."""


class MachineClock:
    """The machine's own clock."""

    def now(self) -> float:
        """Return the time in seconds."""
        return time.monotonic()

    def wall(self) -> float:
        """Return the date and time as seconds since 1970."""
        return time.time()

    def block(self, until: float, wait: Callable[[float], _Result]) -> _Result:
        """Call `wait` with the number of seconds that are left."""
        return wait(max(0.0, until - self.now()))


_clock: Clock = MachineClock()


@contextmanager
def use(clock: Clock) -> Iterator[None]:
    """Replace the clock of this process until the end of the block."""
    global _clock
    before, _clock = _clock, clock
    try:
        yield
    finally:
        _clock = before


def now() -> float:
    """Return the time in seconds."""
    return _clock.now()


def now_ns() -> int:
    """Return the time in nanoseconds."""
    return int(1e9 * _clock.now())


def wall() -> float:
    """Return the date and time as seconds since 1970."""
    return _clock.wall()


def block(until: float, wait: Callable[[float], _Result]) -> _Result:
    """Wait for something that may happen before a time.

    Parameters
    ----------
    until : float
        Time at which to return at the latest, in seconds of this clock; infinity is allowed if `wait` allows it.
    wait : callable
        Waits for at most the given number of seconds, and returns something true if what it waits for has happened.

    Returns
    -------
    object
        What `wait` returned.
    """
    return _clock.block(until, wait)


def sleep_until(moment: float) -> None:
    """Wait until a time."""
    block(moment, time.sleep)
