"""What must hold for whatever was read from a damaged file, and for every error that says why it was not."""

import dataclasses
import re

import numpy as np

from capture.skeleton import JOINTS
from engine_bridge.character.materials import preview_colors
from puppetline.errors import heading

TO_COPY = re.compile(r"(: (apt|ffmpeg|ip|mkdir|pip|puppetline|\{) ?.*|https://\S+)$")
"""The end of what to do if it is something to copy, after which a full stop would be in the way."""


def assert_is_part(part, text, source):
    """A part of an error reads as the template of all messages needs it: two noun phrases, then what to do."""
    assert text.strip() == text != "", source
    assert text.isprintable(), source
    if part == "fix":
        assert not text[0].islower(), source
        assert text.endswith((".", "…")) or TO_COPY.search(text) or re.fullmatch(r"Did you mean .*\?", text), source
    else:
        assert not text.endswith("."), source


def assert_is_complete(error):
    """An error is one readable line that says where, what was found, what was expected and what to do."""
    for part, text in error.parts.items():
        assert_is_part(part, text, str(error))
    assert str(error) == f"{heading(error.where)} found {error.found}; expected {error.expected}. {error.fix}"
    assert len(str(error)) < 2000, error


def assert_is_error_of(error, family, path):
    """An error is of its family, names the file, and is complete."""
    assert type(error) is family, error
    assert str(path) in error.where, error
    assert_is_complete(error)


def assert_is_clause(error):
    """The message of an error within the project completes the sentence of another one."""
    assert str(error), error
    assert str(error).isprintable(), error
    assert not str(error).endswith("."), error
    assert len(str(error)) < 500, error


def assert_is_sound_character(character):
    """Surfaces are finite arrays that fit together; the solver's mesh has the same surface, welded."""
    mesh = character.solver_mesh()  # it refuses positions that are not finite
    assert character.parts
    for part in character.parts:
        count = len(part.vertices)
        assert (part.vertices.shape, part.vertices.dtype) == ((count, 3), np.float64)
        assert (part.triangles.shape[1:], part.triangles.dtype) == ((3,), np.int64)
        assert np.isfinite(part.vertices).all()
        assert part.to_world.shape in ((1, 4, 4), (count, 4, 4))
        if len(part.triangles):
            assert 0 <= part.triangles.min() <= part.triangles.max() < count
        if part.normals is not None:
            assert part.normals.shape == (count, 3)
            assert np.isfinite(part.normals).all()
            assert (np.linalg.norm(part.normals, axis=1) < 1 + 1e-5).all()
    colors = preview_colors(character)
    if colors is not None:
        assert colors.shape == character.vertices.shape
        assert np.isfinite(colors).all()
    assert mesh.of_render.shape == (len(character.vertices),)
    assert 0 <= mesh.of_render.min() <= mesh.of_render.max() < len(mesh.vertices)
    assert np.array_equal(np.unique(mesh.faces), np.arange(len(mesh.vertices)))
    assert np.isfinite(mesh.vertices).all()
    assert mesh.diagonal > 0


def assert_is_sound_clip(clip):
    """A clip has frames at increasing times, with positions exactly of the joints that are not lost."""
    count = len(clip.times)
    assert count > 0
    assert (clip.positions.shape, clip.positions.dtype) == ((count, len(JOINTS), 3), np.float64)
    assert (clip.confidence.shape, clip.confidence.dtype) == ((count, len(JOINTS)), np.float32)
    assert np.isfinite(clip.times).all()
    assert (np.diff(clip.times) > 0).all()
    assert ((clip.confidence >= 0) & (clip.confidence <= 1)).all()
    assert np.isfinite(clip.positions[clip.confidence > 0]).all()
    assert np.isnan(clip.positions[clip.confidence == 0]).all()
    assert clip.tracked_frames > 0


def assert_same_fields(one, other):
    """Two objects of a dataclass, which may have others of them, are the same bit for bit."""
    for field in dataclasses.fields(one):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert type(a) is type(b)
        if dataclasses.is_dataclass(a):
            assert_same_fields(a, b)
        else:
            assert np.asarray(a).dtype == np.asarray(b).dtype
            np.testing.assert_array_equal(a, b)
