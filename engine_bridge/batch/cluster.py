"""Runs jobs on the workers of Dask distributed, in a cluster on this machine or in an existing one."""

import logging
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from engine_bridge.batch.conversion import MAX_STARTS, BatchSettings, Outcome, convert_jobs
from engine_bridge.batch.grouping import Grouping
from engine_bridge.batch.store import Job
from puppetline.errors import PuppetlineError

if TYPE_CHECKING:
    from distributed import Client

START_SECONDS = 120
"""Time for which a scheduler may be without any worker, in seconds."""

POLL_SECONDS = 1.0
"""Maximum time to wait for a task before the workers are checked, in seconds."""

TASKS_PER_WORKER = 2
"""Number of submitted tasks per thread of the workers: one that runs and one that is next."""

DASHBOARD_ADDRESS = "127.0.0.1:8787"
"""Address of the dashboard of a cluster on this machine."""

PAGE_ADDRESS = "127.0.0.1:0"
"""Address of the small pages that a scheduler serves without a dashboard, at any free port."""

WORKER_MEMORY = {"target": False, "spill": False, "pause": False}
"""Settings of Dask for workers on this machine. Their results are small: a worker near its limit of memory must be
restarted, and not wait until it uses less."""

PROFILES = "distributed.worker.profile.enabled"
"""Setting of Dask for workers on this machine: their statistical profiles take 0.2 MB per second. It is turned off,
unless the dashboard is wanted, which shows them."""

TRIM_VARIABLE = "MALLOC_TRIM_THRESHOLD_"
"""Environment variable that Dask sets for its workers. With it, the C library returns the memory of each array to the
system and asks for it again, so that a conversion takes half as long again. It is removed."""

WORKER_PRELOAD = "engine_bridge.batch.worker_process"
"""Module that workers on this machine load when they start."""


def require(package: str, option: str) -> None:
    """Check that a package of the extra `batch` is installed.

    Raises
    ------
    PuppetlineError
    """
    if find_spec(package) is None:
        raise PuppetlineError(
            option,
            found=f"no installation of {package}",
            expected=f"the Python package {package}",
            fix="Install it: pip install 'puppetline[batch]'.",
        )


