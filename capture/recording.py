"""The project's own skeleton log: written as it happens, readable after a crash.

JSON Lines in UTF-8. The first line is `HEADER`; each further line is one frame of one performer::

    {"t": 12.5, "user": 1, "p": [[0.1, 0.92, 2.4], null, …], "c": [1.0, 0.0, …]}

t is in seconds, p in metres in the sensor frame of `capture.skeleton` rounded to 0.01 mm, c is the confidence; both are
in the order of the header's joints and a lost joint is null with confidence 0. A file is only ever appended to, and a
line that does not end in ``}`` was torn by a crash, as a frame has no other ``}``. The reader is
`capture.formats.puppetline_log`.
"""

import json
import os
import time
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from capture.skeleton import JOINTS, LOST, SkeletonFrame
from puppetline.errors import OutputError

VERSION = 1

HEADER = json.dumps({"puppetline": "skeleton log", "version": VERSION, "joints": JOINTS}).encode() + b"\n"
"""The first line of a recording."""

DECIMALS = 5
"""Of a position in metres: 0.01 mm."""

SYNC_INTERVAL = 1.0
"""Seconds of performance that a power cut may cost; a crash of the program costs none."""


class Recorder:
    """Appends frames to a recording, new or begun earlier.

    Parameters
    ----------
    path : Path

    Raises
    ------
    OutputError
        If the file cannot be opened, or is there already and no recording.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            # Append mode without a buffer: what is written is with the system at once, whatever becomes of us.
            self._file = path.open("ab+", buffering=0)
        except OSError as error:
            raise _cannot_write(path, error) from error
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

    def write(self, frame: SkeletonFrame) -> None:
        """Append one frame.

        Raises
        ------
        OutputError
            If the system does not take it, say because the disk is full.
        """
        self._append(encode(frame))
        now = time.monotonic()
        if now - self._synced >= SYNC_INTERVAL:
            self._sync()
            self._synced = now

    def close(self) -> None:
        """Leave the recording complete on the disk. Closing again does nothing."""
        if not self._file.closed:
            with self._file:
                self._sync()

    def _missing_start(self) -> bytes:
        """Return what must stand before the next frame: the header, what a crash left out of it, or a line's end."""
        self._file.seek(0)
        start = self._file.read(len(HEADER))
        if start == HEADER:
            self._file.seek(-1, os.SEEK_END)
            return b"" if self._file.read(1) == b"\n" else b"\n"
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
            # Part of a line may be written. The next to open the file ends it; going on here would spoil a frame.
            self._file.close()
            raise _cannot_write(self.path, error) from error

    def _sync(self) -> None:
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            raise _cannot_write(self.path, error) from error


def encode(frame: SkeletonFrame) -> bytes:
    """Return a frame's line in a recording."""
    known = (frame.confidence > LOST) & np.isfinite(frame.positions).all(axis=1)
    rounded = np.round(frame.positions, DECIMALS).tolist()
    line = {
        "t": float(frame.time),
        "user": int(frame.user),
        "p": [position if seen else None for position, seen in zip(rounded, known, strict=True)],
        # str gives the shortest number that reads back as the same float32.
        "c": [float(str(value)) if seen else LOST for value, seen in zip(frame.confidence, known, strict=True)],
    }
    return json.dumps(line, allow_nan=False).encode() + b"\n"


def _cannot_write(path: Path, error: OSError) -> OutputError:
    return OutputError(
        path,
        found=error.strerror or str(error),
        expected="a file that can be written",
        fix="Choose another place, or make room or give permission there.",
    )
