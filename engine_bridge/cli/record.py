"""From a live source into a take: `puppetline record`."""

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
from puppetline.errors import OutputError, SourceError
from puppetline.files import check_writable


@dataclass(frozen=True)
class RecordSummary:
    """What was recorded.

    Attributes
    ----------
    take : str
    source : str
        The URI that opened it.
    seconds : float
        From the first event to the last.
    frames : int
    users : tuple of int
        The performers seen, in the order of their numbers.
    dropped : int
        Frames that newer ones have overtaken.
    refused : dict
        Packets that were not understood, by the reason.
    ended : str
        ``"time"``, ``"source"`` or ``"stopped"``: the seconds were over, the source has ended, somebody stopped it.
    why : str
        What is wrong with a source that has ended, though no recording; empty for others.
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
    """Write what a source gives to a take, until the time is over, the source ends or Ctrl-C.

    Whatever happens, what has come so far is in the file and can be read. A source that fails before anything has come
    leaves no file.

    Parameters
    ----------
    source : SkeletonSource
        It is not closed.
    path : Path
    seconds : float, optional
        How long, on this machine's clock; as long as there is something to record where it is not given.
    report : callable
        Told after each batch of events: how many frames there are, and how many seconds have passed.
    force : bool
        Whether a file of that name may be replaced.

    Raises
    ------
    OutputError
        If the take cannot be written, or is there already.
    """
    _make_way(path, force)
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


def _make_way(path: Path, force: bool) -> None:
    check_writable(path, path.suffix.lower())
    if path.exists() and not force:
        raise OutputError(
            path, found="a file", expected="a new name", fix="Choose another name, or replace it with --force."
        )
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(
            path,
            found=f"that it cannot be replaced ({error.strerror})",
            expected="a file of your own",
            fix="Choose another name with -o.",
        ) from error
