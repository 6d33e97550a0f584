"""Animation of a character as a vertex cache, with one morph target per keyframe.

This form suits players that cannot blend many targets: only one target is active at a keyframe, and two in between. The
memory for all targets grows with the length of the clip.
"""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh
from engine_bridge.export.animation import Displacements
from engine_bridge.export.normals import FRAMES_PER_CHUNK, TurningNormals
from engine_bridge.performance.frame_store import Frames
from puppetline.errors import OutputError
from solver.model.batch import BatchBinding
from solver.model.reduced_model import ReducedModel
from solver.surface.mesh import SolverMesh

MAX_CACHE_BYTES = 1_000_000_000
"""Maximum size of a vertex cache in bytes; it is less than that of a .glb, because players keep it on the GPU."""

JSON_BYTES_PER_ARRAY = 300
"""Estimated size of the JSON for an array, in bytes."""


def check_size(output: Path, character: CharacterMesh, frames: int, fps: float) -> None:
    """Refuse a vertex cache that is too large for players.

    Raises
    ------
    OutputError
        The cache would be too large; the message has a frame rate at which it would fit.
    """
    arrays = sum(1 if part.normals is None else 2 for part in character.parts)
    values = sum(len(part.vertices) * (1 if part.normals is None else 2) for part in character.parts)
    nodes = len({part.node for part in character.parts})
    linear = 12 * values + JSON_BYTES_PER_ARRAY * arrays
    square = 4 * nodes  # the table of weights grows with the square
    size = linear * frames + square * frames**2
    if size <= MAX_CACHE_BYTES:
        return
    fitting = (math.sqrt(linear**2 + 4 * square * MAX_CACHE_BYTES) - linear) / (2 * square)
    slower = math.floor(10 * fps * fitting / frames) / 10
    raise OutputError(
        output,
        found=f"{frames:,} keyframes of {values * 12 / 1e6:.1f} MB, {size / 1e9:.1f} GB in all",
        expected=f"at most {MAX_CACHE_BYTES / 1e9:g} GB, which players hold in memory",
        fix=f"Use --fps {slower:g}, or use --as morph." if slower >= 1 else "Use --as morph, or a shorter recording.",
    )


def displacements(character: CharacterMesh, mesh: SolverMesh, model: ReducedModel, frames: Frames) -> Displacements:
    """Return the displacements (F, n, 3) of positions and normals for each part, world coordinates.

    Parameters
    ----------
    character : CharacterMesh
    mesh : SolverMesh
    model : ReducedModel
    frames : (F, 4m, 3) float32
        Control variables, model units.
    """
    turning = TurningNormals(character, mesh, model)
    positions = np.empty((len(frames), len(turning), 3), dtype=np.float32)
    normals = np.empty_like(positions)
    every = BatchBinding(model, character.vertices, mesh.of_render)
    for start in range(0, len(frames), FRAMES_PER_CHUNK):
        chunk = slice(start, start + FRAMES_PER_CHUNK)
        positions[chunk] = every.displacements(frames[chunk] - model.rest_controls).transpose(2, 0, 1)
        normals[chunk] = turning.displacements(frames[chunk]).transpose(2, 0, 1)

    def of_part(number: int) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        place = character.vertex_slices[number]
        return positions[:, place], None if character.parts[number].normals is None else normals[:, place]

    return of_part
