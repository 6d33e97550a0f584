"""Interrupts that Python would lose."""

import contextlib
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

if sys.platform == "win32":
    OWN_GROUP: dict[str, Any] = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    END = signal.CTRL_BREAK_EVENT
else:
    OWN_GROUP: dict[str, Any] = {"start_new_session": True}
    END = signal.SIGTERM
"""Options of a child process that Ctrl-C does not reach, and the signal that asks it to end."""

REPEAT_SECONDS = 0.01
"""Time after which an interrupt that was discarded is raised again, in seconds."""


@contextlib.contextmanager
def repeated_interrupts(discarded: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Raise a KeyboardInterrupt again that a callback has discarded.

    Python prints and discards an exception in a callback of a C library, as of LLVM while Numba compiles, and in one of
    its own, as after each import. Enter it in the main thread.

    Parameters
    ----------
    discarded : callable
        Called when an interrupt was discarded, before SIGINT is raised again.
    """
    before, over = sys.unraisablehook, threading.Event()

    def repeat(unraisable: "sys.UnraisableHookArgs") -> None:
        if unraisable.exc_type is not KeyboardInterrupt:
            before(unraisable)
            return
        discarded()
        in_hook = threading.Lock()
        with in_hook:  # an interrupt before the end of this function would be lost
            threading.Thread(target=interrupt, args=[in_hook], daemon=True).start()

    def interrupt(after: threading.Lock) -> None:
        with after:
            pass
        if not over.wait(REPEAT_SECONDS):
            signal.raise_signal(signal.SIGINT)

    sys.unraisablehook = repeat
    try:
        yield
    finally:
        sys.unraisablehook = before
        over.set()
