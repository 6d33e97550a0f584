"""What was refused: counted always, logged once a second at most."""

import logging
import math
from collections import Counter

LOG = logging.getLogger(__name__)
INTERVAL = 1.0
"""Seconds between two lines of the log."""


class Refusals:
    """Counts by reason, and says in the log how many more there were.

    Parameters
    ----------
    source : str
        The name to log.
    counts : Counter
        By reason; added to.
    """

    def __init__(self, source: str, counts: Counter[str]) -> None:
        self._source = source
        self._counts = counts
        self._unsaid: Counter[str] = Counter()
        self._said = -math.inf

    def add(self, reason: str) -> None:
        """Count one. Reasons are a closed set: nothing that came from outside is logged."""
        self._counts[reason] += 1
        self._unsaid[reason] += 1

    def report(self, now: float) -> None:
        """Log what was refused since the last report, unless that was less than `INTERVAL` ago."""
        if not self._unsaid or now - self._said < INTERVAL:
            return
        reasons = ", ".join(f"{count} × {reason}" for reason, count in self._unsaid.most_common())
        LOG.warning("%s: refused %s", self._source, reasons)
        self._unsaid.clear()
        self._said = now
