"""Requests that record, delete and export takes."""

from typing import Any, Literal

from engine_bridge.performance.settings import Form, PerformerFormat
from engine_bridge.studio.messages.base import Id, JobResult, Name, Request, Seconds


class RecordStart(Request):
    """Begin a take of the first stage. The default `name` has the stage and the time. Result: ``{"take": name}``."""

    do: Literal["record_start"]
    name: Name | None = None


class RecordStop(Request):
    """End the take. Result: `TakeState`."""

    do: Literal["record_stop"]


class DeleteTake(Request):
    """Delete a take. Result: ``{}``."""

    do: Literal["delete_take"]
    take: Name


class Export(Request):
    """Convert a recording (exactly one of `take`, `upload`, `example`) for a character, as `puppetline convert` does.

    `form` is the value of ``--as``, None for its default, or a format for the skeleton of the performer who is tracked
    longest, without the character. `start` and `stop` trim the recording, in seconds from its beginning. A job, see
    `JobResult`. Result: `ExportReply`.
    """

    do: Literal["export"]
    character: Name
    take: Name | None = None
    upload: Id | None = None
    example: Name | None = None
    form: Form | PerformerFormat | None = None
    start: Seconds | None = None
    stop: Seconds | None = None


class ExportReply(JobResult):
    """An exported file.

    `numbers` is `engine_bridge.export.convert.Summary`, or for a performer's skeleton `PerformerSummary` of
    `engine_bridge.export.performer.convert`, and `text` the lines that `puppetline convert` prints.
    """

    file: str
    name: str
    numbers: dict[str, Any]
    text: str


class Cancel(Request):
    """Cancel a job; the request that started it gets an error. Result: ``{}``."""

    do: Literal["cancel"]
    job: Id
