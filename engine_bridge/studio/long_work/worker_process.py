"""The process of a `Worker`: reads tasks from standard input until that is closed, and writes their outcomes."""

import json
import os
import pickle
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from typing import Any, BinaryIO

from engine_bridge.studio.long_work import tasks
from engine_bridge.studio.long_work.worker import LENGTH, broken
from puppetline.compiling import reported
from puppetline.errors import PuppetlineError


def main() -> None:
    """Run tasks until the studio ends."""
    if hasattr(os, "nice"):
        os.nice(5)  # the stream has priority
    outcomes = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with the outcomes
    requests = sys.stdin.buffer
    while length := requests.read(LENGTH.size):
        task, arguments = pickle.loads(requests.read(*LENGTH.unpack(length)))  # noqa: S301 - the studio wrote it
        _send(outcomes, *_outcome(getattr(tasks, task), outcomes, arguments))
        if task in tasks.AFTERWARDS:
            with suppress(Exception):  # the task that needs it says what is wrong
                tasks.AFTERWARDS[task](lambda *_: None, *arguments)


def _outcome(task: Callable[..., Any], outcomes: BinaryIO, arguments: tuple[Any, ...]) -> tuple[str, Any]:
    def progress(step: str, share: float) -> None:
        _send(outcomes, "progress", (step, share))

    try:
        with reported(lambda count: progress(f"Compiling, once on this machine: {count} functions so far", 0.0)):
            return "result", task(progress, *arguments)
    except PuppetlineError as error:
        return "error", error.parts
    except MemoryError:
        return "error", broken("too little memory", "a smaller file").parts
    except Exception as error:
        traceback.print_exc()
        return "error", broken(f"an internal error ({type(error).__name__}: {error})"[:300], "a result").parts


def _send(outcomes: BinaryIO, kind: str, value: Any) -> None:
    body = json.dumps([kind, value]).encode()
    outcomes.write(LENGTH.pack(len(body)) + body)
    outcomes.flush()


if __name__ == "__main__":
    main()
