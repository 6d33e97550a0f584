"""Recording of a source to a take."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from capture.events import Cue, Tick
from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from capture.sound import ClockedSound, Microphone, WavWriter
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
    sound : str
        The sound beside the take; empty without one.
    sound_overflows : int
        Number of times that the microphone's samples were not read in time; silence replaces them.
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
    sound: str = ""
    sound_overflows: int = 0


def record(
    source: SkeletonSource,
    path: Path,
    seconds: float | None = None,
    report: Callable[[int, float], None] = lambda _frames, _seconds: None,
    force: bool = False,
    microphone: Microphone | None = None,
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
    microphone : Microphone, optional
        Its sound is written beside the take, as a .wav; it is left open.

    Raises
    ------
    OutputError
        The take cannot be written, or exists already.
    """
    remove_existing(path, force)
    sound = _Sound(microphone, path.with_suffix(".wav"), force)
    started = time.monotonic()
    deadline = math.inf if seconds is None else started + seconds
    frames = 0
    empty = True
    users: set[int] = set()
    first = last = None
    ended, why = "time", ""
    with Recorder(path) as recorder, sound:
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
                sound.follow(recorder, source, last)
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
        sound=sound.path,
        sound_overflows=sound.overflows,
    )


class _Sound:
    """The sound beside a take; nothing without a microphone."""

    def __init__(self, microphone: Microphone | None, path: Path, force: bool) -> None:
        self.path = ""
        self._microphone = microphone
        if microphone is not None:
            remove_existing(path, force)
            self.path = str(path)
            self._clocked, self._writer = ClockedSound(), WavWriter(path)
        self._stated = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._microphone is not None:
            self._write(self._microphone)
            self._writer.close()

    @property
    def overflows(self) -> int:
        """Number of times that samples were not read in time."""
        return 0 if self._microphone is None else self._microphone.overflows

    def follow(self, recorder: Recorder, source: SkeletonSource, last: float | None) -> None:
        """Write the sound that has arrived and, once, the cue that says when it began.

        Parameters
        ----------
        recorder : Recorder
        source : SkeletonSource
            Its clock is that of the take.
        last : float or None
            Time of the last event in the take; None before the first one.
        """
        if self._microphone is None:
            return
        self._write(self._microphone)
        if self._stated or last is None or self._clocked.start is None:
            return
        self._stated = True
        begin = self._clocked.start + source.now() - time.monotonic()
        recorder.write(Cue(last, "sound", {"file": Path(self.path).name, "at": begin}))

    def _write(self, microphone: Microphone) -> None:
        for block in microphone.blocks():
            self._writer.write(self._clocked.add(block))


def remove_existing(path: Path, force: bool) -> None:
    """Check that a file of this name can be written, and remove the one that is there if `force` allows it.

    Raises
    ------
    OutputError
        The file cannot be written, or exists already.
    """
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
