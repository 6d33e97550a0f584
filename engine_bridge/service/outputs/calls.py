"""Calls that other threads request and that are made in the service's loop."""

import contextlib
import socket
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future

CALLS_PER_TURN = 256
"""Number of calls made before frames are sent again."""


class Calls:
    """Collects calls from other threads; its file descriptor is readable while some wait."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Callable[[], None], Future[None]]] = deque()
        self._readable, self._writable = socket.socketpair()
        for end in (self._readable, self._writable):
            end.setblocking(False)

    def fileno(self) -> int:
        """Return the file descriptor to poll for reading."""
        return self._readable.fileno()

    def ask(self, call: Callable[[], None]) -> "Future[None]":
        """Request a call, from any thread; the future is done when the call has returned or raised."""
        done: Future[None] = Future()
        self._waiting.append((call, done))
        self._wake()
        return done

    def make(self) -> None:
        """Make the calls that wait, up to `CALLS_PER_TURN`."""
        with contextlib.suppress(BlockingIOError):
            self._readable.recv(4096)
        for _ in range(CALLS_PER_TURN):
            if not self._waiting:
                return
            call, done = self._waiting.popleft()
            if done.set_running_or_notify_cancel():
                try:
                    call()
                except Exception as error:
                    done.set_exception(error)
                else:
                    done.set_result(None)
        self._wake()

    def close(self) -> None:
        """Cancel the calls that wait; no thread may ask for more."""
        while self._waiting:
            self._waiting.popleft()[1].cancel()
        self._readable.close()
        self._writable.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # enough bytes wait, or it is closed
            self._writable.send(b"\0")
