"""What the system asks of the service: to stop, or to reload."""

import contextlib
import signal
import socket
from types import FrameType
from typing import Self


class Signals:
    """Takes SIGTERM, SIGINT and SIGHUP as long as it is entered; its file descriptor is readable when one has come.

    A handler only takes note: it may run in the midst of anything. As long as nobody is `waiting` for `stop`, as while
    the service starts, the first two end whatever is being done. To be entered in the main thread.

    Attributes
    ----------
    stop : bool
        Somebody wants the end.
    waiting : bool
        Whether somebody looks at `stop`.
    """

    def __init__(self) -> None:
        self.stop = self.waiting = False
        self._reload = False
        self._undo = contextlib.ExitStack()

    def __enter__(self) -> Self:
        self._woken, wake = socket.socketpair()
        for end in (self._woken, wake):
            end.setblocking(False)
            self._undo.callback(end.close)
        before = signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
        self._undo.callback(signal.set_wakeup_fd, before)
        for name, handler in (("SIGTERM", self._end), ("SIGINT", self._end), ("SIGHUP", self._again)):
            number = getattr(signal, name, None)  # Windows has no SIGHUP
            if number is not None:
                self._undo.callback(signal.signal, number, signal.signal(number, handler))
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._undo.close()
        if kind is not None and self.stop and not self.waiting:
            raise KeyboardInterrupt  # a module that is being loaded makes any error of it

    def fileno(self) -> int:
        """Return what becomes readable when a signal has come."""
        return self._woken.fileno()

    def take_reload(self) -> bool:
        """Tell whether a reload was asked for since the last call, and be ready for the next signal."""
        with contextlib.suppress(BlockingIOError):
            self._woken.recv(4096)
        asked, self._reload = self._reload, False
        return asked

    def _end(self, _number: int, _frame: FrameType | None) -> None:
        again, self.stop = self.stop, True
        if not self.waiting and not again:
            raise KeyboardInterrupt

    def _again(self, _number: int, _frame: FrameType | None) -> None:
        self._reload = True
