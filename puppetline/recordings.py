"""Recordings and live sources of skeletons, for programs."""

import math
from collections.abc import Iterator
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from capture.formats import FORMATS, recognize
from capture.formats.options import ReadOptions
from capture.sensors.recorded_video import read_recording
from capture.skeleton import SkeletonFrame
from capture.source import newest, wait
from capture.sources import registry
from capture.timeline import Timeline, choose
from engine_bridge.performance.clip import resting_pose, timeline_of
from engine_bridge.performance.settings import Settings
from puppetline.errors import RecordingEndError


class Recording:
    """One performer of a recording; `puppetline.load_recording` reads it.

    Attributes
    ----------
    path : Path
    user : int
        User number of the performer.
    users : tuple of int
        User numbers of all performers in the file.
    notes : tuple of str
        Sentences about what was assumed, skipped or held.
    options : ReadOptions
        What the reader was told.
    """

    def __init__(self, path: Path, user: int | None, options: ReadOptions) -> None:
        self.path = path
        self.options = options
        self.clips = read_recording(path, options)
        module = recognize(path, options)
        self._kind = FORMATS[module.__name__.rpartition(".")[2]] if module else "recording"
        self.user, self.users = choose(self.clips, user)[0].user, tuple(clip.user for clip in self.clips)
        self._timeline, self.notes = timeline_of(self.clips, path, Settings(user=self.user))

    @property
    def seconds(self) -> float:
        """Duration, in seconds."""
        return float(self._timeline.times[-1])

    @property
    def rest_pose(self) -> NDArray[np.float64]:
        """(20, 3): the performer's pose that corresponds to a character's rest pose; metres, sensor coordinates.

        It is the calibration that a take contains, otherwise the median pose of the first half second. Joints that
        are never known are NaN.
        """
        return resting_pose(self._timeline, Settings())

    def frames(self, fps: float = 30.0) -> Iterator[SkeletonFrame]:
        """Yield the performer's frames at a constant rate.

        Parameters
        ----------
        fps : float
            Frames per second.

        Yields
        ------
        SkeletonFrame
            ``positions`` (20, 3) in metres and ``confidence`` (20,), in the order of `capture.skeleton.JOINTS`.
        """
        timeline = self.timeline(fps)
        return (replace(timeline.frame(number), user=self.user) for number in range(len(timeline.positions)))

    def timeline(self, fps: float = 30.0) -> Timeline:
        """Return all frames at a constant rate: ``positions`` (T, 20, 3), ``confidence`` (T, 20), ``times`` (T,)."""
        return timeline_of(self.clips, self.path, Settings(user=self.user, fps=fps))[0]

    def __repr__(self) -> str:
        of = f"user {self.user} of {len(self.users)}, " if len(self.users) > 1 else ""
        return f"<puppetline.Recording {self.path.name}: {of}{self.seconds:.1f} s, {self._kind}>"


class LiveSource:
    """A live source of skeletons: a context manager, and an iterator over the frames of all performers.

    Iteration waits for frames. It ends where a recording ends, and when the source is closed. Frames that a newer one
    of the same performer has overtaken are left out.

    Raises
    ------
    SourceError
        While it iterates: the device is disconnected, or the recording is damaged.
    """

    def __init__(self, uri: str) -> None:
        self._source, self._is_closed = registry.open_source(uri), False

    def __iter__(self) -> Iterator[SkeletonFrame]:
        while not self._is_closed:
            wait(self._source, math.inf)
            try:
                events = self._source.receive()
            except RecordingEndError:
                return
            yield from (event for event in newest(events) if isinstance(event, SkeletonFrame))

    def close(self) -> None:
        """Close sockets and files; closing again does nothing."""
        self._is_closed = True
        self._source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<puppetline.LiveSource {self._source.name}>"


def load_recording(
    path: str | PathLike[str],
    user: int | None = None,
    *,
    fps: float | None = None,
    up: Literal["y", "z"] | None = None,
    unit: float | None = None,
) -> Recording:
    """Read a recording of skeletons in any supported format (docs/recordings.md).

    Parameters
    ----------
    path : path
    user : int, optional
        User number of the performer; by default the one that is tracked longest.
    fps : float, optional
        Frames per second, for a format without a clock.
    up : "y" or "z", optional
        Axis that points up, for a format that does not fix it (BVH).
    unit : float, optional
        Metres per unit of length, for a format that does not fix it (BVH).

    Raises
    ------
    SkeletonLogError
        The file cannot be read, has no supported format, or has no such performer.
    """
    return Recording(Path(path), user, ReadOptions(fps, up, unit))


def open_source(uri: str) -> LiveSource:
    """Open a live source of skeletons, such as ``"camera:0"``, ``"osc:7110"`` or ``"demo:walk"`` (docs/sensors.md).

    Raises
    ------
    PuppetlineError
        The scheme is unknown, or the source cannot be opened.
    """
    return LiveSource(uri)
