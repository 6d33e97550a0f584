"""Whether an .oni recording is whole and plays: OpenNI2 2.2 can crash on one that was cut off or is damaged.

A recording is a head of 24 bytes and then records, one behind the other, up to the one that ends it. Each begins with
its magic, type, node, its own size with this head, that of the data behind it, and where it replaces an earlier one.
"""

import struct
import subprocess
import sys
from pathlib import Path

from puppetline.errors import SourceError

_FILE, _RECORD = b"NI10", b"NIR\0"
_FIRST = 24
_HEAD = struct.Struct("<4sIIIIQ")
_END = 11

_PATIENCE = 20.0  # seconds for another process to start and play the beginning
_PLAY = """
import os, sys
sys.path[:] = sys.argv[2:]
from capture.sensors.openni import OpenNIDevice, Place
from puppetline.errors import SourceError
try:
    device = OpenNIDevice("", Place("file", sys.argv[1]))
    for _ in range(5):
        device.read(0.2)
except SourceError:
    pass  # which is found again, by who wants to play it
os._exit(0)
"""


def check_whole(where: str, path: Path) -> None:
    """Go through a recording from record to record.

    Parameters
    ----------
    where : str
        Who asks, for the message.
    path : Path

    Raises
    ------
    SourceError
        There is no such file, it is no recording, or it is damaged or cut off.
    """
    try:
        damage = _damage(path)
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
            found=f"{path}, which is damaged at byte {damage}" if damage else f"{path}, which is something else",
            expected="a whole .oni recording",
            fix="Record it again, and end recording before the program that records.",
        )


def check_plays(where: str, path: Path) -> None:
    """Have another process play the beginning, in which the library may crash.

    `check_whole` cannot tell: of single damaged bytes in the names and values that a stream's properties have, every
    fifth crashes OpenNI2 2.2 or has it hang, though each record begins and ends where it should.

    Parameters
    ----------
    where : str
        Who asks, for the message.
    path : Path

    Raises
    ------
    SourceError
        It crashes, or never comes back. What it says itself is not raised.
    """
    command = [sys.executable, "-c", _PLAY, str(path), *sys.path]
    try:
        subprocess.run(command, capture_output=True, timeout=_PATIENCE, check=True)  # noqa: S603
    except subprocess.SubprocessError as error:
        hangs = isinstance(error, subprocess.TimeoutExpired)
        raise SourceError(
            where,
            found=f"{path}, on which OpenNI2 {'hangs' if hangs else 'crashes'}",
            expected="a whole .oni recording",
            fix="Record it again.",
        ) from error


def _damage(path: Path) -> int | None:
    """Return where the first record that is none should be, 0 if the file is no recording; None if it is whole."""
    with path.open("rb") as file:
        if file.read(len(_FILE)) != _FILE:
            return 0
        place = _FIRST
        while True:
            file.seek(place)
            head = file.read(_HEAD.size)
            if len(head) < _HEAD.size:
                return place
            magic, kind, _, own, data, _ = _HEAD.unpack(head)
            if magic != _RECORD or own < _HEAD.size:
                return place
            if kind == _END:
                return None
            place += own + data
