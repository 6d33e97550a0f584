"""Counting and logging of refused packets."""

import logging
import math
from collections import Counter

log = logging.getLogger(__name__)
REPORT_INTERVAL_SECONDS = 1.0
"""Minimum time between two log messages."""


class Refusals:
    """Counts refused packets by reason, and logs new ones at most once per second.

    Parameters
    ----------
    source : str
        Name of the source in the log.
    counts : Counter
        Counts by reason, which are increased.
    """

    def __init__(self, source: str, counts: Counter[str]) -> None:
        self._source = source
        self._counts = counts
        self._unreported: Counter[str] = Counter()
        self._last_report = -math.inf

    def add(self, reason: str) -> None:
        """Count a refusal. Reasons are a closed set, so no received data is logged."""
        self._counts[reason] += 1
        self._unreported[reason] += 1

    def report(self, now: float) -> None:
        """Log the refusals since the last report, if it was at least `REPORT_INTERVAL_SECONDS` ago."""
        if not self._unreported or now - self._last_report < REPORT_INTERVAL_SECONDS:
            return
        reasons = ", ".join(f"{count} × {reason}" for reason, count in self._unreported.most_common())
        log.warning("%s: refused %s", self._source, reasons)
        self._unreported.clear()
        self._last_report = now
