"""Runs jobs in worker processes on this machine."""

import multiprocessing
import signal
import sys
from collections import deque
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait

from engine_bridge.batch.conversion import MAX_STARTS, BatchSettings, Outcome, convert_job
from engine_bridge.batch.store import Job
from puppetline.errors import PuppetlineError

POLL_SECONDS = 0.25
"""Maximum time to wait for an outcome before `check` is called, in seconds."""

_CONTEXT = multiprocessing.get_context("spawn")


def convert_in_processes(
    jobs: Sequence[Job], batch: BatchSettings, count: int, check: Callable[[], None]
) -> Generator[Outcome, None, None]:
    """Convert jobs in worker processes, and yield each outcome as soon as it is known.

    A worker that is killed is replaced, and another one gets its job.

    Parameters
    ----------
    jobs : sequence of Job
    batch : BatchSettings
    count : int
        Number of processes, at least 1.
    check : callable
        Called often; raises an error to stop.

    Raises
    ------
    PuppetlineError
        See `engine_bridge.batch.conversion.convert_job`; also if workers end before they begin a job.
    """
    waiting, deaths = deque(jobs), 0
    workers = [_Worker(batch) for _ in range(min(count, len(jobs)))]
    try:
        while waiting or any(worker.job for worker in workers):
            for worker in workers:
                if worker.job is None and waiting:
                    worker.begin(waiting.popleft())
            check()
            ready = wait([worker.connection for worker in workers if worker.job], POLL_SECONDS)
            for index, worker in enumerate(workers):
                if worker.job is None or worker.connection not in ready:
                    continue
                outcome = worker.outcome()
                if outcome is not None:
                    deaths = 0
                    yield outcome
                    continue
                # a death of a worker that had begun a job is counted as a start of that job, see `Store.start`
                deaths += 1
                if deaths > (MAX_STARTS + 1) * len(workers):
                    raise _no_workers()
                waiting.appendleft(worker.job)
                worker.end()
                workers[index] = _Worker(batch)
    finally:
        for worker in workers:
            worker.end()


class _Worker:
    """A process that converts one job after another, and its present job."""

    def __init__(self, batch: BatchSettings) -> None:
        self.connection, theirs = _CONTEXT.Pipe()
        self._process = _CONTEXT.Process(target=_work, args=(theirs, batch), daemon=True)
        # the command handles Ctrl-C: a process inherits which signals are blocked, so none interrupts its start
        if sys.platform != "win32":
            resource_tracker.ensure_running()  # its own start unblocks the signal
            before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
        self._process.start()
        if sys.platform != "win32":
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
        theirs.close()
        self.job: Job | None = None

    def begin(self, job: Job) -> None:
        """Give the process a job."""
        self.job = job
        with suppress(OSError):  # it was killed: `outcome` finds that out
            self.connection.send(job)

    def outcome(self) -> Outcome | None:
        """Return the outcome of the job; None if the process was killed."""
        try:
            result: Outcome | PuppetlineError = self.connection.recv()
        except (EOFError, OSError):
            return None
        self.job = None
        if isinstance(result, PuppetlineError):
            raise result
        return result

    def end(self) -> None:
        """Kill the process."""
        self._process.kill()
        self._process.join()
        self.connection.close()


def _work(connection: Connection, batch: BatchSettings) -> None:
    """Convert jobs until the command ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # on Windows it is not blocked
    with suppress(EOFError, OSError):
        while True:
            job = connection.recv()
            try:
                connection.send(convert_job(job, batch))
            except PuppetlineError as error:
                connection.send(error)


def _no_workers() -> PuppetlineError:
    return PuppetlineError(
        "the workers",
        found="processes that end before they begin a recording",
        expected="processes that can run Puppetline",
        fix="Read their output. The memory may be too small; if so, use fewer of them.",
    )
