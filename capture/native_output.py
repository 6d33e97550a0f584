"""Sends what native libraries (MediaPipe, OpenCV, FFmpeg, OpenNI2) write to the standard streams to the debug log."""

import ctypes
import faulthandler
import logging
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

_Streams = tuple[TextIO, TextIO]

_CLOSE_SECONDS = 0.3  # maximum time that closing waits for the last lines

log = logging.getLogger(__name__)


@contextmanager
def logged() -> Iterator[None]:
    """Send the output of native libraries to the debug log, so that users and programs read only Puppetline's.

    Python's own output goes to the same place as before, through other file descriptors.
    """
    before = sys.stdout, sys.stderr
    if sys.platform == "win32" or None in before or not _are_the_systems(before):
        yield  # other code has replaced the streams
        return
    for stream in before:
        stream.flush()
    kept = os.dup(1), os.dup(2)
    read, write = os.pipe()
    for descriptor in (1, 2):
        os.dup2(write, descriptor)
    after = _on(kept[0], before[0]), _on(kept[1], before[1])
    _bind(before, after)
    os.set_blocking(write, False)  # output that does not fit into the pipe is lost, and nothing waits
    os.close(write)
    faulthandler.enable(after[1])  # a crash is no debug message
    reader = threading.Thread(target=_log, args=[read], name="native output", daemon=True)
    reader.start()
    try:
        yield
    finally:
        faulthandler.disable()
        for stream in after:
            stream.flush()
        ctypes.CDLL(None).fflush(None)  # C has buffers of its own
        for descriptor, original in zip((1, 2), kept, strict=True):
            os.dup2(original, descriptor)
        _bind(after, before)
        reader.join(_CLOSE_SECONDS)


def _are_the_systems(streams: _Streams) -> bool:
    return streams == (sys.__stdout__, sys.__stderr__)


def _on(descriptor: int, like: TextIO) -> TextIO:
    return open(descriptor, "w", buffering=1, encoding=like.encoding, errors=like.errors)


def _bind(before: _Streams, after: _Streams) -> None:
    """Make Python and its logs write to other streams."""
    sys.stdout, sys.stderr = after
    for handler in logging.getLogger().handlers:
        if isinstance(handler, logging.StreamHandler) and handler.stream in before:
            handler.setStream(after[before.index(handler.stream)])


def _log(descriptor: int) -> None:
    with open(descriptor, "rb") as lines:
        for line in lines:
            log.debug("%s", line.decode(errors="replace").rstrip())
