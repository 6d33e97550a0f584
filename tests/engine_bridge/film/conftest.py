"""Scenes of two small figures, sounds with a clap, and a renderer."""

import pytest

from engine_bridge.film import scene as scenes
from engine_bridge.film.production import produce


def quiet(_step, _share):
    """Report no progress."""


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
