"""Counting and logging of refused packets."""

import logging
import math
import re
from collections import Counter

log = logging.getLogger(__name__)
REPORT_INTERVAL_SECONDS = 1.0
"""Minimum time between two log messages."""

_PLAIN_ADDRESS = re.compile(r"[A-Za-z0-9_/.]{1,60}")
"""Addresses of messages that are safe to log."""
MAX_NAMED = 32
"""Maximum number of addresses that are named in the log."""


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
        self._named: dict[tuple[str, str], None] = {}
        self._unnamed: list[str] = []
        self._last_report = -math.inf

    def add(self, reason: str, address: str = "") -> None:
        """Count a refusal. Reasons are a closed set, and an address is logged once and only if it is plain."""
        self._counts[reason] += 1
        self._unreported[reason] += 1
        if (reason, address) not in self._named and len(self._named) < MAX_NAMED and _PLAIN_ADDRESS.fullmatch(address):
            self._named[reason, address] = None
            self._unnamed.append(f"{reason} in {address}")

    def report(self, now: float) -> None:
        """Log the refusals since the last report, if it was at least `REPORT_INTERVAL_SECONDS` ago."""
        if not self._unreported or now - self._last_report < REPORT_INTERVAL_SECONDS:
            return
        reasons = ", ".join(f"{count} × {reason}" for reason, count in self._unreported.most_common())
        named = f" (first: {', '.join(self._unnamed)})" if self._unnamed else ""
        log.warning("%s: refused %s%s", self._source, reasons, named)
        self._unreported.clear()
        self._unnamed.clear()
        self._last_report = now
