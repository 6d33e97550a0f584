"""Long work with progress, which can be cancelled."""

import asyncio
import secrets
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any

from engine_bridge.studio.long_work.worker import Progress
from engine_bridge.studio.messages.state import JobState
from puppetline.errors import PuppetlineError, ServiceError

MAX_FINISHED = 8
"""Number of finished jobs that stay in the list."""


@dataclass
class _Job:
    state: JobState
    task: "asyncio.Task[Any] | None" = None


class Jobs:
    """The jobs of the studio.

    Parameters
    ----------
    changed : callable
        Called when a job has started or ended.
    advanced : callable
        Called with the state of a job that has advanced.
    told : callable
        Returns the parts of an error as pages may see them, see `Workspace.told`.
    """

    def __init__(
        self,
        changed: Callable[[], None],
        advanced: Callable[[JobState], None],
        told: Callable[[PuppetlineError], dict[str, str]],
    ) -> None:
        self._changed, self._advanced, self._told = changed, advanced, told
        self._jobs: dict[str, _Job] = {}

    @property
    def states(self) -> list[JobState]:
        """All jobs that are running, and the last `MAX_FINISHED` that have ended."""
        return [job.state for job in self._jobs.values()]

    async def run(self, title: str, work: Callable[[Progress], Awaitable[dict[str, Any]]]) -> dict[str, Any]:
        """Run work as a job, and return its result with the job's id as ``job``.

        Raises
        ------
        PuppetlineError
            The work has failed or was cancelled.
        """
        job = _Job(JobState(job=secrets.token_urlsafe(12), title=title))
        self._jobs[job.state.job] = job
        self._changed()

        def progress(text: str, fraction: float) -> None:
            job.state = job.state.model_copy(update={"text": text, "fraction": min(max(fraction, 0.0), 1.0)})
            self._advanced(job.state)

        job.task = asyncio.ensure_future(work(progress))
        try:
            result = await asyncio.shield(job.task)
        except asyncio.CancelledError as error:
            if not job.task.cancelled():  # the server ends
                job.task.cancel()
                raise
            self._end(job, "cancelled")
            raise ServiceError(
                title, found="a job that was cancelled", expected="a completed job", fix="Start it again."
            ) from error
        except PuppetlineError as error:
            self._end(job, "failed", error=self._told(error))
            raise
        except BaseException:
            self._end(job, "failed")
            raise
        self._end(job, "done", fraction=1.0, result=result)
        return result | {"job": job.state.job}

    def cancel(self, key: str) -> None:
        """Cancel a job.

        Raises
        ------
        ServiceError
            No job with this id is running.
        """
        job = self._jobs.get(key)
        if job is None or job.task is None or job.task.done():
            raise ServiceError(
                "the request, job",
                found=f"no running job {key!r}",
                expected="the id of a running job",
                fix="Ignore this error: the job has ended.",
            )
        job.task.cancel()

    def _end(self, job: _Job, state: str, **values: Any) -> None:
        job.state = job.state.model_copy(update={"state": state, **values})
        finished = [key for key, each in self._jobs.items() if each.state.state != "running"]
        for key in finished[: max(0, len(finished) - MAX_FINISHED)]:
            del self._jobs[key]
        self._changed()
