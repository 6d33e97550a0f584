"""Recording of a source to a take."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from capture.events import Tick
from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from capture.source import SkeletonSource, wait
from capture.sources.replay import RecordingSource
from engine_bridge.cli.options import REPLACING
from puppetline.errors import OutputError, SourceError
from puppetline.files import check_new, check_writable


@dataclass(frozen=True)
class RecordSummary:
    """Summary of a take.

    Attributes
    ----------
    take : str
    source : str
        The URI that opened it.
    seconds : float
        Time from the first event to the last.
    frames : int
    users : tuple of int
        User numbers of the performers, sorted.
    dropped : int
        Number of frames that were dropped for newer ones.
    refused : dict
        Number of packets that could not be read, by reason.
    ended : str
        ``"time"``, ``"source"`` or ``"stopped"``: the seconds have passed, the source has ended, or Ctrl-C was pressed.
    why : str
        The error that ended a live source; empty otherwise.
    """

    take: str
    source: str
    seconds: float
    frames: int
    users: tuple[int, ...]
    dropped: int
    refused: dict[str, int]
    ended: str
    why: str = ""


def record(
    source: SkeletonSource,
    path: Path,
    seconds: float | None = None,
    report: Callable[[int, float], None] = lambda _frames, _seconds: None,
    force: bool = False,
) -> RecordSummary:
    """Write the events of a source to a take, until the seconds have passed, the source ends or Ctrl-C is pressed.

    The file is readable at any time. A source that fails before its first event leaves no file.

    Parameters
    ----------
    source : SkeletonSource
        It is left open.
    path : Path
    seconds : float, optional
        Duration on this machine's clock; without it, the source and Ctrl-C determine the end.
    report : callable
        Called after each batch of events with the number of frames so far and the seconds that have passed.
    force : bool
        Whether to replace an existing file.

    Raises
    ------
    OutputError
        The take cannot be written, or exists already.
    """
    _remove_existing(path, force)
    started = time.monotonic()
    deadline = math.inf if seconds is None else started + seconds
    frames = 0
    empty = True
    users: set[int] = set()
    first = last = None
    ended, why = "time", ""
    with Recorder(path) as recorder:
        try:
            while time.monotonic() < deadline:
                wait(source, deadline)
                for event in source.receive():
                    recorder.write(event)
                    empty &= isinstance(event, Tick)
                    first, last = event.time if first is None else first, event.time
                    if isinstance(event, SkeletonFrame):
                        frames += 1
                        users.add(event.user)
                report(frames, time.monotonic() - started)
        except SourceError as error:
            if isinstance(source, RecordingSource) and source.damaged:
                raise
            ended, why = "source", "" if source.recorded else str(error)
        except KeyboardInterrupt:
            ended = "stopped"
    if why and empty:
        path.unlink()
    return RecordSummary(
        take=str(path),
        source=source.name,
        seconds=0.0 if first is None or last is None else last - first,
        frames=frames,
        users=tuple(sorted(users)),
        dropped=source.counts.dropped,
        refused=dict(source.counts.refused),
        ended=ended,
        why=why,
    )


def _remove_existing(path: Path, force: bool) -> None:
    check_writable(path, path.suffix.lower())
    if not force:
        check_new(path, REPLACING)
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            path,
            found=f"a file that cannot be replaced ({error.strerror})",
            expected="a file that you may replace",
            fix="Choose another name with -o.",
        ) from error
