"""Cost of one shape at many sizes."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import igl
import numpy as np
from numpy.typing import NDArray

from benchmarks.processes import MODULE
from engine_bridge.character.character import Character, load_character, make_character
from engine_bridge.cli.benchmark import in_process
from engine_bridge.cli.benchmark_process import CHARACTER, LOG, WARM_UP
from engine_bridge.puppet import puppet_file

SIZES = (2_000, 4_000, 8_000, 16_000, 31_000, 62_500, 125_000, 250_000, 500_000, 1_000_000)
BASE_VERTICES = 62_500
"""Number of vertices of the mesh that is subdivided to larger ones: a quarter or a sixteenth of them."""
MIN_SIZE_RATIO = 0.99
"""Ratio of two sizes above which they count as equal."""

Surface = tuple[NDArray[np.float64], NDArray[np.int64]]


def measured(scratch: Path, subject: Path, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    """Measure frames and pre-computation of one shape at every size of `SIZES`."""
    points = []
    for size, vertices, faces in _resized(subject):
        folder = scratch / str(size)
        folder.mkdir()
        make_character(str(size), vertices, faces).document.save(folder / "mesh.glb")
        for file in (LOG, "warm_up.glb", WARM_UP):
            shutil.copy(subject / file, folder)
        proposed = puppet_file.load(subject / CHARACTER)
        table = proposed.character.model_copy(update={"mesh": "mesh.glb"})
        puppet_file.dump(proposed.model_copy(update={"character": table}), folder / CHARACTER)
        found = in_process(folder, "precompute") | in_process(folder, "point", module=MODULE)
        points.append(found)
        progress(f"  {found}")
        shutil.rmtree(folder)
    return points


def _resized(subject: Path) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.int64]]]:
    """Yield the character of a folder at each of `SIZES`, by splitting triangles in four and collapsing edges."""
    character = load_character(subject / puppet_file.load(subject / CHARACTER).character.mesh)
    vertices, faces = _with_vertices(BASE_VERTICES, *_split(BASE_VERTICES, *_surface(character)))
    for size in SIZES:
        vertices, faces = _split(size, vertices, faces)
        yield size, *_with_vertices(size, vertices, faces)


def _surface(character: Character) -> Surface:
    mesh = character.solver_mesh()
    return mesh.vertices, mesh.faces


def _split(size: int, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Surface:
    while len(vertices) < MIN_SIZE_RATIO * size:
        vertices, faces = igl.upsample(vertices, faces)
    return vertices, faces


def _with_vertices(size: int, vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> Surface:
    if MIN_SIZE_RATIO * len(vertices) <= size:
        return vertices, faces
    rest = len(faces) - 2 * len(vertices)  # −2 χ, which edge collapses preserve
    vertices, faces, *_ = igl.decimate(vertices, faces, 2 * size + rest)
    return vertices, faces
