"""Takes on a film's clock: solved recordings of a character, and the parts of them that it plays one after another."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.scene import CharacterTable, SceneError, TakeTable
from engine_bridge.performance.clip import load_timeline, reference_pose
from engine_bridge.performance.frame_store import FrameStore
from engine_bridge.performance.performance import Performance
from engine_bridge.performance.rig import Rig
from engine_bridge.performance.settings import Settings
from puppetline.errors import at


class Motion:
    """Solved frames of one take or one cross-fade: control variables, targets of handles, bones, and the root."""

    def __init__(self, rig: Rig, bones: int) -> None:
        handles = len(rig.puppet.handle)
        self.R = FrameStore(rig.model.rest_controls.shape)
        self.targets = FrameStore((handles, 3))
        self.motions = FrameStore((bones, 4, 3))
        self.root = FrameStore((3,))

    def __len__(self) -> int:
        return len(self.R)

    def append(
        self,
        R: NDArray[np.float64],
        targets: NDArray[np.float64],
        motions: NDArray[np.float64],
        root: NDArray[np.float64],
    ) -> None:
        """Add one frame."""
        for store, values in ((self.R, R), (self.targets, targets), (self.motions, motions), (self.root, root)):
            store.append(values[None])


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
    motion : Motion
    begin : int
        Frame of the film at which it begins.
    first, end : int
        Frames of the take: the first one, and the one after the last one.
    fade : int
        Length of the cross-fade from the segment before it, which begins with it.
    place : Place
    """

    motion: Motion
    begin: int
    first: int
    end: int
    fade: int
    place: Place

    def row(self, frame: int) -> int:
        """Return the frame of the take at a frame of the film; the first one before it, the last one after it."""
        return min(max(frame - self.begin + self.first, self.first), self.end - 1)

    def root_on_stage(self, frame: int, footing: "Footing") -> NDArray[np.float64]:
        """Return where the root is on the stage (3,) at a frame of the film."""
        way: NDArray[np.float64] = self.place.position + self.motion.root[self.row(frame)] @ footing.linear(
            self.place.turn
        )
        return way


class Footing:
    """The size of a character, and the directions of its coordinates on the film's stage.

    Parameters
    ----------
    table : CharacterTable
    rig : Rig

    Attributes
    ----------
    scale : float
        Metres per mesh unit.
    low : float
        Height of the lowest vertex at rest, mesh units.
    height : float
        Metres.
    """

    def __init__(self, table: CharacterTable, rig: Rig) -> None:
        self.basis = rig.puppet.character.basis
        up = rig.character.vertices @ self.basis[1]
        self.low, tall = float(up.min()), float(np.ptp(up))
        self.scale = rig.puppet.character.scale if table.height is None else table.height / max(tall, 1e-12)
        self.height = self.scale * tall

    def linear(self, turn: float) -> NDArray[np.float64]:
        """Return the map (3, 3) of row vectors from mesh units to metres on the stage, after a turn in degrees."""
        angle = np.radians(turn)
        around = np.array([[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]])
        moved: NDArray[np.float64] = self.scale * self.basis.T @ around
        return moved


def solve_take(
    rig: Rig, log: Path, settings: Settings, progress: Callable[[float], None]
) -> tuple[Motion, tuple[str, ...]]:
    """Solve all frames of a recording for a character, and return them with notes about the recording.

    Raises
    ------
    PuppetlineError
    """
    timeline, notes = load_timeline(log, settings)
    performance = Performance(rig.puppet, rig.mesh, rig.model, reference_pose(rig.puppet, timeline, settings))
    motion = Motion(rig, len(performance.deformer.bones))
    count = len(timeline.positions)
    for number in range(count):
        aim = performance.retargeting.step(timeline.frame(number))
        motion.append(performance.deformer.solve(aim.targets, aim.motions), aim.targets, aim.motions, aim.root)
        progress((number + 1) / count)
    return motion, notes


def segments_of(
    table: CharacterTable, takes: Sequence[tuple[int, TakeTable, Motion]], footing: Footing, fps: float, scene: Path
) -> list[Segment]:
    """Put the takes of one character on the film's clock.

    A take without a time begins when the one before it ends, less the cross-fade. One without a position goes on
    where the one before it is at that time.

    Parameters
    ----------
    table : CharacterTable
    takes : sequence of (int, TakeTable, Motion)
        With the number of each in the scene file, from 1.
    footing : Footing
    fps : float
    scene : Path
        Name of the file, for errors.

    Raises
    ------
    SceneError
        A part is outside its recording, or takes are not in the order of their times.
    """
    made: list[Segment] = []
    for number, take, motion in takes:
        first, end = _part(take, len(motion), fps, at(scene, field=f"[[take]] {number}, start"))
        for repetition in range(take.loop):
            last = made[-1] if made else None
            fade = 0 if last is None else min(round(take.fade * fps), (end - first) // 2)
            begin = 0 if last is None else last.begin + last.end - last.first - fade
            if repetition == 0 and take.at is not None:
                begin = round(take.at * fps)
            if last is not None and begin <= last.begin:
                raise SceneError(
                    at(scene, field=f"[[take]] {number}, at"),
                    found=f"{begin / fps:g} s, which is not after the take of {table.name!r} before it",
                    expected="the takes of a character in the order of their times",
                    fix="Correct the times, or change the order of the tables.",
                )
            position = take.position if repetition == 0 or last is None else None
            turn = take.turn if take.turn is not None else table.turn if last is None else last.place.turn
            segment = Segment(motion, begin, first, end, fade, Place(np.zeros(3), turn))
            if position is None and last is not None:
                place = last.root_on_stage(begin, footing) - segment.root_on_stage(begin, footing)
            else:
                x, z = table.position if position is None else position
                place = np.array([x, 0.0, z])
            made.append(replace(segment, place=Place(place * [1, 0, 1], turn)))
    return [
        segment if after is None else replace(segment, fade=min(segment.fade, after.begin - segment.begin))
        for segment, after in pairwise([*made, None])
        if segment is not None
    ]


def _part(take: TakeTable, count: int, fps: float, where: str) -> tuple[int, int]:
    """Return the first frame of a take that is played, and the one after the last one."""
    first = round(take.start * fps)
    end = count if take.stop is None else min(round(take.stop * fps) + 1, count)
    if end - first < 2:
        raise SceneError(
            where,
            found=f"{take.start:g} s in a recording of {(count - 1) / fps:.2f} s",
            expected="at least two frames of the recording",
            fix="Choose an earlier start or a later stop.",
        )
    return first, end
