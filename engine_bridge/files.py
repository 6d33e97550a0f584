"""Results that are there whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from puppetline.errors import OutputError


def check_writable(path: Path) -> None:
    """Find out before the work, not after it, whether a result can be written.

    Raises
    ------
    OutputError
    """
    folder = path.parent
    try:
        if path.is_dir():
            raise OutputError(path, found="a folder", expected="a file name", fix="Add a file name to the path.")
        if not folder.is_dir():
            raise OutputError(
                path, found=f"no folder {folder}", expected="an existing folder", fix=f"Make it: mkdir -p {folder}"
            )
        beside = _beside(path)
        beside.touch()
        beside.unlink()
    except OSError as error:
        raise _refused(path, error) from error


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a name beside `path` to write to, and rename it when the block has ended well.

    Raises
    ------
    OutputError
        Whatever the operating system has against it: no room, no permission.
    """
    beside = _beside(path)
    try:
        try:
            yield beside
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise _refused(path, error) from error


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")


def _refused(path: Path, error: OSError) -> OutputError:
    return OutputError(
        path,
        found=f"that it cannot be written ({error.strerror})",
        expected="a folder that you may write to, with room left",
        fix="Choose another place with -o, or change the folder's permissions.",
    )
