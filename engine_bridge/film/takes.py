"""Takes on a film's clock: solved recordings of a character, and the parts of them that it plays one after another."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from capture.sensors.recorded_video import read_recording
from capture.sound import is_wav
from capture.timeline import choose
from engine_bridge.film.scene import SceneError, SoundTable, TakeTable
from engine_bridge.performance.channels import sound_of
from engine_bridge.performance.clip import solve, timeline_of
from engine_bridge.performance.motion import SolvedMotion
from engine_bridge.performance.pose import Pose
from engine_bridge.performance.prepared_character import PreparedCharacter
from engine_bridge.performance.settings import Settings
from puppetline.errors import at


class TakeSound(NamedTuple):
    """The sound that was recorded beside a take, a file that can be read.

    Attributes
    ----------
    path : Path
    begin : float
        Time of its first sample after the take's first frame, in seconds; negative if it began earlier.
    """

    path: Path
    begin: float


class SolvedTake(NamedTuple):
    """A recording that is solved for a character, its sound, and notes about the recording."""

    motion: SolvedMotion
    sound: TakeSound | None
    notes: tuple[str, ...]


class PlayedTake(NamedTuple):
    """A take of a scene file: its number from 1, its table, and its first frame and the one after its last one."""

    number: int
    table: TakeTable
    solved: SolvedTake
    first: int
    end: int


class Place(NamedTuple):
    """Where a character stands in a frame.

    Attributes
    ----------
    position : (3,) float64
        Metres to the right, up and to the front, of its origin on the floor.
    turn : float
        Degrees to its left.
    """

    position: NDArray[np.float64]
    turn: float


@dataclass(frozen=True)
class Segment:
    """A part of a take on the film's clock, in frames.

    Attributes
    ----------
    motion : SolvedMotion
    begin : int
        Frame of the film at which it begins.
    first, end : int
        Frames of the take: the first one, and the one after the last one.
    fade : int
        Length of the cross-fade from the segment before it, which begins with it.
    place : Place
    sound : TakeSound or None
    """

    motion: SolvedMotion
    begin: int
    first: int
    end: int
    fade: int
    place: Place
    sound: TakeSound | None

    def pose(self, frame: int) -> Pose:
        """Return the pose at a frame of the film; the first one before the segment, the last one after it."""
        return self.motion[min(max(frame - self.begin + self.first, self.first), self.end - 1)]

    def root_on_stage(self, frame: int, footing: "Footing") -> NDArray[np.float64]:
        """Return where the root is on the stage (3,) at a frame of the film."""
        way: NDArray[np.float64] = self.place.position + self.pose(frame).root @ footing.linear(self.place.turn)
        return way


class Footing:
    """The size of a character, and the directions of its coordinates on the film's stage.

    Parameters
    ----------
    height : float or None
        Metres; None for the height of the puppet file.
    prepared : PreparedCharacter

    Attributes
    ----------
    basis : (3, 3) float64
        Rows are the mesh's directions of the character's left, up and front.
    scale : float
        Metres per mesh unit.
    low : float
        Height of the lowest vertex at rest, mesh units.
    height : float
        Metres.
    """

    def __init__(self, height: float | None, prepared: PreparedCharacter) -> None:
        self.basis, self._vertices = prepared.puppet.character.basis, prepared.character.vertices
        up = self._vertices @ self.basis[1]
        self.low, tall = float(up.min()), float(np.ptp(up))
        self.scale = prepared.puppet.character.scale if height is None else height / max(tall, 1e-12)
        self.height = self.scale * tall

    @property
    def lift(self) -> NDArray[np.float64]:
        """What is subtracted from a position (3,) on the floor, so that the lowest vertex stands there."""
        return np.array([0, self.scale * self.low, 0])

    def span(self, turn: float) -> tuple[float, float]:
        """Return how far the character reaches to the left and to the right of its origin at rest, in metres."""
        x = self._vertices @ self.linear(turn)[:, 0]
        return float(x.min()), float(x.max())

    def linear(self, turn: float) -> NDArray[np.float64]:
        """Return the map (3, 3) of row vectors from mesh units to metres on the stage, after a turn in degrees."""
        angle = np.radians(turn)
        around = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
        moved: NDArray[np.float64] = self.scale * self.basis.T @ around
        return moved


def solve_take(
    prepared: PreparedCharacter, log: Path, settings: Settings, progress: Callable[[float], None]
) -> SolvedTake:
    """Solve all frames of a recording for a character.

    Raises
    ------
    PuppetlineError
    """
    clips = read_recording(log, replace(settings.log, animals=True))
    timeline, notes = timeline_of(clips, log, settings)
    motion = solve(prepared, timeline, settings, progress)
    sound = sound_of(choose(clips, settings.user)[0], log)
    return SolvedTake(motion, None if sound is None or not is_wav(sound[0]) else TakeSound(*sound), notes)


def played_take(number: int, take: TakeTable, solved: SolvedTake, fps: float, scene: Path) -> PlayedTake:
    """Return a take with the frames of it that are played.

    Raises
    ------
    SceneError
        The part is outside its recording.
    """
    count = len(solved.motion)
    first = round(take.start * fps)
    end = count if take.stop is None else min(round(take.stop * fps) + 1, count)
    if end - first < 2:
        raise SceneError(
            at(scene, field=f"[[take]] {number}, start"),
            found=f"{take.start:g} s in a recording of {(count - 1) / fps:.2f} s",
            expected="at least two frames of the recording",
            fix="Choose an earlier start or a later stop.",
        )
    return PlayedTake(number, take, solved, first, end)


def sound_table(segment: Segment, fps: float) -> SoundTable | None:
    """Return the part of its take's sound that belongs to a segment; None if it has none."""
    if segment.sound is None:
        return None
    start, stop = (frame / fps - segment.sound.begin for frame in (segment.first, segment.end))
    if stop <= 0:
        return None
    late = max(-start, 0.0)
    fade = segment.fade / fps
    path = str(segment.sound.path.resolve())  # not relative to the scene file
    return SoundTable(file=path, at=segment.begin / fps + late, start=start + late, stop=stop, fade_in=fade)


