"""Recording of a source to a take."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from capture.events import Cue, Tick
from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from capture.sound_input import SoundInput
from capture.source import SkeletonSource, wait
from puppetline import clock
from puppetline.errors import RecordingEndError, SourceError
from puppetline.files import check_new, check_writable, output_errors


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
        The error that ended the source; empty if it ended as it should.
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
    sound: SoundInput | None = None,
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
    sound : SoundInput, optional
        It is written beside the take, as a .wav, and left open.

    Raises
    ------
    OutputError
        The take cannot be written, or exists already.
    """
    remove_existing(path, force)
    started = clock.now()
    deadline = math.inf if seconds is None else started + seconds
    frames = 0
    empty = True
    users: set[int] = set()
    first = last = None
    ended, why = "time", ""
    sound_path = path.with_suffix(".wav")
    with _written_beside(sound, sound_path, force) as follow_sound, Recorder(path) as recorder:
        try:
            while clock.now() < deadline:
                wait(source, deadline)
                for event in source.receive():
                    recorder.write(event)
                    empty &= isinstance(event, Tick)
                    first, last = event.time if first is None else first, event.time
                    if isinstance(event, SkeletonFrame):
                        frames += 1
                        users.add(event.user)
                follow_sound(recorder, source, last)
                report(frames, clock.now() - started)
        except RecordingEndError:
            ended = "source"
        except SourceError as error:
            ended, why = "source", str(error)
        except KeyboardInterrupt:
            ended = "stopped"
    if why and empty:
        path.unlink()
    if not frames:
        why = why or f"{source.name}: no performer was in view"
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
        sound="" if sound is None else str(sound_path),
        sound_overflows=0 if sound is None else sound.overflows,
    )


@contextmanager
def _written_beside(
    sound: SoundInput | None, path: Path, force: bool
) -> Iterator[Callable[[Recorder, SkeletonSource, float | None], None]]:
    """Write a sound beside a take; yield a function that continues it and writes, once, the cue of its beginning.

    The function takes the take's recorder, the source, whose clock is that of the take, and the time of the last event.
    """
    if sound is None:
        yield lambda _recorder, _source, _last: None
        return
    remove_existing(path, force)
    sound.record(path)
    stated = False

    def follow(recorder: Recorder, source: SkeletonSource, last: float | None) -> None:
        nonlocal stated
        sound.take_in()
        if not stated and last is not None and sound.start is not None:
            stated = True
            begin = sound.start + source.now() - clock.now()
            recorder.write(Cue(last, "sound", {"file": path.name, "at": begin}))

    try:
        yield follow
        sound.take_in()
    finally:
        sound.stop()


def remove_existing(path: Path, force: bool) -> None:
    """Check that a file of this name can be written, and remove the one that is there if `force` allows it.

    Raises
    ------
    OutputError
        The file cannot be written, or exists already.
    """
    check_writable(path, path.suffix.lower())
    if not force:
        check_new(path)
    with output_errors(path):
        path.unlink(missing_ok=True)
