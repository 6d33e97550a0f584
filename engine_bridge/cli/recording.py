"""Recording of a source to a take."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

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
    _remove_existing(path, force)
    sound = None if microphone is None else _Sound(microphone, path.with_suffix(".wav"), force)
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
                if sound is not None and (cue := sound.write(source.now())) is not None:
                    recorder.write(cue)
                report(frames, time.monotonic() - started)
        except SourceError as error:
            if isinstance(source, RecordingSource) and source.damaged:
                raise
            ended, why = "source", "" if source.recorded else str(error)
        except KeyboardInterrupt:
            ended = "stopped"
        finally:
            if sound is not None:
                sound.close()
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
        sound="" if sound is None else str(sound.path),
        sound_overflows=0 if microphone is None else microphone.overflows,
    )


class _Sound:
    """The sound beside a take."""

    def __init__(self, microphone: Microphone, path: Path, force: bool) -> None:
        _remove_existing(path, force)
        self.path = path
        self._microphone, self._clocked, self._writer = microphone, ClockedSound(), WavWriter(path)

    def write(self, now: float) -> Cue | None:
        """Write the sound that has arrived; when it begins, return the cue that says when.

        `now` is the time on the source's clock, which is that of the take.
        """
        begins = self._clocked.start is None
        for block in self._microphone.blocks():
            self._writer.write(self._clocked.add(block))
        if begins and self._clocked.start is not None:
            begin = self._clocked.start + now - time.monotonic()
            return Cue(now, "sound", {"file": self.path.name, "at": begin})
        return None

    def close(self) -> None:
        self.write(0.0)
        self._writer.close()


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
