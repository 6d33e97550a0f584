"""Clip files of frames: whole ones, and damaged ones."""

from dataclasses import replace

import numpy as np

from engine_bridge.service.protocol.clip_file import ClipFacts, beginning
from engine_bridge.service.protocol.header import Kind, split
from engine_bridge.service.protocol.payloads import encode

from .stage import FPS


def clip_of(frames, /, **facts):
    """Return a clip; its description says something else where `facts` do."""
    character = frames[0].character
    described = {"character": character.name, "revision": character.revision, "frames": len(frames)}
    described |= {"fps": FPS, "recording": "dance", **facts}
    return b"".join(
        [beginning(character, ClipFacts(**described)), *(encode(Kind.CONTROLS, frame, 0) for frame in frames)]
    )


def at_times(frames, time):
    """Return frames with the times that a function has for their numbers."""
    return [replace(frame, time=time(number)) for number, frame in enumerate(frames)]


def damaged(frames):
    """Return clips by what is wrong with them."""
    whole = clip_of(frames)
    description = split(whole).header.message_length
    return {
        "no file": b"",
        "an end too early": whole[:-9],
        "no description": whole[description:],
        "no scene": whole[:description],
        "a frame too few": clip_of(frames, frames=len(frames) + 1),
        "a time that goes back": clip_of(at_times(frames, lambda number: -number)),
        "a time that is no number": clip_of(at_times(frames, lambda _: np.nan)),
        "another scene": clip_of(frames, revision=7),
    }


def assert_near(found, expected, solved):
    """Compare positions with vertices of the solver, given by the numbers of frames, or with others."""
    vertices, diagonal = solved
    for positions, wanted in zip(found, expected, strict=True):
        wanted = vertices[wanted] if isinstance(wanted, int) else wanted
        assert np.abs(positions - wanted).max() <= 1e-5 * diagonal
