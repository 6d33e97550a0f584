"""A scene that is ready to be shown: its characters with their motion, and the space that they need."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.actor import Actor
from engine_bridge.film.framing import Extent
from engine_bridge.film.scene import CharacterTable, Scene, SoundTable, check_exists
from engine_bridge.film.takes import (
    Footing,
    Place,
    PlayedTake,
    SolvedTake,
    played_take,
    segments_of,
    solve_take,
    sound_table,
)
from engine_bridge.performance.frame_store import evenly
from engine_bridge.performance.prepared_character import PreparedCharacter, load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.pictures.surroundings import StageExtent
from engine_bridge.puppet import puppet_file
from puppetline.errors import PuppetlineError, at
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units

MEASURED_VERTICES = 400
"""Approximate number of vertices of a character that are measured in each frame."""

UPPER_SHARE, CROWN_SHARE = 0.45, 0.85
"""The upper half of a character: what is at most this share of its height below its highest point, and what is above
the other share of its height at rest, its head."""

GAP_METRES = 0.3
"""Space between characters that stand side by side."""

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Production:
    """A scene with its characters.

    Attributes
    ----------
    path : Path
        The scene file.
    scene : Scene
    actors : list of Actor
    frames : int
        Length of the film.
    notes : tuple of str
        Sentences for the user about recordings.
    """

    path: Path
    scene: Scene
    actors: list[Actor]
    frames: int
    notes: tuple[str, ...]

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.scene.film.fps

    @property
    def seconds(self) -> float:
        """Length of the film."""
        return self.frames / self.fps

    @property
    def sounds(self) -> tuple[SoundTable, ...]:
        """The scene's sounds, and those that were recorded beside its takes."""
        own = (sound_table(segment, self.fps) for actor in self.actors for segment in actor.segments)
        return (*self.scene.sound, *(table for table in own if table is not None))

    def extents(self, progress: Progress) -> dict[str, Extent]:
        """Return where each character is in each frame.

        A character whose feet are not held on the floor is placed so that it does not sink below it.
        """
        measured = {}
        for number, actor in enumerate(self.actors):
            chosen = _measured(actor.prepared)
            binding = Binding.of_solver_mesh(actor.prepared.model, actor.prepared.mesh).only(chosen)
            up = actor.prepared.mesh.vertices[chosen] @ actor.footing.basis[1]
            crown = up > up.min() + CROWN_SHARE * np.ptp(up)
            whole, upper, head = np.empty((3, self.frames, 2, 3))
            for frame in range(self.frames):
                vertices = binding.vertices(to_file_units(actor.pose(frame).R, actor.prepared.model))
                linear = actor.to_stage(frame)
                placed = vertices @ linear[:3] + linear[3]
                whole[frame] = placed.min(axis=0), placed.max(axis=0)
                above = placed[crown | (placed[:, 1] > whole[frame, 1, 1] - UPPER_SHARE * actor.footing.height)]
                upper[frame] = above.min(axis=0), above.max(axis=0)
                head[frame] = placed[crown].min(axis=0), placed[crown].max(axis=0)
                progress("Framing", (number + (frame + 1) / self.frames) / len(self.actors))
            if not actor.stands:
                lowest = float(whole[:, 0, 1].min())
                actor.footing.low += lowest / actor.footing.scale
                for boxes in (whole, upper, head):
                    boxes[..., 1] -= lowest
            measured[actor.name] = Extent(whole, upper, head)
        return measured

    def stage(self, extents: Mapping[str, Extent]) -> StageExtent:
        """Return the space of all motion."""
        everything = np.concatenate([extent.whole for extent in extents.values()])
        low, high = everything[:, 0].min(axis=0), everything[:, 1].max(axis=0)
        size = max(actor.footing.height for actor in self.actors)
        radius = max(float(np.hypot(*(high - low)[[0, 2]])) / 2, size / 2, 1e-6)
        middle = (low + high) / 2
        return StageExtent(np.array([middle[0], 0.0, middle[2]]), 1.05 * radius, max(float(high[1]), 1e-6), size)


