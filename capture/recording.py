"""Recording of takes, Puppetline's own format, which stays readable after a crash.

A take is JSON Lines in UTF-8. The first line is `HEADER`. Each further line is an event of `capture.events`: an event
of the source or a command. A stage's take begins with the cue ``stage``::

    {"t": 12.4, "do": "stage", "arguments": {…}}
    {"t": 12.5, "user": 1, "p": [[0.1, 0.92, 2.4], null, …], "c": [1.0, 0.0, …], "o": [[0.8, 0.0, 0.6, 0.0], null, …]}
    {"t": 12.6, "tick": true}
    {"t": 12.7, "do": "calibrate", "arguments": {"character": "dog"}}
    {"t": 12.8, "lost": 1}
    {"t": 12.8, "lost": 1, "again": true}

t is the time in seconds. p are positions in metres in sensor coordinates, rounded to 0.01 mm, and c are confidences,
both in the order of the header's joints; a lost joint is null with confidence 0. If the source has orientations, o are
quaternions as in `capture.orientations`, null if unknown. If it has channels,
``"channels": {"voice": 0.25}`` has the known ones.

Data are only appended to a file. A line is complete if it ends in ``}`` and a line feed. Any other line is incomplete
because of a crash; a program that continues such a file ends the line with `INCOMPLETE_LINE_END`. The reader is
`capture.formats.puppetline_log`.
"""

import json
import math
import os
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Self

import numpy as np

from capture.events import Cue, Event, Lost, Tick
from capture.skeleton import JOINTS, LOST, SkeletonFrame
from puppetline import clock
from puppetline.errors import OutputError
from puppetline.files import append_error

VERSION = 2
"""Version of the format. Version 1 has only frames."""

HEADER = json.dumps({"puppetline": "skeleton log", "version": VERSION, "joints": JOINTS}).encode() + b"\n"
"""The first line of a recording."""

INCOMPLETE_LINE_END = b"...\n"
"""End of an incomplete line, so that a line that was cut off after a ``}`` is not read as a complete one."""

DECIMALS = 5
"""Number of decimals of a position in metres (0.01 mm), of a quaternion (0.001°) and of a channel."""

SYNC_INTERVAL_SECONDS = 1.0
"""Interval at which the file is synchronised with the disk. A power cut may lose this time; a crash loses nothing."""


class Recorder:
    """A writer that appends events to a new or existing take.

    Raises
    ------
    OutputError
        The file cannot be opened, or exists and is not a take of this version.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            # In append mode without a buffer, the system has all written data even if this process crashes.
            self._file = path.open("ab+", buffering=0)
        except OSError as error:
            raise append_error(path, error) from error
        # Synchronising with the disk may take 0.1 s, so another thread does it.
        self._syncer = ThreadPoolExecutor(1, "sync")
        self._syncing: Future[None] | None = None
        self._synced = clock.now()
        try:
            self._append(self._missing_start())
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, event: Event) -> None:
        """Append one event.

        Raises
        ------
        OutputError
            The event cannot be written, for example because the disk is full. The take is then closed.
        """
        self._append(encode(event))
        now = clock.now()
        if now - self._synced >= SYNC_INTERVAL_SECONDS and (self._syncing is None or self._syncing.done()):
            self._check_sync()
            self._syncing = self._syncer.submit(os.fsync, self._file.fileno())
            self._synced = now

    def close(self) -> None:
        """Write everything to the disk and close the file. Closing again does nothing."""
        if self._file.closed:
            return
        with self._file:
            self._syncer.shutdown()
            self._check_sync()
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                raise append_error(self.path, error) from error

    def _missing_start(self) -> bytes:
        """Return the data to write before the next line: the rest of the header, or the end of an incomplete line."""
        self._file.seek(0)
        start = self._file.read(len(HEADER))
        if start == HEADER:
            self._file.seek(-1, os.SEEK_END)
            return b"" if self._file.read(1) == b"\n" else INCOMPLETE_LINE_END
        if HEADER.startswith(start):
            return HEADER[len(start) :]
        raise OutputError(
            self.path,
            found="a file that is not a take of this version",
            expected="a new name, or a take to continue",
            fix="Choose another name; the file is unchanged.",
        )

    def _append(self, data: bytes) -> None:
        try:
            while data:
                data = data[self._file.write(data) :]
        except OSError as error:
            # Part of a line may be written. The next recorder that opens the file ends the line.
            self._abandon()
            raise append_error(self.path, error) from error

    def _check_sync(self) -> None:
        try:
            if self._syncing is not None:
                self._syncing.result()
        except OSError as error:
            self._abandon()
            raise append_error(self.path, error) from error

    def _abandon(self) -> None:
        self._syncer.shutdown()
        self._file.close()


def as_recorded(frame: SkeletonFrame) -> SkeletonFrame:
    """Return the frame that a reader of the take returns, bit for bit.

    The live service uses this frame, so that a replay has the same result.
    """
    rounded = np.round(frame.positions, DECIMALS)
    known = (frame.confidence > LOST) & np.isfinite(rounded).all(axis=1)
    orientations = None
    if frame.orientations is not None:
        orientations = np.round(frame.orientations, DECIMALS)
        orientations = np.where(np.isfinite(orientations).all(axis=1, keepdims=True), orientations, np.nan)
    return SkeletonFrame(
        float(frame.time),
        int(frame.user),
        np.where(known[:, None], rounded, np.nan),
        np.where(known, frame.confidence, np.float32(LOST)),
        orientations,
        {name: round(float(value), DECIMALS) for name, value in (frame.channels or {}).items()} or None,
    )


def encode(event: Event) -> bytes:
    """Return an event's line in a take."""
    match event:
        case Tick(time):
            return _line({"t": time, "tick": True})
        case Lost(time, user, again):
            return _line({"t": time, "lost": user} | ({"again": True} if again else {}))
        case Cue(time, do, arguments):
            return _line({"t": time, "do": do, "arguments": arguments})
    frame = as_recorded(event)
    known = (frame.confidence > LOST).tolist()
    line = {
        "t": frame.time,
        "user": frame.user,
        "p": [position if seen else None for position, seen in zip(frame.positions.tolist(), known, strict=True)],
        # str returns the shortest number that is read back as the same float32
        "c": [float(str(value)) for value in frame.confidence],
    }
    if frame.orientations is not None:
        line["o"] = [None if math.isnan(each[0]) else each for each in frame.orientations.tolist()]
    if frame.channels is not None:
        line["channels"] = frame.channels
    return _line(line)


def _line(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False).encode() + b"\n"
