"""Groups jobs into tasks that take a few seconds, whatever the length of the recordings."""

from collections import deque
from collections.abc import Sequence

from engine_bridge.batch.conversion import Outcome
from engine_bridge.batch.store import Job

TASK_SECONDS = 4.0
"""Expected duration of a task, in seconds: long compared with its start, and short compared with a batch."""

Kind = tuple[str, str]


class Grouping:
    """Jobs that wait, and the durations of the jobs so far.

    Parameters
    ----------
    jobs : sequence of Job
    sizes : sequence of int
        Size of each job's recording in bytes. Durations of jobs with the same puppet and format are proportional to it.
    """

    def __init__(self, jobs: Sequence[Job], sizes: Sequence[int]) -> None:
        self._waiting = deque(zip(jobs, sizes, strict=True))
        self._sizes = dict(zip([job.name for job in jobs], sizes, strict=True))
        self._rest: dict[Kind, int] = {}
        for job, size in self._waiting:
            self._rest[_kind(job)] = self._rest.get(_kind(job), 0) + size
        self._taken: dict[Kind, tuple[float, int]] = {}

    def __len__(self) -> int:
        """Return the number of jobs that wait."""
        return len(self._waiting)

    def learn(self, outcome: Outcome) -> None:
        """Take the duration of a job into account."""
        seconds, size = self._taken.get(_kind(outcome.job), (0.0, 0))
        self._taken[_kind(outcome.job)] = seconds + outcome.seconds, size + self._sizes[outcome.job.name]

    def take(self, workers: int) -> list[Job]:
        """Remove and return the jobs of the next task, at least one if any waits.

        They are expected to take `TASK_SECONDS`, or less near the end, so that all workers end at about the same time.
        A job of a kind that has never run is alone.
        """
        rest = sum(self._expected(kind, size) or TASK_SECONDS for kind, size in self._rest.items() if size)
        budget = min(TASK_SECONDS, rest / (2 * max(workers, 1)))
        group: list[Job] = []
        while self._waiting:
            job, size = self._waiting[0]
            expected = self._expected(_kind(job), size)
            if group and (expected is None or expected > budget):
                break
            group.append(job)
            self._waiting.popleft()
            self._rest[_kind(job)] -= size
            if expected is None:
                break
            budget -= expected
        return group

    def _expected(self, kind: Kind, size: int) -> float | None:
        """Return the expected duration of recordings in seconds; None if none of their kind has been converted yet."""
        seconds, total = self._taken.get(kind, (0.0, 0))
        return seconds / total * size if total else None


def _kind(job: Job) -> Kind:
    return str(job.puppet), job.log.suffix