@contextmanager
def connected(scheduler: str | None, workers: int | None, max_workers: int, *, dashboard: bool) -> Iterator["Client"]:
    """Yield a client of a scheduler, or of a new cluster on this machine.

    Parameters
    ----------
    scheduler : str or None
        Address of a scheduler; None to start a cluster.
    workers : int or None
        Number of processes of the cluster; None for one per CPU that this process may use.
    max_workers : int
        Maximum of this number.
    dashboard : bool
        Show the dashboard of the cluster.

    Raises
    ------
    PuppetlineError
        Dask is not installed, or no scheduler or worker answers.
    """
    require("distributed", "--workers" if scheduler is None else "--scheduler")
    if dashboard:
        _require_dashboard()
    import dask
    from dask.system import CPU_COUNT
    from distributed import Client, LocalCluster

    _silence()
    if scheduler is not None:
        with _reaching(scheduler):
            client = Client(scheduler, set_as_default=False)  # Dask's setting of connection times: 30 s
            client.wait_for_workers(1, timeout=START_SECONDS)
        with client:
            yield client
        return
    configuration = {
        "distributed.worker.preload": [*dask.config.get("distributed.worker.preload"), WORKER_PRELOAD],
        "distributed.nanny.pre-spawn-environ": {
            name: value
            for name, value in dask.config.get("distributed.nanny.pre-spawn-environ").items()
            if name != TRIM_VARIABLE
        },
        "distributed.worker.memory": dask.config.get("distributed.worker.memory") | WORKER_MEMORY,
        PROFILES: dashboard,
    }
    count = min(CPU_COUNT if workers is None else workers, max_workers)
    with (
        dask.config.set(configuration),
        LocalCluster(
            n_workers=0,
            threads_per_worker=1,
            dashboard_address=DASHBOARD_ADDRESS if dashboard else PAGE_ADDRESS,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        cluster.scale(count)
        yield client


def run_on(
    client: "Client", grouping: Grouping, batch: BatchSettings, check: Callable[[], None]
) -> Generator[Outcome, None, None]:
    """Convert jobs on the workers of a client, and yield each outcome as soon as it is known.

    Parameters
    ----------
    client : Client
    grouping : Grouping
    batch : BatchSettings
    check : callable
        Called at least every second; raises an error to stop.

    Raises
    ------
    PuppetlineError
        See `engine_bridge.batch.conversion.convert_jobs`; also if the scheduler has ended.
    """
    tasks = _Tasks(client, grouping, batch)
    try:
        while tasks:
            tasks.submit()
            check()
            for outcome in tasks.outcomes():
                grouping.learn(outcome)
                yield outcome
    except OSError as error:  # also that of a connection that was closed
        raise _scheduler_ended() from error
    finally:
        tasks.cancel()


class _Tasks:
    """Tasks that were submitted to the workers of a client."""

    def __init__(self, client: "Client", grouping: Grouping, batch: BatchSettings) -> None:
        self._client, self._grouping, self._batch = client, grouping, batch
        self._running: dict[Any, tuple[list[Job], int]] = {}
        self._workers, self._seen = 1, time.monotonic()

    def __bool__(self) -> bool:
        """Return whether any job waits or runs."""
        return bool(self._grouping or self._running)

    def submit(self) -> None:
        """Submit as many tasks as the workers need next, and replace workers that have failed to start."""
        with suppress(TimeoutError):
            threads = sum(self._client.nthreads().values())
            if threads:
                self._workers, self._seen = threads, time.monotonic()
        if time.monotonic() > self._seen + START_SECONDS:
            raise _no_workers()
        _replace_workers(self._client)
        while self._grouping and len(self._running) < TASKS_PER_WORKER * self._workers:
            self._submit(self._grouping.take(self._workers), 0)

    def outcomes(self) -> Iterator[Outcome]:
        """Wait for a task, at most `POLL_SECONDS`, and yield the outcomes of all tasks that have ended."""
        from distributed import wait
        from distributed.client import FutureCancelledError, FuturesCancelledError

        try:
            with suppress(TimeoutError), self._client.as_current():
                wait(list(self._running), timeout=POLL_SECONDS, return_when="FIRST_COMPLETED")
            if self._client.status != "running":
                raise _scheduler_ended()
            for future in [each for each in self._running if each.done()]:
                yield from self._result(future, *self._running.pop(future))
        except (FutureCancelledError, FuturesCancelledError):
            raise _scheduler_ended() from None

    def cancel(self) -> None:
        """Cancel all tasks."""
        with suppress(Exception):  # the scheduler may have ended
            self._client.cancel(list(self._running))

    def _submit(self, group: list[Job], deaths: int) -> None:
        self._running[self._client.submit(convert_jobs, group, self._batch, pure=False)] = group, deaths

    def _result(self, future: Any, group: list[Job], deaths: int) -> list[Outcome]:
        """Return the outcomes of a task; submit it again if its workers were killed."""
        from distributed.scheduler import KilledWorker

        try:
            return future.result()
        except KilledWorker:
            # a death of a worker that had begun a job is counted as a start of that job, see `Store.start`
            if deaths > MAX_STARTS * len(group):
                raise _no_workers() from None
            self._submit(group, deaths + 1)
            return []


@contextmanager
def _reaching(scheduler: str) -> Iterator[None]:
    """Raise an error that a user understands if no scheduler or worker answers."""
    try:
        yield
    except (OSError, ValueError) as error:
        raise PuppetlineError(
            f"--scheduler {scheduler}",
            found=f"no scheduler with workers ({error})",
            expected="the address of a scheduler of Dask with at least one worker, such as tcp://head:8786",
            fix="Check the address, and that workers have started.",
        ) from error


def _replace_workers(client: "Client") -> None:
    """Replace workers that ended before they had started, in a cluster on this machine."""
    from distributed.core import Status

    cluster = client.cluster

    def replace() -> None:
        for name, worker in list(cluster.workers.items()):
            if worker.status in (Status.failed, Status.closed):
                del cluster.workers[name]
        cluster.scale(len(cluster.worker_spec))

    if cluster is not None:
        cluster.loop.add_callback(replace)


def _scheduler_ended() -> PuppetlineError:
    return PuppetlineError(
        "the scheduler",
        found="a lost connection",
        expected="a scheduler that runs until the batch ends",
        fix="Start it and its workers, and run the command again; it continues where it was.",
    )


def _no_workers() -> PuppetlineError:
    return PuppetlineError(
        "the workers",
        found=f"no worker for {START_SECONDS} s, or workers that end before they begin a task",
        expected="workers that can run Puppetline",
        fix="Read the output of the workers. Their memory may be too small; if so, use fewer of them.",
    )


def _require_dashboard() -> None:
    if find_spec("bokeh") is None:
        raise PuppetlineError(
            "--dashboard",
            found="no installation of bokeh",
            expected="the Python package bokeh, which draws Dask's dashboard",
            fix="Install it: pip install bokeh.",
        )


def _silence() -> None:
    """Hide messages of Dask about what this module reports itself."""
    for name in ("asyncio", "distributed", "distributed.client", "tornado", "tornado.application"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
