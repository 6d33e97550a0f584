"""A scene that is ready to be shown: its characters with their motion, and the space that they need."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.film.actor import Actor
from engine_bridge.film.scene import Scene, SoundTable, check_exists
from engine_bridge.film.takes import Footing, PlayedTake, SolvedTake, played_take, segments_of, solve_take, sound_table
from engine_bridge.performance.frame_store import evenly
from engine_bridge.performance.rig import Rig, load_rig
from engine_bridge.performance.settings import Settings
from engine_bridge.pictures.gpu_renderer import Stage
from puppetline.errors import PuppetlineError, at
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units

MEASURED_VERTICES = 400
"""Approximate number of vertices of a character that are measured in each frame."""

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
    sounds : tuple of SoundTable
        The scene's, and those that were recorded beside its takes.
    notes : tuple of str
        Sentences for the user about recordings.
    """

    path: Path
    scene: Scene
    actors: list[Actor]
    frames: int
    sounds: tuple[SoundTable, ...]
    notes: tuple[str, ...]

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self.scene.film.fps

    @property
    def seconds(self) -> float:
        """Length of the film."""
        return self.frames / self.fps

    def boxes(self, progress: Progress) -> dict[str, NDArray[np.float64]]:
        """Return the lower and upper corner of each character in each frame, (F, 2, 3) in metres.

        A character whose feet are not held on the floor is placed so that it does not sink below it.
        """
        measured = {}
        for number, actor in enumerate(self.actors):
            binding = Binding.of_solver_mesh(actor.rig.model, actor.rig.mesh).only(_measured(actor.rig))
            boxes = np.empty((self.frames, 2, 3))
            for frame in range(self.frames):
                vertices = binding.vertices(to_file_units(actor.pose(frame).R, actor.rig.model))
                linear = actor.to_stage(frame)
                placed = vertices @ linear[:3] + linear[3]
                boxes[frame] = placed.min(axis=0), placed.max(axis=0)
                progress("Framing", (number + (frame + 1) / self.frames) / len(self.actors))
            if not actor.stands:
                lowest = float(boxes[:, 0, 1].min())
                actor.footing.low += lowest / actor.footing.scale
                boxes[:, :, 1] -= lowest
            measured[actor.name] = boxes
        return measured

    def stage(self, boxes: dict[str, NDArray[np.float64]]) -> Stage:
        """Return the space of all motion."""
        everything = np.concatenate(list(boxes.values()))
        low, high = everything[:, 0].min(axis=0), everything[:, 1].max(axis=0)
        size = max(actor.footing.height for actor in self.actors)
        radius = max(float(np.hypot(*(high - low)[[0, 2]])) / 2, size / 2, 1e-6)
        middle = (low + high) / 2
        return Stage(np.array([middle[0], 0.0, middle[2]]), 1.05 * radius, max(float(high[1]), 1e-6), size)


def produce(path: Path, scene: Scene, progress: Progress) -> Production:
    """Load the characters of a scene, and solve its takes.

    A take that cannot be played is left out, with a note.

    Raises
    ------
    PuppetlineError
        Also if no take is left.
    """
    rigs: dict[Path, Rig] = {}
    solved: dict[tuple[Path, Path, int | None], SolvedTake] = {}
    actors, notes = [], list[str]()
    errors: list[PuppetlineError] = []
    for table in scene.character:
        puppet = path.parent / table.puppet
        if puppet not in rigs:
            progress(f"Preparing {table.name}", 0.0)
            rigs[puppet] = load_rig(puppet)
        rig, played = rigs[puppet], list[PlayedTake]()
        for number, take in enumerate(scene.take, 1):
            if take.character != table.name or take.mute:
                continue
            try:
                log = path.parent / take.file
                check_exists(log, at(path, field=f"[[take]] {number}, file"), "a recording")
                key = (puppet, log, take.user)
                if key not in solved:
                    settings = Settings(fps=scene.film.fps, user=take.user)
                    solved[key] = solve_take(rig, log, settings, partial(progress, f"Performing {log.stem}"))
                    notes += [f"{table.name}, {log.stem}: {note}" for note in solved[key].notes]
                played.append(played_take(number, take, solved[key], scene.film.fps, path))
            except PuppetlineError as error:  # the rest is played
                errors.append(error)
        footing = Footing(table, rig)
        actors.append(Actor(table, rig, footing, segments_of(table, played, footing, scene.film.fps, path)))
    if errors and not any(actor.segments for actor in actors):
        raise errors[0]
    notes += [f"A take is left out. {error}" for error in errors]
    frames = max(actor.end for actor in actors)
    if scene.film.seconds is not None:
        frames = max(round(scene.film.seconds * scene.film.fps), 2)
    own = (sound_table(segment, scene.film.fps) for actor in actors for segment in actor.segments)
    sounds = (*scene.sound, *(table for table in own if table is not None))
    return Production(path, scene, actors, frames, sounds, tuple(notes))


def _measured(rig: Rig) -> NDArray[np.int64]:
    """Return vertices of the solver mesh that are measured: some of them, and the outermost ones at rest."""
    vertices = rig.mesh.vertices
    directions = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1
    outermost = (vertices @ directions.T).argmax(axis=0)
    return np.union1d(evenly(len(vertices), MEASURED_VERTICES), outermost)