def segments_of(
    name: str, home: Place, takes: Sequence[PlayedTake], footing: Footing, fps: float, scene: Path
) -> list[Segment]:
    """Put the takes of one character on the film's clock.

    A take without a time begins when the one before it ends, less the cross-fade. One without a position goes on
    where the one before it is at that time.

    Parameters
    ----------
    name : str
        Of the character.
    home : Place
        Where the first take without a position begins.
    takes : sequence of PlayedTake
    footing : Footing
    fps : float
    scene : Path
        Name of the file, for errors.

    Raises
    ------
    SceneError
        Takes are not in the order of their times.
    """
    made: list[Segment] = []
    for number, take, solved, first, end in takes:
        sound = solved.sound if take.sound else None
        for repetition in range(take.loop):
            last = made[-1] if made else None
            fade = 0 if last is None else min(round(take.fade * fps), (end - first) // 2)
            begin = 0 if last is None else last.begin + last.end - last.first - fade
            if repetition == 0 and take.at is not None:
                begin = round(take.at * fps)
            if last is not None and begin <= last.begin:
                raise SceneError(
                    at(scene, field=f"[[take]] {number}, at"),
                    found=f"{begin / fps:g} s, which is not after the take of {name!r} before it",
                    expected="the takes of a character in the order of their times",
                    fix="Correct the times, or change the order of the tables.",
                )
            position = take.position if repetition == 0 or last is None else None
            turn = take.turn if take.turn is not None else home.turn if last is None else last.place.turn
            segment = Segment(solved.motion, begin, first, end, fade, Place(np.zeros(3), turn), sound)
            if position is None and last is not None:
                place = last.root_on_stage(begin, footing) - segment.root_on_stage(begin, footing)
            else:
                place = home.position if position is None else np.array([position[0], 0.0, position[1]])
            made.append(replace(segment, place=Place(place * [1, 0, 1], turn)))
    return [
        segment if after is None else replace(segment, fade=min(segment.fade, after.begin - segment.begin))
        for segment, after in pairwise([*made, None])
        if segment is not None
    ]
