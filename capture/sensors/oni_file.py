"""Checks of an .oni recording before OpenNI2 reads it: OpenNI2 2.2 can crash on an incomplete or damaged file.

A recording is a header of 24 bytes and a sequence of records up to an end record. Each record begins with its magic
number, type, node, size of its header with its fields, size of its data, and the position of the record that it
replaces.
"""

import struct
import subprocess
import sys
from pathlib import Path

from puppetline.errors import SourceError

_FILE_MAGIC, _RECORD_MAGIC = b"NI10", b"NIR\0"
_FILE_HEADER_BYTES = 24
_RECORD_HEADER = struct.Struct("<4sIIIIQ")
_END_TYPE = 11

_PLAY_SECONDS = 20.0  # maximum time for another process to start and play the beginning
_PLAY = """
import os, sys
sys.path[:] = sys.argv[2:]
from capture.sensors.openni import OpenNIDevice, Selection
from puppetline.errors import SourceError
try:
    device = OpenNIDevice("", Selection("file", sys.argv[1]))
    for _ in range(5):
        device.read(0.2)
except SourceError:
    pass  # the process that plays the recording raises it again
os._exit(0)
"""


def check_intact(where: str, path: Path) -> None:
    """Check that a recording is a complete sequence of records.

    Raises
    ------
    SourceError
        About `where`: the file cannot be read, is not a recording, or is damaged or incomplete.
    """
    try:
        damage = _find_damage(path)
    except OSError as error:
        raise SourceError(
            where,
            found=f"{path}, which cannot be read ({error.strerror})",
            expected="an .oni recording",
            fix="Check its name, its folder and its permissions.",
        ) from error
    if damage is not None:
        raise SourceError(
            where,
            found=f"{path}, which is damaged at byte {damage}" if damage else f"{path}, which is another kind of file",
            expected="an intact .oni recording",
            fix="Record it again, and stop recording before you close the program that records.",
        )


def check_plays(where: str, path: Path) -> None:
    """Play the beginning of a recording in another process, because the library may crash.

    `check_intact` cannot detect this. Of single damaged bytes in the names and values of a stream's properties, one in
    five makes OpenNI2 2.2 crash or hang, although every record begins and ends where it should.

    Raises
    ------
    SourceError
        About `where`: the library crashes or hangs. Errors that the library reports are not raised.
    """
    command = [sys.executable, "-c", _PLAY, str(path), *sys.path]
    try:
        subprocess.run(command, capture_output=True, timeout=_PLAY_SECONDS, check=True)  # noqa: S603
    except subprocess.SubprocessError as error:
        hangs = isinstance(error, subprocess.TimeoutExpired)
        raise SourceError(
            where,
            found=f"{path}, on which OpenNI2 {'hangs' if hangs else 'crashes'}",
            expected="an intact .oni recording",
            fix="Record it again.",
        ) from error


def _find_damage(path: Path) -> int | None:
    """Return the position of the first bad record, 0 if the file is not a recording, and None if it is intact."""
    with path.open("rb") as file:
        if file.read(len(_FILE_MAGIC)) != _FILE_MAGIC:
            return 0
        position = _FILE_HEADER_BYTES
        while True:
            file.seek(position)
            header = file.read(_RECORD_HEADER.size)
            if len(header) < _RECORD_HEADER.size:
                return position
            magic, kind, _, header_size, data_size, _ = _RECORD_HEADER.unpack(header)
            if magic != _RECORD_MAGIC or header_size < _RECORD_HEADER.size:
                return position
            if kind == _END_TYPE:
                return None
            position += header_size + data_size
