"""Signals of the operating system: stop and reload."""

import contextlib
import signal
import socket
from types import FrameType
from typing import Self

from puppetline.interrupts import repeated_interrupts


class Signals:
    """Handles SIGTERM, SIGINT, SIGHUP and SIGBREAK while it is entered; its file descriptor is readable after a signal.

    A handler only sets a flag, because it may interrupt any code. While `waiting` is false, as during the start of the
    service, the first two raise KeyboardInterrupt instead. Enter it in the main thread.

    Attributes
    ----------
    stop : bool
        SIGTERM, SIGINT or SIGBREAK was received.
    waiting : bool
        Whether the program checks `stop`; set by the program.
    """

    def __init__(self) -> None:
        self.stop = self.waiting = False
        self._reload = self._discarded = False
        self._undo = contextlib.ExitStack()

    def __enter__(self) -> Self:
        self._woken, wake = socket.socketpair()
        for end in (self._woken, wake):
            end.setblocking(False)
            self._undo.callback(end.close)
        before = signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
        self._undo.callback(signal.set_wakeup_fd, before)
        for name, handler in (
            ("SIGTERM", self._end),
            ("SIGINT", self._end),
            ("SIGBREAK", self._end),
            ("SIGHUP", self._again),
        ):
            number = getattr(signal, name, None)  # Windows has SIGBREAK instead of SIGHUP
            if number is not None:
                self._undo.callback(signal.signal, number, signal.signal(number, handler))
        self._undo.enter_context(repeated_interrupts(self._discard))
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._undo.close()
        if kind is not None and self.stop and not self.waiting:
            raise KeyboardInterrupt  # a module that was being imported may have turned it into another error

    def fileno(self) -> int:
        """Return the file descriptor that is readable after a signal."""
        return self._woken.fileno()

    def take_reload(self) -> bool:
        """Return whether SIGHUP was received since the last call, and reset the file descriptor."""
        with contextlib.suppress(BlockingIOError):
            self._woken.recv(4096)
        asked, self._reload = self._reload, False
        return asked

    def _end(self, _number: int, _frame: FrameType | None) -> None:
        again, self.stop = self.stop and not self._discarded, True
        self._discarded = False
        if not self.waiting and not again:
            raise KeyboardInterrupt

    def _again(self, _number: int, _frame: FrameType | None) -> None:
        self._reload = True

    def _discard(self) -> None:
        self._discarded = True
