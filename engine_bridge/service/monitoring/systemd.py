"""Notifications to systemd from a service with ``Type=notify`` (sd_notify(3)), one datagram each.

Without systemd, that is without NOTIFY_SOCKET in the environment, nothing is sent.
"""

import math
import os
import socket
import sys
from contextlib import suppress

from puppetline import clock

_MICROSECOND = 1e-6


class Notifier:
    """Notifies systemd of the state of the service; it never waits and never fails.

    Raises
    ------
    OSError
        No socket is left for this process.
    """

    def __init__(self) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        if sys.platform != "win32" and self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
        self._interval = _watchdog_interval()
        self._fed_at = -math.inf
        self._fed_frames = 0

    def ready(self) -> None:
        """Report that the service is ready, at the start and after reloading."""
        self._send("READY=1")

    def status(self, text: str) -> None:
        """Report one line of text for ``systemctl status``."""
        self._send("STATUS=" + " ".join(text.split()))

    def reloading(self) -> None:
        """Report that puppet files are being read again; `ready` reports the end."""
        self._send(f"RELOADING=1\nMONOTONIC_USEC={clock.now_ns() // 1000}")

    def stopping(self) -> None:
        """Report that the service is stopping."""
        self._send("STOPPING=1")

    def watchdog(self, frames: int) -> None:
        """Notify the watchdog, if there is one, when the service has processed events since the last time.

        Parameters
        ----------
        frames : int
            Number of events processed since the start. A source without performers emits ticks, so that the number
            rises unless the service hangs.
        """
        now = clock.now()
        if self._interval is not None and frames > self._fed_frames and now - self._fed_at >= self._interval:
            self._send("WATCHDOG=1")
            self._fed_at, self._fed_frames = now, frames

    def close(self) -> None:
        """Close the socket. Closing again does nothing."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, message: str) -> None:
        if self._socket is not None:
            with suppress(OSError):  # systemd restarts, or its queue is full: the next notification will arrive
                self._socket.sendto(message.encode(), self._address)


def _watchdog_interval() -> float | None:
    """Return half of the watchdog's time limit, in seconds; None without a watchdog."""
    allowed = os.environ.get("WATCHDOG_USEC", "")
    for_us = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    return int(allowed) * _MICROSECOND / 2 if allowed.isdecimal() and for_us else None
