"""Writes a part of a recording as a recording of its own, so that it can be played."""

import math
import wave
from collections.abc import Iterator
from dataclasses import replace
from heapq import merge
from pathlib import Path

from capture import sound
from capture.events import Cue, Event, Lost
from capture.formats import puppetline_log, read_log, recognize
from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from engine_bridge.performance.channels import sound_cue
from puppetline.errors import SkeletonLogError
from puppetline.files import written_whole


def trimmed(log: Path, path: Path, start: float, stop: float) -> None:
    """Write the events of a recording from second `start` to second `stop` after its first skeleton.

    A take keeps its first cue, which has the performers and their calibrations, and the cues of later calibrations; if
    these are before the part, the last one of each character moves to its beginning. Other cues are omitted, because
    they refer to what was before. The same part of the sound beside it is written beside the part.

    Raises
    ------
    SkeletonLogError
        The recording cannot be read, or has no skeleton in that part.
    OutputError
    """
    count, begin, end = 0, math.inf, -math.inf
    with written_whole(path) as beside, Recorder(beside) as recorder:
        for event in _part(log, start, stop):
            count += isinstance(event, SkeletonFrame)
            begin, end = min(begin, event.time), event.time
            recorder.write(event)
        if not count:
            raise SkeletonLogError(
                log,
                found=f"no skeleton from second {start:g}" + ("" if math.isinf(stop) else f" to second {stop:g}"),
                expected="skeletons in the part that is played",
                fix="Choose an earlier start or a later stop.",
            )
        at = _trim_sound(log, path.with_suffix(sound.ENDING), begin, end)
        if at is not None:
            recorder.write(Cue(end, "sound", {"file": path.with_suffix(sound.ENDING).name, "at": at}))


def _trim_sound(log: Path, path: Path, begin: float, end: float) -> float | None:
    """Write the sound beside a take from one time to another; return the time of its first sample, None without any."""
    cues = (event for event in _events(log) if isinstance(event, Cue) and event.do == "sound")
    found = next((each for cue in cues if (each := sound_cue(cue)) is not None), None)
    if found is None:
        return None
    try:
        samples, rate = sound.read_wav(log.parent / found[0])
    except (OSError, EOFError, wave.Error):  # a missing sound is an error where the whole take is played
        return None
    first, last = (min(max(round((time - found[1]) * rate), 0), len(samples)) for time in (begin, end))
    with written_whole(path) as beside, sound.WavWriter(beside, rate) as writer:
        writer.write(samples[first:last])
    return found[1] + first / rate


def _part(log: Path, start: float, stop: float) -> Iterator[Event]:
    origin: float | None = None
    opening: Cue | None = None
    calibrations: dict[str, Cue] = {}  # the last of each character before the part
    for event in _events(log):
        if isinstance(event, SkeletonFrame) and origin is None:
            origin = event.time
        if isinstance(event, Cue) and event.do == "stage" and origin is None:
            opening = event
        calibrates = isinstance(event, Cue) and event.do == "begin"
        if origin is None or not (calibrates or isinstance(event, SkeletonFrame | Lost)):
            continue
        if event.time > origin + stop:
            return
        if event.time < origin + start:
            if isinstance(event, Cue):
                calibrations[str(event.arguments.get("character"))] = event
            continue
        if opening is not None:
            yield replace(opening, time=event.time)
            opening = None
        yield event
        if isinstance(event, SkeletonFrame):  # the calibrations require a performer
            yield from (replace(cue, time=event.time) for cue in calibrations.values())
            calibrations.clear()


def _events(log: Path) -> Iterator[Event]:
    if recognize(log) is puppetline_log:
        yield from puppetline_log.events(log)
    else:
        yield from merge(*(clip.frames() for clip in read_log(log)), key=lambda event: event.time)
