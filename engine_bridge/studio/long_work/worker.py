"""A process for tasks that take long.

The stream is not delayed meanwhile, and a file that crashes a library ends only the task that reads it.

A worker runs one task after another. It is started when it is needed, and again after it has died; cancelling a task
ends it. A task is a function of the module `tasks`. It is called with a function for progress and with
arguments that can be pickled, and returns JSON's types. After some tasks, the worker does what is probably needed next.
"""

import asyncio
import json
import os
import pickle
import struct
import sys
from collections.abc import Callable
from typing import Any

from puppetline.errors import PuppetlineError, ServiceError
from puppetline.interrupts import OWN_GROUP

MODULE = "engine_bridge.studio.long_work.worker_process"
"""Program of the process."""

MAX_SECONDS = 1800.0
"""Maximum duration of a task in seconds."""

LENGTH = struct.Struct("<Q")
"""Layout of the length in bytes that precedes each message in both directions."""

Progress = Callable[[str, float], None]


class Worker:
    """Runs tasks in a process of its own, one at a time."""

    def __init__(self) -> None:
        self._turn = asyncio.Lock()
        self._process: asyncio.subprocess.Process | None = None

    async def run(
        self, task: str, *arguments: Any, progress: Progress | None = None, seconds: float = MAX_SECONDS
    ) -> Any:
        """Run a task and return its result.

        Parameters
        ----------
        task : str
            Name of the function.
        *arguments
        progress : callable, optional
            Called in the event loop with the present step and the share of it that is done.
        seconds : float
            Maximum duration, after which the process is ended.

        Raises
        ------
        PuppetlineError
            The task's own error, or the task crashed the process or took too long.
        """
        async with self._turn:
            try:
                async with asyncio.timeout(seconds):
                    return await self._run(pickle.dumps((task, arguments)), progress)
            except TimeoutError as error:
                await self.close()
                raise broken(f"no result after {seconds:g} s", "a file that takes less time") from error
            except asyncio.CancelledError:
                await self.close()
                raise
            except (asyncio.IncompleteReadError, OSError) as error:
                await self.close()
                raise broken("a crash of the program that reads the file", "a file that can be read") from error

    async def get_ready(self) -> None:
        """Start the process, so that the first task begins sooner."""
        async with self._turn:
            await self._started()

    async def close(self) -> None:
        """End the process; closing again does nothing."""
        process, self._process = self._process, None
        if process is not None and process.returncode is None:
            process.kill()
            await process.wait()

    async def _run(self, request: bytes, progress: Progress | None) -> Any:
        process = await self._started()
        assert process.stdin is not None  # noqa: S101 - pipes were asked for
        assert process.stdout is not None  # noqa: S101
        process.stdin.write(LENGTH.pack(len(request)) + request)
        await process.stdin.drain()
        while True:
            (length,) = LENGTH.unpack(await process.stdout.readexactly(LENGTH.size))
            kind, value = json.loads(await process.stdout.readexactly(length))
            if kind == "progress":
                if progress is not None:
                    progress(*value)
            elif kind == "error":
                raise PuppetlineError(**value)
            else:
                return value

    async def _started(self) -> asyncio.subprocess.Process:
        if self._process is None or self._process.returncode is not None:
            self._process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                MODULE,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                env={"OPENBLAS_NUM_THREADS": "1", **os.environ},  # as `puppetline.__main__`, for the same results
                **OWN_GROUP,  # Ctrl-C goes to the server, which then ends this process
            )
        return self._process


def broken(found: str, expected: str) -> ServiceError:
    """Return the error for a task that failed for a reason other than an error of the user."""
    return ServiceError("the work", found=found, expected=expected, fix="Try again; if it fails again, report it.")
