"""What systemd wants to know of a service with ``Type=notify`` (sd_notify(3)): a datagram for each, nothing else.

Nothing happens where there is no systemd, that is without NOTIFY_SOCKET in the environment.
"""

import math
import os
import socket
import time
from contextlib import suppress

_MICROSECOND = 1e-6


class Notifier:
    """Tells systemd how the service is; it never waits and never fails.

    Raises
    ------
    OSError
        No socket is left for this process.
    """

    def __init__(self) -> None:
        address = os.environ.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setblocking(False)
        self._interval = _watchdog_interval()
        self._fed_at = -math.inf
        self._fed_frames = 0

    def ready(self) -> None:
        """Say that the service is up, at the start and after reloading."""
        self._tell("READY=1")

    def status(self, text: str) -> None:
        """Say how it is, in one line for ``systemctl status``."""
        self._tell("STATUS=" + " ".join(text.split()))

    def reloading(self) -> None:
        """Say that puppet files are read again; `ready` says that it is done."""
        self._tell(f"RELOADING=1\nMONOTONIC_USEC={time.monotonic_ns() // 1000}")

    def stopping(self) -> None:
        """Say that the end has begun."""
        self._tell("STOPPING=1")

    def watchdog(self, frames: int) -> None:
        """Keep the watchdog quiet, if there is one and the service has got on since the last time.

        Parameters
        ----------
        frames : int
            How many events the service has processed since it started, ticks among them: a source that is silent gives
            ticks, and a service that hangs processes none.
        """
        now = time.monotonic()
        if self._interval is not None and frames > self._fed_frames and now - self._fed_at >= self._interval:
            self._tell("WATCHDOG=1")
            self._fed_at, self._fed_frames = now, frames

    def close(self) -> None:
        """Let go of the socket. Closing again does nothing."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _tell(self, message: str) -> None:
        if self._socket is not None:
            with suppress(OSError):  # systemd is being started anew, or its queue is full: it hears the next one
                self._socket.sendto(message.encode(), self._address)


def _watchdog_interval() -> float | None:
    """Return half of the time after which systemd loses its patience, seconds; None without a watchdog."""
    allowed = os.environ.get("WATCHDOG_USEC", "")
    for_us = os.environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
    return int(allowed) * _MICROSECOND / 2 if allowed.isdecimal() and for_us else None
