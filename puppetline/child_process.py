"""Child processes that end with the process that started them, however that ends."""

import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from puppetline import clock

VARIABLE = "PUPPETLINE_ENDS_WITH_INPUT"
"""Environment variable that tells a process to end when its standard input is closed."""

MIN_RETRY_SECONDS, MAX_RETRY_SECONDS = 0.25, 8.0
"""Shortest and longest time until a process that has ended is started again; it doubles while it ends soon."""

MAX_FAILURES = 20
"""How often in succession a process may end soon after its start, which takes more than two minutes."""

END_SECONDS = 5.0
"""Time that a process has to end by itself after its parent has ended, in seconds; then it is ended.

It is short, because the successor of the parent starts at the same time."""

log = logging.getLogger(__name__)

_called = threading.Event()


def processor_count() -> int:
    """Return the number of processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def bound_to_parent(environment: Mapping[str, str] = os.environ) -> dict[str, Any]:
    """Return options of a child process that calls `end_with_parent`, as `puppetline` does, and ends with this one.

    The system closes the pipe to its standard input when this process ends, even if it is killed. What this process
    writes into the pipe ends `wait_for_parent`.
    """
    return {"stdin": subprocess.PIPE, "env": {**environment, VARIABLE: "1"}}


def lower_priority(process_id: int, niceness: int) -> None:
    """Let other processes go before a child process, where the system has a niceness for it."""
    if sys.platform != "win32":
        os.setpriority(os.PRIO_PROCESS, process_id, niceness)


@contextmanager
def kept_running(command: Sequence[str], environment: Mapping[str, str] = os.environ) -> Iterator[None]:
    """Run a command that writes to this process's outputs until the block ends; start it again when it ends.

    After `MAX_FAILURES` starts that fail soon, it is not started again.
    """
    changing, over = threading.Lock(), threading.Event()

    def start() -> subprocess.Popen[bytes]:
        bound = bound_to_parent(environment)
        return subprocess.Popen(command, stdout=sys.stdout, stderr=sys.stderr, **bound)  # noqa: S603

    def keep() -> None:
        failures = 0
        while failures < MAX_FAILURES:
            began = clock.now()
            running[0].wait()  # returns immediately while the process cannot be started
            failures = 0 if clock.now() - began > MAX_RETRY_SECONDS else failures + 1
            over.wait(min(MIN_RETRY_SECONDS * 2**failures, MAX_RETRY_SECONDS))
            with changing:
                if over.is_set():
                    return
                try:
                    running[0] = start()
                except OSError as error:
                    log.warning("a process cannot be started: %s", error)
        log.error("a process is not started again: it has ended %d times soon after its start", failures)

    running = [start()]
    keeper = threading.Thread(target=keep, daemon=True)
    keeper.start()
    try:
        yield
    finally:
        with changing:
            over.set()
            running[0].terminate()
        keeper.join()


def end_with_parent() -> None:
    """Ask this process to end as soon as its parent has, if it was started with `bound_to_parent`."""
    if os.environ.pop(VARIABLE, None):  # it is not meant for children of this process
        threading.Thread(target=_wait_for_end, daemon=True).start()


def wait_for_parent() -> None:
    """Wait until the parent writes to this process, which was started with `bound_to_parent`."""
    _called.wait()


def _wait_for_end() -> None:
    while os.read(0, 1024):
        _called.set()
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(END_SECONDS)
    os._exit(1)
