"""The command `look`: what the source of a stage sees, and why nothing moves (docs/control.md).

A stage remembers what arrives only while clients ask. Images are drawn in a thread, one at a time.
"""

import base64
import math
from collections.abc import Callable, Collection
from concurrent.futures import Future
from functools import partial
from typing import Any

import numpy as np

from capture.sensors.diagnosis import describe, diagnose, summary
from capture.sensors.source_report import PerformerReport, SourceReport
from capture.trackers.picture import Lens
from engine_bridge.service.background_jobs import Jobs
from engine_bridge.service.control.dispatcher import Deferred
from engine_bridge.service.stages.stage_runner import StageRunner
from puppetline import clock
from puppetline.errors import ServiceError

FIRST_SECONDS = 1.0
"""Time for which a stage's source is watched before the first answer, in seconds."""

PERIOD_SECONDS = 0.1
"""Minimum time between two answers about a stage, in seconds; the requests in between share the next answer."""

NO_STAGE = ServiceError(
    "the service", found="a stage that no longer exists", expected="one of the stages", fix='List them: {"do": "list"}'
)

Answer = Callable[[Deferred, Future[Any], Callable[[Any], Any]], None]


class Looking:
    """Answers the command `look`.

    Parameters
    ----------
    jobs : Jobs
    answer : callable
        Sends a deferred answer: the result of finished work, changed by a function.
    """

    def __init__(self, jobs: Jobs, answer: Answer) -> None:
        self._jobs, self._answer = jobs, answer
        self._waiting: dict[StageRunner, list[Deferred]] = {}
        self._due: dict[StageRunner, float] = {}

    def ask(self, runner: StageRunner) -> Deferred:
        """Look at the source of a stage; the answer is sent when the image is drawn."""
        deferred = Deferred()
        self._waiting.setdefault(runner, []).append(deferred)
        runner.report()  # which begins to remember what arrives
        return deferred

    def advance(self, runners: Collection[StageRunner]) -> None:
        """Start to draw the images that are due."""
        for runner in [*self._waiting]:
            if runner not in runners:
                gone: Future[Any] = Future()
                gone.set_exception(NO_STAGE)
                self._finish(self._waiting.pop(runner), gone)
            elif clock.now() >= self._due.get(runner, -math.inf):
                report = runner.report()
                if report.seconds >= FIRST_SECONDS:
                    self._due[runner] = math.inf
                    work = partial(seen, runner.stage.name, report)
                    self._jobs.start(self._jobs.looking, work, partial(self._made, runner, self._waiting.pop(runner)))

    def _made(self, runner: StageRunner, waiting: list[Deferred], made: Future[Any]) -> None:
        self._due[runner] = clock.now() + PERIOD_SECONDS
        self._due = {each: due for each, due in self._due.items() if due > clock.now()}
        self._finish(waiting, made)

    def _finish(self, waiting: list[Deferred], made: Future[Any]) -> None:
        for deferred in waiting:
            self._answer(deferred, made, lambda result: result)


def seen(stage: str, report: SourceReport) -> dict[str, Any]:
    """Return what `puppetline look --json` prints of a report, with the image and the positions of the joints in it.

    Confidences are omitted, because lost joints have no position.

    Parameters
    ----------
    stage : str
        Name of the stage.
    report : SourceReport

    Returns
    -------
    dict
        The image is a JPEG in base64 under ``picture.jpeg``. Each performer has a line of ``text`` and ``joints``: 20
        times x and y, as shares of the image's width and height, or None. Without an image, ``joints`` is None.
    """
    from capture.sensors.picture_jpeg import jpeg  # a service whose image is never requested does not load Pillow

    picture = report.picture
    values = summary(report, diagnose(report))
    if picture is not None:
        values["picture"]["jpeg"] = base64.b64encode(jpeg(picture)).decode()
    for performer in values["performers"]:
        known = report.performers[performer["user"]]
        del performer["confidence"]
        performer["text"] = describe(known)
        performer["joints"] = None if picture is None else _joints(known, picture.lens)
    return {"stage": stage, **values}


def _joints(performer: PerformerReport, lens: Lens) -> list[list[float] | None]:
    positions = performer.newest.positions
    shown = performer.known() & (positions[:, 2] > 0)
    places = lens.project(np.where(shown[:, None], positions, 1.0)) / [lens.width, lens.height]
    return [[float(x), float(y)] if each else None for each, (x, y) in zip(shown, places, strict=True)]
