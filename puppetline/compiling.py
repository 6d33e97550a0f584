"""What happens while Numba compiles, which takes half a minute the first time on a machine."""

import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

when_begun: list[Callable[[], None]] = []
"""Functions that are called once, when this process first needs a function that is not compiled, by the thread that
needs it."""

others: list[subprocess.Popen[bytes]] = []
"""Processes that compile what this one needs late."""


def begin() -> None:
    """Call what is called when the first function must be compiled."""
    while when_begun:
        when_begun.pop()()


def is_compiled_elsewhere() -> bool:
    """Return whether another process compiles for this one."""
    return any(process.poll() is None for process in others)


@contextmanager
def reported(report: Callable[[int], None]) -> Iterator[None]:
    """Call a function with the number of functions compiled so far, whenever one has been; not for cached ones.

    Parameters
    ----------
    report : callable
        Called in the thread that compiles.
    """
    from numba.core import event

    class Listener(event.Listener):  # type: ignore[misc]
        def __init__(self) -> None:
            self._done = self._depth = 0

        def on_start(self, _: Any) -> None:
            self._depth += 1

        def on_end(self, _: Any) -> None:
            self._depth -= 1
            if self._depth == 0:  # those that it calls are compiled meanwhile
                self._done += 1
                report(self._done)

    with event.install_listener("numba:compile", Listener()):
        yield
