"""Jobs on the workers of Dask distributed: a cluster on this machine, or an existing one."""

import logging
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

START_SECONDS = 60
"""Time in which a scheduler must answer and a first worker must come, in seconds."""

POLL_SECONDS = 1.0
"""Time after which waiting for a task is interrupted to look at the workers, in seconds."""

TASKS_PER_WORKER = 2
"""Number of tasks per thread of the workers that are submitted: one that runs and one that is next."""

DASHBOARD_ADDRESS = "127.0.0.1:8787"
"""Address of the dashboard of a cluster on this machine."""

WORKER_MEMORY = {"target": False, "spill": False, "pause": False}
"""Settings of Dask for workers on this machine. Their results are small: a worker near its limit of memory must be
restarted, and not wait until it uses less."""

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
        Limit of this number.
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
        with _reaching(scheduler), Client(scheduler, timeout=START_SECONDS, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=START_SECONDS)
            yield client
        return
    with (
        dask.config.set(
            {
                "distributed.worker.preload": [*dask.config.get("distributed.worker.preload"), WORKER_PRELOAD],
                "distributed.worker.memory": dask.config.get("distributed.worker.memory") | WORKER_MEMORY,
            }
        ),
        LocalCluster(
            n_workers=min(CPU_COUNT if workers is None else workers, max_workers),
            threads_per_worker=1,
            dashboard_address=DASHBOARD_ADDRESS if dashboard else None,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):
        yield client


def run_on(
    client: "Client", grouping: Grouping, batch: BatchSettings, check: Callable[[], None]
) -> Generator[Outcome, None, None]:
    """Convert jobs on the workers of a client, and yield the outcomes as they come.

    Parameters
    ----------
    client : Client
    grouping : Grouping
    batch : BatchSettings
    check : callable
        Called every second; raises an error to stop.

    Raises
    ------
    PuppetlineError
        See `engine_bridge.batch.conversion.convert_jobs`; or the scheduler has ended.
    """
    from distributed import wait
    from distributed.scheduler import KilledWorker

    running: dict[Any, tuple[list[Job], int]] = {}

    def submit(group: list[Job], deaths: int = 0) -> None:
        running[client.submit(convert_jobs, group, batch, pure=False)] = group, deaths

    workers = 1
    try:
        while grouping or running:
            with suppress(TimeoutError):
                workers = sum(client.nthreads().values()) or workers
            while grouping and len(running) < TASKS_PER_WORKER * workers:
                submit(grouping.take(workers))
            with suppress(TimeoutError), client.as_current():
                wait(list(running), timeout=POLL_SECONDS, return_when="FIRST_COMPLETED")
            check()
            _check_connection(client)
            for future in [each for each in running if each.done()]:
                group, deaths = running.pop(future)
                try:
                    outcomes = future.result()
                except KilledWorker:
                    # each death but those of tasks that had not begun is counted as a start of some job
                    if deaths > MAX_STARTS * len(group):
                        raise _no_progress(client) from None
                    submit(group, deaths + 1)
                    continue
                for outcome in outcomes:
                    grouping.learn(outcome)
                    yield outcome
    finally:
        with suppress(Exception):  # the scheduler may have ended
            client.cancel(list(running))


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


def _check_connection(client: "Client") -> None:
    if client.status != "running":
        raise PuppetlineError(
            "the scheduler",
            found="no connection any more",
            expected="a scheduler that runs until the batch ends",
            fix="Start it and its workers, and run the command again; it continues where it was.",
        )


def _no_progress(client: "Client") -> PuppetlineError:
    return PuppetlineError(
        "the workers",
        found="workers that end before they begin a task",
        expected=f"workers that can run Puppetline ({len(client.nthreads())} are connected)",
        fix="Read the output of the workers; their memory may be too small.",
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
    for name in ("distributed", "tornado"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
