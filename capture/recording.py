"""The project's own recording, a *take*: written as it happens, readable after a crash.

JSON Lines in UTF-8. The first line is `HEADER`. Each further line is one of `capture.events`: what the source gave, or
what was asked for in between. A stage's take begins with the cue ``stage``::

    {"t": 12.4, "do": "stage", "arguments": {…}}
    {"t": 12.5, "user": 1, "p": [[0.1, 0.92, 2.4], null, …], "c": [1.0, 0.0, …], "o": [[0.8, 0.0, 0.6, 0.0], null, …]}
    {"t": 12.6, "tick": true}
    {"t": 12.7, "do": "calibrate", "arguments": {"character": "dog"}}
    {"t": 12.8, "lost": 1}

t is in seconds, p in metres in the sensor frame of `capture.skeleton` rounded to 0.01 mm, c is the confidence; both are
in the order of the header's joints and a lost joint is null with confidence 0. o is there where the source has
orientations: quaternions of `capture.orientations`, null where unknown.

A file is only ever appended to. A line is whole where it ends in ``}`` and a line feed; anything else was torn by a
crash, and who goes on with such a file ends the torn line with `TORN`. The reader is `capture.formats.puppetline_log`.
"""

import json
import math
import os
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from capture.events import Cue, Event, Lost, Tick
from capture.skeleton import JOINTS, LOST, SkeletonFrame
from puppetline.errors import OutputError

VERSION = 2
"""Version 1 had frames only."""

HEADER = json.dumps({"puppetline": "skeleton log", "version": VERSION, "joints": JOINTS}).encode() + b"\n"
"""The first line of a recording."""

TORN = b"...\n"
"""The end of a line that was torn: it keeps one that broke off at a ``}`` from passing for a whole one."""

DECIMALS = 5
"""Of a position in metres: 0.01 mm; of a quaternion: 0.001°."""

SYNC_INTERVAL = 1.0
"""Seconds of performance that a power cut may cost; a crash of the program costs none."""


class Recorder:
    """Appends events to a recording, new or begun earlier.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OutputError
        If the file cannot be opened, or is there already and no recording of this version.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            # Append mode without a buffer: what is written is with the system at once, whatever becomes of us.
            self._file = path.open("ab+", buffering=0)
        except OSError as error:
            raise _cannot_write(path, error) from error
        # A disk may take a tenth of a second to sync, for which no frame should wait.
        self._syncer = ThreadPoolExecutor(1, "sync")
        self._syncing: Future[None] | None = None
        self._synced = time.monotonic()
        try:
            self._append(self._missing_start())
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def write(self, event: Event) -> None:
        """Append one event.

        Raises
        ------
        OutputError
            If the system does not take it, say because the disk is full; the recording is closed then.
        """
        self._append(encode(event))
        now = time.monotonic()
        if now - self._synced >= SYNC_INTERVAL and (self._syncing is None or self._syncing.done()):
            self._check_sync()
            self._syncing = self._syncer.submit(os.fsync, self._file.fileno())
            self._synced = now

    def close(self) -> None:
        """Leave the recording complete on the disk. Closing again does nothing."""
        if self._file.closed:
            return
        with self._file:
            self._syncer.shutdown()
            self._check_sync()
            try:
                os.fsync(self._file.fileno())
            except OSError as error:
                raise _cannot_write(self.path, error) from error

    def _missing_start(self) -> bytes:
        """Return what must stand before the next line: the header, what a crash took of it, or a torn line's end."""
        self._file.seek(0)
        start = self._file.read(len(HEADER))
        if start == HEADER:
            self._file.seek(-1, os.SEEK_END)
            return b"" if self._file.read(1) == b"\n" else TORN
        if HEADER.startswith(start):
            return HEADER[len(start) :]
        raise OutputError(
            self.path,
            found="a file that is not a recording of this version",
            expected="a new name, or a recording to continue",
            fix="Choose another name; the file was left as it is.",
        )

    def _append(self, data: bytes) -> None:
        try:
            while data:
                data = data[self._file.write(data) :]
        except OSError as error:
            # Part of a line may be written. The next to open the file ends it; going on here would spoil a line.
            self._abandon()
            raise _cannot_write(self.path, error) from error

    def _check_sync(self) -> None:
        try:
            if self._syncing is not None:
                self._syncing.result()
        except OSError as error:
            self._abandon()
            raise _cannot_write(self.path, error) from error

    def _abandon(self) -> None:
        self._syncer.shutdown()
        self._file.close()


def as_recorded(frame: SkeletonFrame) -> SkeletonFrame:
    """Return the frame that a reader of the take gives back, to the bit.

    What is performed live must be this, so that a replay performs the same.
    """
    rounded = np.round(frame.positions, DECIMALS)
    known = (frame.confidence > LOST) & np.isfinite(rounded).all(axis=1)
    turns = None
    if frame.orientations is not None:
        turns = np.round(frame.orientations, DECIMALS)
        turns = np.where(np.isfinite(turns).all(axis=1, keepdims=True), turns, np.nan)
    return SkeletonFrame(
        float(frame.time),
        int(frame.user),
        np.where(known[:, None], rounded, np.nan),
        np.where(known, frame.confidence, np.float32(LOST)),
        turns,
    )


def encode(event: Event) -> bytes:
    """Return an event's line in a recording."""
    match event:
        case Tick(time):
            return _line({"t": time, "tick": True})
        case Lost(time, user):
            return _line({"t": time, "lost": user})
        case Cue(time, do, arguments):
            return _line({"t": time, "do": do, "arguments": arguments})
    frame = as_recorded(event)
    known = (frame.confidence > LOST).tolist()
    line = {
        "t": frame.time,
        "user": frame.user,
        "p": [place if seen else None for place, seen in zip(frame.positions.tolist(), known, strict=True)],
        # str gives the shortest number that reads back as the same float32.
        "c": [float(str(value)) for value in frame.confidence],
    }
    if frame.orientations is not None:
        line["o"] = [None if math.isnan(turn[0]) else turn for turn in frame.orientations.tolist()]
    return _line(line)


def _line(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False).encode() + b"\n"


def _cannot_write(path: Path, error: OSError) -> OutputError:
    return OutputError(
        path,
        found=error.strerror or str(error),
        expected="a file that can be written",
        fix="Choose another place, or make room or give permission there.",
    )
