"""Scenes of two small figures, sounds with a clap, and a renderer."""

import numpy as np
import pytest

from engine_bridge.film import scene as scenes
from engine_bridge.film.production import produce
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units


def quiet(_step, _share):
    """Report no progress."""


def placed(actor, frames):
    """Return the vertices of a character in frames of its film, (F, n, 3), in metres."""
    prepared = actor.prepared
    binding = Binding(prepared.model, prepared.character.vertices, prepared.mesh.of_render)
    shown = [binding.vertices(to_file_units(actor.pose(frame).R, prepared.model)) for frame in frames]
    return np.array([each @ to[:3] + to[3] for each, to in zip(shown, map(actor.to_stage, frames), strict=True)])


@pytest.fixture
def write_scene(tmp_path, limbed_puppet, blob_puppet, take):
    """Write a scene file; LIMBED, HANDLES and TAKE in its text are paths."""

    def write(text, name="scene.toml"):
        for word, path in (("LIMBED", limbed_puppet), ("HANDLES", blob_puppet), ("TAKE", take)):
            text = text.replace(word, str(path))
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


@pytest.fixture
def produced(write_scene):
    """Return the production of a scene file's text."""

    def make(text):
        path = write_scene(text)
        return produce(path, scenes.load(path), quiet)

    return make
