"""Parts of takes that one character plays one after another."""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from engine_bridge.performance.pose import Pose
from engine_bridge.service.players.appearance import Appearance
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.takes.take_track import TakeTrack
from solver.motion.deformer import Deformer

SAME_SECONDS = 1e-9
"""Difference of two times that are meant to be equal, from rounding, in seconds."""


@dataclass(frozen=True)
class TakePart:
    """A part of a take: the second of the timeline at which it begins, and its first and last second in the take."""

    track: TakeTrack
    at: float
    start: float
    stop: float

    @property
    def seconds(self) -> float:
        """Duration."""
        return min(self.stop, self.track.seconds) - self.start

    @property
    def sound(self) -> dict[str, Any] | None:
        """File of the take's sound, and the second of the timeline of its first sample."""
        sound = self.track.sound
        return None if sound is None else sound | {"at": self.at - self.start + sound["at"]}


class TakeParts:
    """The parts of takes that a character plays; a part ends when the next one begins.

    Parameters
    ----------
    parts : iterable of TakePart
        In any order, of one character.

    Attributes
    ----------
    parts : list of TakePart
        In the order in which they begin.
    at : float
        Second of the timeline at which the first one begins.
    times : list of float
        Times of the frames, in seconds after `at`.
    """

    def __init__(self, parts: Iterable[TakePart]) -> None:
        self.parts = sorted(parts, key=lambda part: part.at)
        self.at = self.parts[0].at
        self._frames: list[tuple[TakePart, int]] = []
        self.times: list[float] = []
        ends = [*(part.at for part in self.parts[1:]), float("inf")]
        for part, end in zip(self.parts, ends, strict=True):
            for number, time in enumerate(part.track.times):
                moment = part.at - self.at + (time - part.start)
                inside = part.start - SAME_SECONDS <= time <= part.stop + SAME_SECONDS
                if inside and moment < end - self.at:
                    self.times.append(moment)
                    self._frames.append((part, number))

    @property
    def seconds(self) -> float:
        """Time of the last frame."""
        return self.times[-1]

    def index(self, seconds: float) -> int:
        """Return the number of the frame that is shown at a time: the last one that is not later, or the first."""
        return max(0, bisect_right(self.times, seconds) - 1)

    def frame(self, number: int) -> tuple[Appearance, tuple[Deformer, Pose]]:
        """Return what a frame shows, see `TakeTrack.frame`."""
        part, own = self._frames[number]
        return part.track.frame(own)

    def fits(self, character: StreamedCharacter) -> bool:
        """Tell whether a character can show the frames, see `TakeTrack.fits`."""
        return all(part.track.fits(character) for part in self.parts)

    def is_cut(self, number: int, other: int) -> bool:
        """Tell whether two frames are of different parts."""
        return self._frames[number][0] is not self._frames[other][0]
