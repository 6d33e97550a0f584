"""Whether an .oni recording is whole: OpenNI2 2.2 can crash on one that was cut off.

A recording is a head of 24 bytes and then records, one behind the other, up to the one that ends it. Each begins with
its magic, type, node, its own size with this head, that of the data behind it, and where it replaces an earlier one.
"""

import struct
from pathlib import Path

from puppetline.errors import SourceError

_FILE, _RECORD = b"NI10", b"NIR\0"
_FIRST = 24
_HEAD = struct.Struct("<4sIIIIQ")
_END = 11


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
            found=f"that {path} cannot be read ({error.strerror})",
            expected="an .oni recording",
            fix="Look after its name, its folder and who may read it.",
        ) from error
    if damage is not None:
        raise SourceError(
            where,
            found=f"{path}, which is damaged at byte {damage}" if damage else f"{path}, which is something else",
            expected="a whole .oni recording",
            fix="Record it again, and end recording before the program that records.",
        )


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
