"""Processes that draw frames of a film beside the one that writes it: graphics in software mostly use a single core.

A process gets pickles at its standard input: what `Canvas` is made of, what `Canvas.add` takes, and then the frames. It
writes their pixels to its standard output. It ends when the film's process does, because that closes the pipes.
"""

import os
import pickle
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from io import FileIO
from itertools import cycle
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.drawing import Canvas, ShownFrame
from puppetline.child_process import processor_count
from puppetline.errors import PuppetlineError
from puppetline.interrupts import OWN_GROUP

MODULE = "engine_bridge.film.drawing_process"
"""Program of the process."""

MIN_PIXELS = 640 * 480
"""Size of a frame from which on other processes draw, too; smaller films are ready before these have started."""

MAX_PROCESSES = 4
"""Maximum number of processes that draw, each with 300 MB of memory: more draw faster than one encodes."""

AHEAD = 3
"""Maximum number of frames that a process has, so that it draws while this process is busy."""

PIPE_BYTES = 1 << 20
"""Size of the pipes where the system lets a program choose it. A frame has megabytes; smaller pipes make both processes
wait for each other many times in each."""


def processes_beside(canvas: Canvas) -> int:
    """Return the number of processes that draw beside this one: none where a graphics card does."""
    large = int(np.prod(canvas.renderer.size)) >= MIN_PIXELS
    return min(processor_count(), MAX_PROCESSES) - 1 if large and canvas.renderer.in_software else 0


class DrawingProcess:
    """A process that draws frames as a canvas of this process does.

    Raises
    ------
    PuppetlineError
        It has ended; by any method.
    """

    def __init__(self, canvas: Canvas) -> None:
        width, height = canvas.renderer.size
        self._shape = height, width, 4
        pipes: dict[str, Any] = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "pipesize": PIPE_BYTES}
        command = [sys.executable, "-P", "-m", MODULE]
        self._process = subprocess.Popen(command, **pipes, **OWN_GROUP)  # noqa: S603 - Ctrl-C ends it through this process
        self.send(canvas.setup)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        with suppress(OSError), self._process:  # waits, and closes the pipes; what it has not read cannot be sent
            pass

    def send(self, message: object) -> None:
        """Send what `Canvas` takes, then what `Canvas.add` takes, and then frames."""
        pipe: Any = self._process.stdin
        try:
            pickle.dump(message, pipe, pickle.HIGHEST_PROTOCOL)
            pipe.flush()
        except OSError as error:
            raise _ended() from error

    def drawn(self) -> NDArray[np.uint8]:
        """Return the pixels (h, w, 4) of the next of its frames."""
        pipe: Any = self._process.stdout
        pixels = np.empty(self._shape, np.uint8)
        if pipe.readinto(pixels.data.cast("B")) < pixels.nbytes:
            raise _ended()
        return pixels


def draw_in_order(
    frames: Iterable[ShownFrame], canvas: Canvas, others: Sequence[DrawingProcess]
) -> Iterator[NDArray[np.uint8]]:
    """Yield the pixels (h, w, 4) of frames, which other processes and this one draw in turn.

    Raises
    ------
    PuppetlineError
        A process has ended.
    """
    waiting = deque[Callable[[], NDArray[np.uint8]]]()
    for frame, other in zip(frames, cycle((*others, None)), strict=False):
        if other is None:
            waiting.append(partial(canvas.draw, frame))
        else:
            other.send(frame)
            waiting.append(other.drawn)
        if len(waiting) > (AHEAD - 1) * (len(others) + 1) or not others:
            yield waiting.popleft()()
    while waiting:
        yield waiting.popleft()()


def _ended() -> PuppetlineError:
    return PuppetlineError(
        "the film",
        found="a process that ended while it drew frames",
        expected="processes that draw until the film ends",
        fix="Read its output. The memory may be too small; if so, choose a smaller size.",
    )


def main() -> None:
    """Draw frames until the film's process ends."""
    messages, pixels = sys.stdin.buffer, FileIO(os.dup(1), "wb")
    os.dup2(2, 1)  # output of libraries must not mix with the pixels
    # pixels are sent while the next frame is drawn or read, so that neither process waits for the other to read
    with (
        suppress(EOFError, pickle.UnpicklingError),
        ThreadPoolExecutor(1) as sending,
        Canvas(*pickle.load(messages)) as canvas,  # noqa: S301 - the film's process wrote it
    ):
        canvas.add(*pickle.load(messages))  # noqa: S301
        while True:
            sending.submit(_send, pixels, canvas.draw(pickle.load(messages)))  # noqa: S301


def _send(file: FileIO, pixels: NDArray[np.uint8]) -> None:
    rest = pixels.data.cast("B")
    while rest:
        rest = rest[file.write(rest) :]


if __name__ == "__main__":
    main()
