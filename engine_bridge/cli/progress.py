"""Progress bars, and interrupts that are not lost."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from puppetline.interrupts import repeated_interrupts

Reporter = Callable[[str, float], None]

COMPILING = "Compiling, once"
"""Step during which functions are compiled; the number of those that are ready follows."""


@contextmanager
def interrupts() -> Iterator[Callable[[], None]]:
    """Record Ctrl-C, and yield a function that raises it again.

    Python loses an interrupt in a destructor, in a callback of a C library or at the edge of a compiled loop.
    """
    pressed: list[int] = []

    def remember(number: int, _frame: object) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    def check() -> None:
        if pressed:
            raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, remember)
    try:
        with repeated_interrupts():
            yield check
    except Exception:
        check()  # compiled code, and a module that is being loaded, turn an interrupt into another error
        raise
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def progress() -> Iterator[Reporter]:
    """Yield a function that shows a step and its done share: a bar on a terminal, nothing elsewhere."""
    with interrupts() as check:
        if not sys.stderr.isatty():
            yield lambda _step, _share: check()
            return
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

        from puppetline.compiling import reported

        columns = (TextColumn("{task.description:24}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
        tasks: dict[str, Any] = {}
        with Progress(*columns, console=Console(stderr=True), transient=True) as bars:

            def report(step: str, share: float) -> None:
                check()
                if step not in tasks:
                    tasks[step] = bars.add_task(step, total=1.0)
                bars.update(tasks[step], completed=share)

            def compiling(count: int) -> None:
                if COMPILING not in tasks:
                    tasks[COMPILING] = bars.add_task("", total=None)
                bars.update(tasks[COMPILING], description=f"{COMPILING}: {count}")

            with reported(compiling):
                yield report
