"""A source that is opened again after a failure; in the meantime, time passes without a performer."""

import logging
import math
from collections.abc import Callable

from capture.events import Event, Tick
from capture.source import SilentSource, SkeletonSource
from puppetline import clock

RETRY_SECONDS = 0.5
"""Interval between attempts to open a source that has failed."""

log = logging.getLogger(__name__)


class ReopeningSource:
    """A source that may fail and is then opened again; implements `capture.source.SkeletonSource`.

    Its `receive` never raises. A failure is logged once, and so is its end, when an event arrives.

    Parameters
    ----------
    name : str
        The URI.
    opener : callable
        Function that opens the source, now and after each failure.

    Attributes
    ----------
    name, counts, recorded
        Those of the open source. A recording that has ended is not opened again.
    inner : SkeletonSource
        The open source, or the `SilentSource` in its place.
    failure : str
        Message of the last failure; empty once an event arrives.

    Raises
    ------
    PuppetlineError
        The source cannot be opened now.
    """

    def __init__(self, name: str, opener: Callable[[], SkeletonSource]) -> None:
        self.name = name
        self.inner = opener()
        self.counts = self.inner.counts
        self.recorded = self.inner.recorded
        self._opener = opener
        self._reopen_at = math.inf
        self._counted = 0  # received before the last failure
        self.failure = ""

    def fileno(self) -> int | None:
        """Return the present file descriptor, which changes when the source is opened again and may be None."""
        return self.inner.fileno()

    def due(self) -> float:
        """Return the time at which the source or the next attempt to open it is due."""
        return min(self.inner.due(), self._reopen_at)

    def now(self) -> float:
        """Return the time on the source's clock, which continues after a failure."""
        return self.inner.now()

    def receive(self) -> list[Event]:
        """Return the source's events, or ticks after a failure."""
        if clock.now() >= self._reopen_at:
            self._reopen()
        try:
            events = self.inner.receive()
        except Exception as error:  # devices fail with errors of any class
            self._go_silent(error)
            return []
        has_input = self.counts.received > self._counted or any(not isinstance(each, Tick) for each in events)
        if self.failure and has_input:
            self.failure = ""
            log.info("the source is back", extra=self._fields())
        return events

    def close(self) -> None:
        """Close the source; closing again does nothing."""
        self.inner.close()

    def _go_silent(self, error: Exception) -> None:
        self._log_failure("the source is silent", error)
        silence = SilentSource(self.name, self.counts, self.inner.now())
        self.inner.close()
        self.inner, self._counted = silence, self.counts.received
        if not self.recorded:
            self._reopen_at = clock.now() + RETRY_SECONDS

    def _reopen(self) -> None:
        try:
            source = self._opener()
        except Exception as error:
            self._log_failure("the source cannot be opened", error)
            self._reopen_at = clock.now() + RETRY_SECONDS
            return
        source.counts.add(self.counts)
        self.inner, self.counts, self._reopen_at = source, source.counts, math.inf

    def _log_failure(self, what: str, error: Exception) -> None:
        """Log a failure, unless it repeats the last one."""
        if str(error) != self.failure:
            self.failure = str(error)
            log.warning("%s: %s", what, error, extra=self._fields())

    def _fields(self) -> dict[str, dict[str, str]]:
        """Return the additional fields of the service's log messages."""
        return {"fields": {"source": self.name}}
