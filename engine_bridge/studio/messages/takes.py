"""Requests that record, play, delete and export takes."""

from typing import Annotated, Any, Literal

from pydantic import Field, FiniteFloat

from engine_bridge.performance.settings import Form, PerformerFormat
from engine_bridge.studio.messages.base import Id, Name, Request, Seconds
from puppetline.toml_schema import Table


class RecordStart(Request):
    """Begin a take of a character's stage after `count_in` seconds. Result: ``{"take": name}``.

    The default `character` is the first one, and the default `name` is ``take-1``, ``take-2`` and so on. The film's
    takes of the other characters play meanwhile. During the count-in, `StageState.count_in` is the number to show, and
    the takes that play wait at their start.
    """

    do: Literal["record_start"]
    name: Name | None = None
    character: Name | None = None
    count_in: Annotated[int, Field(ge=0, le=30)] = 0


class RecordStop(Request):
    """End the take, which is added to the film. Result: `TakeState`; ``{}`` if only a count-in had begun."""

    do: Literal["record_stop"]


class Microphone(Request):
    """Record the sound of the microphone with takes, or not. Result: ``{}``."""

    do: Literal["microphone"]
    on: bool


class Pause(Request):
    """Stop the timeline of the takes that play, or continue. Result: `TimelineStatus`."""

    do: Literal["pause"]
    on: bool = True


class Seek(Request):
    """Jump to a second of the timeline. Result: `TimelineStatus`."""

    do: Literal["seek"]
    seconds: FiniteFloat


class Stop(Request):
    """Stop the take of a character, or all takes. Result: ``{"stopped": [TimelineTake, …]}``."""

    do: Literal["stop"]
    character: Name | None = None


class DeleteTake(Request):
    """Delete a take. Result: ``{}``."""

    do: Literal["delete_take"]
    take: Name


class Export(Request):
    """Convert a recording (exactly one of `take`, `upload`, `example`) for a character, as `puppetline convert` does.

    `form` is the value of ``--as``, None for its default, or a format for the skeleton of the performer who is tracked
    longest, without the character. `start` and `stop` trim the recording, in seconds from its beginning. A job.

    Result: `ExportReply`.
    """

    do: Literal["export"]
    character: Name
    take: Name | None = None
    upload: Id | None = None
    example: Name | None = None
    form: Form | PerformerFormat | None = None
    start: Seconds | None = None
    stop: Seconds | None = None


class ExportReply(Table):
    """A file to download, and what it consists of.

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
