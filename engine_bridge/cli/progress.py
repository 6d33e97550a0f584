"""Progress bars and Ctrl-C."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Reporter = Callable[[str, float], None]


@contextmanager
def interrupts() -> Iterator[Callable[[], None]]:
    """Remember Ctrl-C, and give a check that raises it again.

    Python loses the interrupt where it falls into a destructor or the edge of a compiled loop.
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
        yield check
    except Exception:
        check()  # an interrupt comes out of compiled code, or of a module that is being loaded, as any error
        raise
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def progress() -> Iterator[Reporter]:
    """Show a bar for each stage on a terminal, and nothing elsewhere."""
    with interrupts() as check:
        if not sys.stderr.isatty():
            yield lambda _stage, _share: check()
            return
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

        columns = (TextColumn("{task.description:24}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
            tasks: dict[str, Any] = {}

            def report(stage: str, share: float) -> None:
                check()
                if stage not in tasks:
                    tasks[stage] = bars.add_task(stage, total=1.0)
                bars.update(tasks[stage], completed=share)

            yield report
