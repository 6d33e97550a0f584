"""Work in threads beside the service's loop: calibrations, loading and writing files, images for `look`."""

from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, TypeVar

Result = TypeVar("Result")


class Jobs:
    """Runs functions in threads; what has to follow is called in the loop.

    Parameters
    ----------
    open_pool : callable
        Opens a pool with a number of threads and the beginning of their names.

    Attributes
    ----------
    calibrating, loading, writing, looking, filming : Executor
        Two calibrations run at a time. Each of the other pools runs one job at a time: it loads files, writes files,
        draws images of what sensors see, or waits for videos.
    """

    def __init__(self, open_pool: Callable[[int, str], Executor] = ThreadPoolExecutor) -> None:
        self.calibrating = open_pool(2, "calibration")
        self.loading = open_pool(1, "loading")
        self.writing = open_pool(1, "writing")
        self.looking = open_pool(1, "looking")
        self.filming = open_pool(1, "filming")
        self._running: list[tuple[Future[Any], Callable[[Future[Any]], None]]] = []

    def start(self, pool: Executor, work: Callable[[], Result], then: Callable[[Future[Result]], None]) -> None:
        """Run `work` in one of the pools, and have `take_finished` return `then` when it is done."""
        self._running.append((pool.submit(work), then))

    def take_finished(self) -> list[tuple[Future[Any], Callable[[Future[Any]], None]]]:
        """Return what has finished since the last call, each with what is to be called with it."""
        finished = [job for job in self._running if job[0].done()]
        self._running = [job for job in self._running if job not in finished]
        return finished

    def close(self) -> None:
        """Wait until everything is written, and abandon everything else; closing again does nothing."""
        self.writing.shutdown()
        for pool in (self.looking, self.filming, self.loading, self.calibrating):
            pool.shutdown(wait=False, cancel_futures=True)