def produce(path: Path, scene: Scene, progress: Progress) -> Production:
    """Load the characters of a scene, and solve its takes.

    A take that cannot be played is left out, with a note.

    Raises
    ------
    PuppetlineError
        Also if no take is left.
    """
    characters: dict[Path, PreparedCharacter] = {}
    solved: dict[tuple[Path, Path, int | None], SolvedTake] = {}
    actors, notes = [], list[str]()
    errors: list[PuppetlineError] = []
    for table in scene.character:
        puppet = path.parent / table.puppet
        if puppet not in characters:
            progress(f"Preparing {table.name}", 0.0)
            characters[puppet] = load_prepared(puppet)
    footings = [Footing(table.height, characters[path.parent / table.puppet]) for table in scene.character]
    for table, footing, home in zip(scene.character, footings, _homes(scene.character, footings), strict=True):
        puppet = path.parent / table.puppet
        prepared, played = characters[puppet], list[PlayedTake]()
        for number, take in enumerate(scene.take, 1):
            if take.character != table.name or take.mute:
                continue
            try:
                log = path.parent / take.file
                check_exists(log, at(path, field=f"[[take]] {number}, file"), "a recording")
                key = (puppet, log, take.user)
                if key not in solved:
                    settings = Settings(fps=scene.film.fps, user=take.user)
                    solved[key] = solve_take(prepared, log, settings, partial(progress, f"Performing {log.stem}"))
                    notes += [f"{table.name}, {log.stem}: {note}" for note in solved[key].notes]
                played.append(played_take(number, take, solved[key], scene.film.fps, path))
            except PuppetlineError as error:  # the rest is played
                errors.append(error)
        segments = segments_of(table.name, home, played, footing, scene.film.fps, path)
        actors.append(Actor(table, home, prepared, footing, segments))
    if errors and not any(actor.segments for actor in actors):
        raise errors[0]
    notes += [f"A take is left out. {error}" for error in errors]
    frames = max(actor.end for actor in actors)
    if scene.film.seconds is not None:
        frames = max(round(scene.film.seconds * scene.film.fps), 2)
    return Production(path, scene, actors, frames, tuple(notes))


class Measured(NamedTuple):
    """A production, and where its characters are, see `Production.extents`."""

    production: Production
    extents: dict[str, Extent]


_last: tuple[tuple[Any, ...], Measured] | None = None
"""What was measured last, and what it depends on."""


def measure(path: Path, scene: Scene, progress: Progress) -> Measured:
    """Produce a scene and measure its characters, unless this process did so last.

    A change of titles, bubbles, shots, sounds or the place moves nobody.

    Raises
    ------
    PuppetlineError
        See `produce`.
    """
    global _last
    puppets = [path.parent / each.puppet for each in scene.character]
    meshes = [puppet.parent / puppet_file.load(puppet).character.mesh for puppet in puppets]
    takes = [path.parent / take.file for take in scene.take]
    changes = [file.stat().st_mtime_ns if file.exists() else None for file in (*puppets, *meshes, *takes)]
    causes = (path, scene.character, scene.take, scene.film.fps, scene.film.seconds, tuple(changes))
    if _last is None or _last[0] != causes:
        _last = None  # frees its memory
        production = produce(path, scene, progress)
        _last = causes, Measured(production, production.extents(progress))
    production, extents = _last[1]
    return Measured(replace(production, scene=scene), extents)


def _homes(tables: Sequence[CharacterTable], footings: Sequence[Footing]) -> list[Place]:
    """Return where each character stands; those without a position stand side by side, around the middle."""
    spans = [footing.span(table.turn) for table, footing in zip(tables, footings, strict=True)]
    row = [number for number, table in enumerate(tables) if table.position is None]
    right = -(sum(spans[number][1] - spans[number][0] for number in row) + GAP_METRES * (len(row) - 1)) / 2
    homes = []
    for table, (low, high) in zip(tables, spans, strict=True):
        x, z = table.position or (right - low, 0.0)
        if table.position is None:
            right += high - low + GAP_METRES
        homes.append(Place(np.array([x, 0.0, z]), table.turn))
    return homes


def _measured(prepared: PreparedCharacter) -> NDArray[np.int64]:
    """Return vertices of the solver mesh that are measured: some of them, and the outermost ones at rest."""
    vertices = prepared.mesh.vertices
    directions = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1
    outermost = (vertices @ directions.T).argmax(axis=0)
    return np.union1d(evenly(len(vertices), MEASURED_VERTICES), outermost)
