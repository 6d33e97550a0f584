"""The terminal as a screen: its alternate screen without a cursor, its size, and when it is ready for more."""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from queue import SimpleQueue
from select import select
from typing import Self

from rich.control import Control

ANSWERING = 3.0
"""Seconds after which a terminal that does not say that it is done is taken for one that never says so."""
LEAVING = 0.5
"""Seconds that the end waits for a terminal that is halted or slow."""

_ENTER = f"{Control.alt_screen(enable=True)}{Control.show_cursor(show=False)}"
_LEAVE = f"\x1b[0m{Control.show_cursor(show=True)}{Control.alt_screen(enable=False)}"
_DONE, _IS_DONE = b"\x1b[5n", b"\x1b[0n"  # "report your status", and the report, which comes after all before it
_GLANCE = 0.05  # seconds between looks whether it is over
_IN = 0


class Screen:
    """The terminal of the standard output, as long as it is entered.

    A thread writes, so that a terminal that is halted or slow halts nobody. After each view the terminal is asked
    whether it is done: over a slow line, what was written is far from being seen.

    Attributes
    ----------
    gone : bool
        Whether the terminal takes no more: it was closed, or at the end it was halted.
    """

    def __init__(self) -> None:
        self.gone = False
        self._out = sys.stdout.fileno()
        self._undo = ExitStack()
        self._thread = threading.Thread(target=self._run, name="screen", daemon=True)
        self._texts: SimpleQueue[str | None] = SimpleQueue()
        self._given = self._taken = 0  # texts
        self._left = False
        self._asks = os.isatty(_IN)
        self._open = 0  # questions to which there is no answer yet
        self._heard = b""

    def __enter__(self) -> Self:
        self._undo.enter_context(_silent_keyboard())
        self._undo.enter_context(_silent_errors(sys.stderr.fileno()))
        self._undo.callback(self._leave)
        self._thread.start()
        self.show(_ENTER)
        return self

    def __exit__(self, *_: object) -> None:
        self._undo.close()

    @property
    def ready(self) -> bool:
        """Whether all that was to be shown can be seen."""
        return self._taken == self._given

    @property
    def size(self) -> tuple[int, int]:
        """Columns and lines, which change as a window does."""
        try:
            columns, lines = os.get_terminal_size(self._out)
        except OSError:  # it is gone
            columns, lines = 0, 0
        return columns or 80, lines or 24

    def show(self, text: str) -> None:
        """Write a text with its control codes after those before it."""
        self._given += 1
        self._texts.put(text)

    def _leave(self) -> None:
        self._left = True
        self._texts.put(None)
        self._thread.join(LEAVING)
        self.gone |= self._thread.is_alive()

    def _run(self) -> None:
        try:
            while (text := self._texts.get()) is not None:
                self._write(text)
                give_up = time.monotonic() + ANSWERING
                while self._open and not self._left:
                    self._listen()
                    self._asks &= time.monotonic() < give_up
                    self._open *= self._asks
                self._taken += 1
            self._write(_LEAVE)
            give_up = time.monotonic() + LEAVING / 2
            while self._open and time.monotonic() < give_up:  # or the answer is taken for typed
                self._listen()
        except OSError:
            self.gone = True

    def _write(self, text: str) -> None:
        data = text.encode() + _DONE * self._asks
        self._open += self._asks
        while data:
            data = data[os.write(self._out, data) :]

    def _listen(self) -> None:
        """Take what has been typed, and answers."""
        if select([_IN], [], [], _GLANCE)[0]:
            self._heard += os.read(_IN, 1024)
            self._open -= self._heard.count(_IS_DONE)
            self._heard = self._heard.rpartition(_IS_DONE)[2]


@contextmanager
def _silent_keyboard() -> Iterator[None]:
    """Have the terminal not show what is typed, and give it at once; forget it at the end."""
    with ExitStack() as stack:
        with suppress(ImportError):  # of Windows
            import termios

            with suppress(termios.error):  # the input is no terminal
                before = termios.tcgetattr(_IN)
                silent = termios.tcgetattr(_IN)
                silent[3] &= ~(termios.ECHO | termios.ICANON)
                silent[6][termios.VSUSP] = b"\0"  # Ctrl-Z would leave the shell on this screen
                termios.tcsetattr(_IN, termios.TCSANOW, silent)
                stack.enter_context(suppress(termios.error))  # by then, the terminal may be gone
                stack.callback(termios.tcsetattr, _IN, termios.TCSANOW, before)
                stack.callback(termios.tcflush, _IN, termios.TCIFLUSH)
        yield


@contextmanager
def _silent_errors(descriptor: int) -> Iterator[None]:
    """Keep off the terminal what is written to the standard error; the view says what matters."""
    with ExitStack() as stack:
        if os.isatty(descriptor):
            before, nowhere = os.dup(descriptor), os.open(os.devnull, os.O_WRONLY)
            stack.callback(os.close, before)
            stack.callback(os.dup2, before, descriptor)
            os.dup2(nowhere, descriptor)
            os.close(nowhere)
        yield
