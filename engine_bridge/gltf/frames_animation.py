"""The animated character as a vertex cache: one morph target a keyframe.

For players that cannot blend many targets: at a keyframe its own target alone is in, between two keyframes these two.
They hold all targets in memory, though, whose size grows with the length of the clip.
"""

import math
from itertools import pairwise
from pathlib import Path

import igl
import numpy as np
from numpy.typing import NDArray

from engine_bridge.gltf.character import Character
from engine_bridge.gltf.morph_basis import turn
from puppetline.errors import OutputError
from solver.binding import Binding
from solver.deformer import displacement_to_file_units, to_file_units
from solver.mesh import SolverMesh
from solver.reduced_model import ReducedModel

LARGEST = 1_000_000_000
"""Bytes; a .glb could hold four times as much, but a player keeps all of it in the graphics card."""

DESCRIPTION = 300
"""Bytes of JSON for an array."""


def check_size(output: Path, character: Character, frames: int, fps: float) -> None:
    """Refuse a vertex cache that no player could hold.

    Raises
    ------
    OutputError
        With the number of keyframes a second that would do.
    """
    arrays = sum(1 if part.normals is None else 2 for part in character.parts)
    values = sum(len(part.vertices) * (1 if part.normals is None else 2) for part in character.parts)
    nodes = len({part.node for part in character.parts})
    linear, square = 12 * values + DESCRIPTION * arrays, 4 * nodes  # the table of weights grows with the square
    size = linear * frames + square * frames**2
    if size <= LARGEST:
        return
    fitting = (math.sqrt(linear**2 + 4 * square * LARGEST) - linear) / (2 * square)
    slower = math.floor(10 * fps * fitting / frames) / 10
    raise OutputError(
        output,
        found=f"{frames:,} keyframes of {values * 12 / 1e6:.1f} MB, {size / 1e9:.1f} GB in all",
        expected=f"no more than {LARGEST / 1e9:g} GB, which players must hold in memory at once",
        fix=f"Give --fps {slower:g}, or use --as morph." if slower >= 1 else "Use --as morph, or a shorter recording.",
    )


def weights(frames: int) -> NDArray[np.float32]:
    """Return the (F, F) weights: straight lines between them make hat functions."""
    return np.eye(frames, dtype=np.float32)


def displacements(
    character: Character, mesh: SolverMesh, model: ReducedModel, frames: NDArray[np.float32]
) -> list[tuple[NDArray[np.float32], NDArray[np.float32] | None]]:
    """Return (F, n, 3) position and normal displacements of each part, world coordinates.

    A rest normal turns as the smooth normal of the solver mesh does at its vertex, so that hard edges stay hard.

    Parameters
    ----------
    character : Character
    mesh : SolverMesh
    model : ReducedModel
    frames : (F, 4m, 3) float32
        Control variables, model units.
    """
    count = len(frames)
    starts = np.cumsum([0] + [len(part.vertices) for part in character.parts])
    of_part = [mesh.of_render[start:end] for start, end in pairwise(starts)]
    bindings = [Binding(model, part.vertices, of) for part, of in zip(character.parts, of_part, strict=True)]
    surface = Binding.of_solver_mesh(model, mesh)
    smooth = igl.per_vertex_normals(mesh.vertices, mesh.faces)
    made: list[tuple[NDArray[np.float32], NDArray[np.float32] | None]] = [
        (
            np.empty((count, *part.vertices.shape), dtype=np.float32),
            None if part.normals is None else np.empty((count, *part.vertices.shape), dtype=np.float32),
        )
        for part in character.parts
    ]
    for index, frame in enumerate(frames):
        moved = displacement_to_file_units(frame - model.rest_controls, model)
        now = igl.per_vertex_normals(surface.vertices(to_file_units(frame, model)).astype(np.float64), mesh.faces)
        for part, of, binding, (positions, normals) in zip(character.parts, of_part, bindings, made, strict=True):
            positions[index] = binding.vertices(moved)
            if normals is not None and part.normals is not None:
                normals[index] = turn(part.normals, smooth[of], now[of]) - part.normals
    return made
