"""A source that is opened again when it fails: until it is there, time goes on and nobody is."""

import logging
import math
import time
from collections.abc import Callable

from capture.events import Event, Tick
from capture.source import SilentSource, SkeletonSource

RETRY_SECONDS = 0.5
"""Seconds between attempts to open a source that has failed."""

log = logging.getLogger(__name__)


class ReopeningSource:
    """Stands before a source that may fail and come back; implements `capture.source.SkeletonSource`.

    Its `receive` never raises. Trouble is logged once, and its end when something comes.

    Parameters
    ----------
    name : str
        The URI.
    opener : callable
        Opens the source: now, and again whenever it has failed.

    Attributes
    ----------
    name, counts, recorded
        As of the source. A recording that has ended is not opened again.
    inner : SkeletonSource
        What is open now, or the `SilentSource` in its place.
    failure : str
        Why nothing comes; empty once something does.

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
        self._counted = 0  # until trouble came
        self.failure = ""

    def fileno(self) -> int | None:
        """Return what becomes readable now; it is another one when the source was opened again, and None between."""
        return self.inner.fileno()

    def due(self) -> float:
        """Return when something is due: of the source, or to open it again."""
        return min(self.inner.due(), self._reopen_at)

    def now(self) -> float:
        """Return the time on the source's clock, which goes on in silence."""
        return self.inner.now()

    def receive(self) -> list[Event]:
        """Return what has come, or ticks in silence."""
        if time.monotonic() >= self._reopen_at:
            self._reopen()
        try:
            events = self.inner.receive()
        except Exception as error:  # a device that fails in its own way is a device that is gone
            self._go_silent(error)
            return []
        something = self.counts.received > self._counted or any(not isinstance(each, Tick) for each in events)
        if self.failure and something:
            self.failure = ""
            log.info("the source is back", extra=self._fields())
        return events

    def close(self) -> None:
        """Let go of the source; closing again does nothing."""
        self.inner.close()

    def _go_silent(self, error: Exception) -> None:
        self._say("the source is silent", error)
        silence = SilentSource(self.name, self.counts, self.inner.now())
        self.inner.close()
        self.inner, self._counted = silence, self.counts.received
        if not self.recorded:
            self._reopen_at = time.monotonic() + RETRY_SECONDS

    def _reopen(self) -> None:
        try:
            source = self._opener()
        except Exception as error:
            self._say("the source cannot be opened", error)
            self._reopen_at = time.monotonic() + RETRY_SECONDS
            return
        source.counts.add(self.counts)
        self.inner, self.counts, self._reopen_at = source, source.counts, math.inf

    def _say(self, what: str, error: Exception) -> None:
        """Log why nothing comes, and not again with each attempt."""
        if str(error) != self.failure:
            self.failure = str(error)
            log.warning("%s: %s", what, error, extra=self._fields())

    def _fields(self) -> dict[str, dict[str, str]]:
        """Return what the live service's logs print beside the words."""
        return {"fields": {"source": self.name}}
