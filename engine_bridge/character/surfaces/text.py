"""Reads text files line by line, with errors that name the line."""

from collections.abc import Iterator
from pathlib import Path

from engine_bridge.character.surfaces.surface import MAX_COORDINATE, damaged
from puppetline.errors import MeshError, at


def decoded(path: Path, content: bytes) -> str:
    r"""Return a text file's content with "\\n" for every kind of line end.

    Raises
    ------
    MeshError
        The file has zero bytes.
    """
    zero = content.find(b"\0")
    if zero >= 0:
        line = content.count(b"\n", 0, zero) + 1
        raise damaged(at(path, line=line), "bytes that are not text", "a text file")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:  # names in an old Windows encoding
        text = content.decode("cp1252", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def filled_lines(text: str, comment: str = "\n") -> Iterator[tuple[int, str]]:
    """Return the number, from 1, and the text of each line that is not blank, without spaces around it and comments."""
    for number, line in enumerate(text.split("\n"), 1):
        if filled := line.partition(comment)[0].strip():
            yield number, filled


def unreadable(path: Path, line: int, text: str, expected: str) -> MeshError:
    """Return the error for a line that cannot be read, which quotes `text`."""
    quoted = repr(text if len(text) <= 60 else f"{text[:60]}…")
    return damaged(at(path, line=line), quoted, expected)


def position(words: list[str]) -> list[float]:
    """Return the coordinates x, y, z with which a line begins.

    Raises
    ------
    ValueError
        There are fewer numbers, or one is not finite or exceeds the maximum coordinate.
    """
    x, y, z = map(float, words[:3])
    if not (abs(x) <= MAX_COORDINATE and abs(y) <= MAX_COORDINATE and abs(z) <= MAX_COORDINATE):
        raise ValueError("a coordinate out of range")
    return [x, y, z]
