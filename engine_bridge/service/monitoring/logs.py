"""Logs for people and for programs: one line per record, with fields.

``log.info("performer found", extra=fields(stage="kinect", user=3))`` is one of these::

    2026-11-21 15:04:05.120 info     service.stages.stage: performer found (stage=kinect, user=3)
    {"time": "2026-11-21T15:04:05.120+00:00", "level": "info", "logger": "engine_bridge.service.stages.stage",
     "event": "performer found", "fields": {"stage": "kinect", "user": 3}}
"""

import json
import logging
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from logging.handlers import QueueHandler
from queue import Full, Queue
from typing import Any, Literal, TextIO

from puppetline import clock

REPEAT_SECONDS = 1.0
"""Minimum time between two records of the same event from a `OnceASecond`, in seconds."""

MAX_QUEUED = 1000
"""Maximum number of records that wait to be written."""

CLOSE_SECONDS = 0.3
"""Maximum time that closing waits for queued records to be written, in seconds."""


def fields(**values: Any) -> dict[str, Any]:
    """Return the argument `extra` of `logging`'s functions, for a record with these fields."""
    return {"fields": values}


def setup(form: Literal["text", "json"] = "text", level: str = "info", stream: TextIO | None = None) -> None:
    """Send all logs to one stream.

    Parameters
    ----------
    form : "text" or "json"
    level : str
        ``"debug"``, ``"info"``, ``"warning"`` or ``"error"``: the lowest level that is written.
    stream : text file, optional
        Standard error by default.
    """
    handler = _Unbuffered(stream or sys.stderr)
    handler.setFormatter(JsonFormatter() if form == "json" else TextFormatter())
    logging.basicConfig(handlers=[handler], level=level.upper(), force=True)


@contextmanager
def beside() -> Iterator[None]:
    """Write the logs in a thread: a paused terminal or a full pipe then loses records, but delays nothing.

    Where the thread is still stuck at the end, what is logged later is lost too.
    """
    root, waiting = logging.getLogger(), Queue[logging.LogRecord | None](MAX_QUEUED)
    before = root.handlers[:]

    def write() -> None:
        while (record := waiting.get()) is not None:
            for handler in before:
                handler.emit(record)  # without the handler's lock, which a stuck thread would keep

    writer = threading.Thread(target=write, name="logs", daemon=True)
    writer.start()
    root.handlers[:] = [_Waiting(waiting)]
    try:
        yield
    finally:
        with suppress(Full):
            waiting.put_nowait(None)
        writer.join(CLOSE_SECONDS)
        root.handlers[:] = [logging.NullHandler()] if writer.is_alive() else before


class _Unbuffered(logging.StreamHandler[TextIO]):
    """Writes past Python's buffer of a stream: a thread that is stuck in it would keep others from flushing it."""

    def emit(self, record: logging.LogRecord) -> None:
        try:
            descriptor = self.stream.fileno()
        except (OSError, ValueError):  # a stream in memory, or a closed one
            super().emit(record)
            return
        try:
            text = self.format(record) + self.terminator
            data = text.encode(self.stream.encoding, self.stream.errors or "strict")
            while data:
                data = data[os.write(descriptor, data) :]
        except Exception:
            self.handleError(record)


class _Waiting(QueueHandler):
    """Puts records into a queue; if it is full, they are lost."""

    def prepare(self, record: logging.LogRecord) -> logging.LogRecord:
        return record  # with its exception: it stays in this process

    def enqueue(self, record: logging.LogRecord) -> None:
        with suppress(Full):
            self.queue.put_nowait(record)


class JsonFormatter(logging.Formatter):
    """A record as a line of JSON."""

    def format(self, record: logging.LogRecord) -> str:
        """Return time (ISO 8601, UTC), level, logger, event, fields and, of an exception, its traceback."""
        line = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "event": record.getMessage(),
            "fields": _fields(record),
        }
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str)


class TextFormatter(logging.Formatter):
    """A record as readable text, with unprintable characters escaped, because some texts come from the network."""

    def format(self, record: logging.LogRecord) -> str:
        """Return local time, level, logger, event and fields; an exception's traceback follows on lines of its own."""
        moment = datetime.fromtimestamp(record.created).astimezone()
        values = ", ".join(f"{key}={value}" for key, value in _fields(record).items())
        line = (
            f"{moment:%Y-%m-%d %H:%M:%S}.{int(record.msecs):03} {record.levelname.lower():8} "
            f"{record.name.removeprefix('engine_bridge.')}: {record.getMessage()}" + (f" ({values})" if values else "")
        )
        line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
        return f"{line}\n{self.formatException(record.exc_info)}" if record.exc_info else line


class OnceASecond:
    """Logs each event at most once per second, with the number of times that it happened in between.

    Parameters
    ----------
    log : logging.Logger
    """

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._logged: dict[str, float] = {}
        self._skipped: dict[str, int] = {}

    def warning(self, event: str, **values: Any) -> None:
        """Log an event, one of a closed set; the field ``more`` of the next record counts those that were skipped."""
        now = clock.now()
        if now - self._logged.get(event, -REPEAT_SECONDS) < REPEAT_SECONDS:
            self._skipped[event] = self._skipped.get(event, 0) + 1
            return
        self._logged[event] = now
        skipped = self._skipped.pop(event, 0)
        self._log.warning(event, extra=fields(**values, **({"more": skipped} if skipped else {})))


def _fields(record: logging.LogRecord) -> dict[str, Any]:
    return getattr(record, "fields", {})
