"""Cost of one shape at many sizes.

python -m benchmarks.scaling [--data FOLDER] [--sizes COUNT,…] [--max-exact COUNT]

draws the time and memory that the preparation of a character takes from its file, without caches, for 2,000 to
10,000,000 vertices, and updates the table of docs/performance.md. FOLDER is searched for armadillo.obj. The largest
size needs 12 GB of memory.
"""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import igl
import numpy as np
from numpy.typing import NDArray

from benchmarks import character_cost, plots
from benchmarks.character_cost import in_process
from benchmarks.character_cost_process import WARM_UP
from benchmarks.documents import DOCUMENT, IMAGES, replaced
from benchmarks.own_cache import own_cache
from benchmarks.processes import MODULE
from engine_bridge.character.character import CharacterMesh, load_character, make_character
from engine_bridge.inspection.benchmark import CHARACTER, LOG, number
from engine_bridge.puppet import puppet_file

SIZES = (2_000, 4_000, 8_000, 16_000, 31_000, 62_500, 125_000, 250_000, 500_000, 1_000_000)
COLD_SIZES = (2_000, 8_000, 31_000, 50_000, 62_500, 250_000, 1_000_000, 4_000_000, 9_999_000)
MAX_EXACT_SIZE = 1_000_000
"""Number of vertices of the largest mesh that is measured with exact fields too, by default; it needs 2.7 GB."""
MAX_MADE_EXACTLY = 1_000_000
"""Number of vertices above which a mesh is subdivided from one of the right size, without collapsing edges of it."""
BASE_VERTICES = 62_500
"""Number of vertices of the mesh that is subdivided to larger ones: a quarter or a sixteenth of them."""
SHORT_FRAMES = 60
"""Number of frames of the recording that loads and compiles everything before the measurement."""
MIN_SIZE_RATIO = 0.99
"""Ratio of two sizes above which they count as equal."""

Surface = tuple[NDArray[np.float64], NDArray[np.int64]]


def measured(scratch: Path, subject: Path, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    """Measure frames and pre-computation of one shape at every size of `SIZES`."""
    points = []
    for size, vertices, faces in _resized(subject, SIZES):
        folder = _folder_of(scratch, subject, size, vertices, faces)
        found = in_process(folder, "precompute") | in_process(folder, "point", module=MODULE)
        points.append(found)
        progress(f"  {found}")
        shutil.rmtree(folder)
    return points


def prepared(
    scratch: Path, subject: Path, sizes: Sequence[int], max_exact: int, progress: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Measure the preparation of one shape at every size, up to a number of vertices with exact fields as well."""
    points = []
    for size, vertices, faces in _resized(subject, sizes):
        folder = _folder_of(scratch, subject, size, vertices, faces)
        del vertices, faces  # the other process needs the memory
        found = in_process(folder, "cold", 0, module=MODULE)
        if size <= max_exact:
            exact = in_process(folder, "cold", 1, module=MODULE)
            found |= {f"exact_{name}": exact[name] for name in ("cold_s", "cold_peak_mb")}
        points.append(found)
        progress(f"  {found}")
        shutil.rmtree(folder)
    return points


def table(points: list[dict[str, Any]]) -> Iterator[str]:
    """Yield the rows of the table of preparations."""
    yield "| vertices | from the file, s | reading, s | per vertex, µs | peak memory, GB | exact fields, s | peak, GB |"
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for point in points:
        exact = [point.get("exact_cold_s"), point.get("exact_cold_peak_mb")]
        numbers = (
            point["cold_s"],
            point["read_s"],
            1e6 * point["cold_s"] / point["vertices"],
            point["cold_peak_mb"] / 1000,
            exact[0],
            None if exact[1] is None else exact[1] / 1000,
        )
        yield f"| {point['vertices']:,} | {' | '.join(map(number, numbers))} |"


def _folder_of(
    scratch: Path, subject: Path, size: int, vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> Path:
    """Make a folder like the subject's with a character of another size."""
    folder = scratch / str(size)
    folder.mkdir()
    make_character(str(size), vertices, faces).document.save(folder / "mesh.glb")
    for file in (LOG, "warm_up.glb", WARM_UP):
        shutil.copy(subject / file, folder)
    proposed = puppet_file.load(subject / CHARACTER)
    table = proposed.character.model_copy(update={"mesh": "mesh.glb"})
    puppet_file.dump(proposed.model_copy(update={"character": table}), folder / CHARACTER)
    return folder


def _resized(subject: Path, sizes: Sequence[int]) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.int64]]]:
    """Yield the character of a folder at each size, by splitting triangles in four and collapsing edges."""
    character = load_character(subject / puppet_file.load(subject / CHARACTER).character.mesh)
    base = _with_vertices(BASE_VERTICES, *_split(BASE_VERTICES, *_surface(character)))
    for size in sizes:
        start = size
        while size > MAX_MADE_EXACTLY and start > BASE_VERTICES:
            start = -(-start // 4)
        vertices, faces = _split(size, *_with_vertices(start, *base))
        yield size, *_with_vertices(size, vertices, faces)


def _surface(character: CharacterMesh) -> Surface:
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a folder that contains armadillo.obj")
    parser.add_argument("--sizes", default=",".join(map(str, COLD_SIZES)), help="numbers of vertices")
    parser.add_argument("--max-exact", type=int, default=MAX_EXACT_SIZE, help="most vertices with exact fields too")
    options = parser.parse_args()
    mesh = min(options.data.rglob("armadillo.obj"), default=None) if options.data else None
    with tempfile.TemporaryDirectory() as folder, own_cache(Path(folder)):
        scratch, subject = Path(folder), Path(folder) / "subject"
        subject.mkdir()
        character_cost.prepare(subject, mesh, SHORT_FRAMES)
        sizes = list(map(int, options.sizes.split(",")))
        points = prepared(
            scratch, subject, sizes, options.max_exact, lambda text: print(text, file=sys.stderr, flush=True)
        )
    plots.scaling(points, IMAGES / "scaling.svg")
    text = replaced(DOCUMENT.read_text(encoding="utf-8"), "scaling", list(table(points)))
    DOCUMENT.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
