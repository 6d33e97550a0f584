"""Opening of recordings, with an error that a user understands."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from puppetline.errors import SkeletonLogError

HEAD_BYTES = 65536
"""Length of the part of a file by which its format is detected."""


@contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file for reading; raise `SkeletonLogError` if it cannot be opened or read."""
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise SkeletonLogError(
            path,
            found=f"a file that cannot be read ({error.strerror})",
            expected="a readable recording",
            fix="Check the path and its permissions.",
        ) from error
