"""Storage of solved frames, in a temporary file if they are large."""

import tempfile
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from puppetline.errors import OutputError

MAX_MEMORY_BYTES = 32_000_000
"""Maximum size of frames in memory, in bytes."""


class FrameStore:
    """An array of frames that grows at its end and is read in chunks.

    Parameters
    ----------
    shape : tuple of int
        Shape of a frame.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._shape = shape
        self._size = 4 * int(np.prod(shape))
        self._count = 0
        self._file = tempfile.SpooledTemporaryFile(max_size=MAX_MEMORY_BYTES)  # noqa: SIM115  # deleted with this object

    def append(self, frames: NDArray[np.floating]) -> None:
        """Add some (F, …) frames, as float32.

        Raises
        ------
        OutputError
            No space is left for temporary files.
        """
        try:
            self._file.seek(self._count * self._size)
            self._file.write(np.ascontiguousarray(frames, dtype=np.float32).tobytes())
            self._file.flush()
        except OSError as error:
            with suppress(OSError):  # closing flushes the buffer, which fails too
                self._file.close()
            raise OutputError(
                "the folder for temporary files",
                found=error.strerror or str(error),
                expected=f"space for the frames of a long clip, {self._size * 108_000 / 1e6:.0f} MB per hour",
                fix="Free space, grant access to the folder, or set another folder in the environment variable TMPDIR.",
            ) from error
        self._count += len(frames)

    def __len__(self) -> int:
        """Return the number of frames."""
        return self._count

    def __getitem__(self, chosen: int | slice | NDArray[np.integer]) -> NDArray[np.float32]:
        """Return frames as an array would."""
        if isinstance(chosen, int | np.integer):
            return self._read(range(self._count)[chosen], 1)[0]
        numbers = np.arange(self._count)[chosen]
        if len(numbers) and np.array_equal(numbers, np.arange(numbers[0], numbers[0] + len(numbers))):
            return self._read(int(numbers[0]), len(numbers))
        rows = [self._read(int(number), 1)[0] for number in numbers]
        return np.array(rows, dtype=np.float32).reshape(-1, *self._shape)

    def __iter__(self) -> Iterator[NDArray[np.float32]]:
        """Yield the frames."""
        return (self._read(number, 1)[0] for number in range(self._count))

    def _read(self, first: int, count: int) -> NDArray[np.float32]:
        self._file.seek(first * self._size)
        return np.frombuffer(self._file.read(count * self._size), dtype=np.float32).reshape(count, *self._shape)


Frames = FrameStore | NDArray[np.float32]
"""Frames of a clip, which are read in chunks."""


def evenly(n: int, count: int) -> NDArray[np.int64]:
    """Return up to `count` evenly spaced, ascending indices below n, including the first and the last."""
    return np.unique(np.linspace(0, n - 1, min(n, count)).astype(np.int64))
