"""Child processes that end with the process that started them, however that ends."""

import os
import signal
import subprocess
import threading
import time
from collections.abc import Mapping
from typing import Any

VARIABLE = "PUPPETLINE_ENDS_WITH_INPUT"
"""Environment variable that tells a process to end when its standard input is closed."""

END_SECONDS = 10.0
"""Time that a process has to end by itself, in seconds."""


def bound_to_parent(environment: Mapping[str, str] = os.environ) -> dict[str, Any]:
    """Return options of a child process that runs `puppetline` and ends with this process.

    The system closes the pipe to its standard input when this process ends, even if it is killed.
    """
    return {"stdin": subprocess.PIPE, "env": {**environment, VARIABLE: "1"}}


def end_with_parent() -> None:
    """Ask this process to end as soon as its parent has, if it was started with `bound_to_parent`."""
    if os.environ.pop(VARIABLE, None):  # it is not meant for children of this process
        threading.Thread(target=_wait_for_end, daemon=True).start()


def _wait_for_end() -> None:
    while os.read(0, 1024):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
    time.sleep(END_SECONDS)
    os._exit(1)
