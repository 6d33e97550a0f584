"""Compare surface operators on real meshes, and on broken copies of them, over a recording.

python -m benchmarks.laplacians LOG FILE_OR_FOLDER [FILE_OR_FOLDER …]

Cells contain a value for each operator: cotangents with mollified edge lengths, libigl's intrinsic Delaunay cotangents,
both together, and the tufted cover that the solver uses. A dash means that the system of an operator is not positive
definite, or that it needs more than `MAX_MEMORY_BYTES`.
"""

import resource
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import igl
import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from capture import body
from capture.skeleton import SkeletonFrame
from engine_bridge.character.character import CHARACTER_FILES, Character
from engine_bridge.performance.character_motion import CharacterMotion
from engine_bridge.performance.clip import REST_SECONDS, load_timeline
from engine_bridge.performance.rig import Rig
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.puppet.puppet import Puppet
from puppetline.errors import PuppetlineError
from solver.model import fields
from solver.model.binding import Binding
from solver.model.reduced_model import build
from solver.model.stretch import EdgeStretch
from solver.motion.deformer import to_file_units
from solver.surface.contacts import contacts
from solver.surface.mesh import SolverMesh, weld

Operator = Callable[[SolverMesh], tuple[csr_matrix, np.ndarray]]
"""A function like `fields.laplacian`."""

HEADER = """| mesh | vertices | seconds | narrowest field | handles missed by | stretch p99 | from the whole mesh |
| --- | --- | --- | --- | --- | --- | --- |"""

MAX_BROKEN_VERTICES = 5000
"""Number of vertices of the largest mesh that is also measured in broken copies."""

MAX_MEMORY_BYTES = 4 << 30
"""Memory above which an operator fails, in bytes."""

COMPARISON_FRAMES = 30
"""Number of frames between two comparisons of a broken copy with the whole mesh."""

BROKEN_SHARE = 0.03
"""Share of the faces or vertices that are broken in a broken copy."""

MOLLIFICATION = 1e-4
"""Least excess of two sides of a triangle over the third after mollification, in mean edge lengths."""

tufted_cover = fields.laplacian


def mollified(mesh: SolverMesh) -> tuple[csr_matrix, np.ndarray]:
    return csr_matrix(igl.cotmatrix_intrinsic(_mollified_lengths(mesh), mesh.faces)), _areas(mesh)


def intrinsic_delaunay(mesh: SolverMesh) -> tuple[csr_matrix, np.ndarray]:
    return csr_matrix(igl.intrinsic_delaunay_cotmatrix(mesh.vertices, mesh.faces)[0]), _areas(mesh)


def mollified_delaunay(mesh: SolverMesh) -> tuple[csr_matrix, np.ndarray]:
    lengths, faces = igl.intrinsic_delaunay_triangulation(_mollified_lengths(mesh), mesh.faces)[:2]
    return csr_matrix(igl.cotmatrix_intrinsic(lengths, faces)), _areas(mesh)


def _mollified_lengths(mesh: SolverMesh) -> np.ndarray:
    lengths = igl.edge_lengths(mesh.vertices, mesh.faces)
    slack = lengths.sum(axis=1) - 2 * lengths.max(axis=1)
    return lengths + max(0.0, MOLLIFICATION * lengths.mean() - slack.min())


def _areas(mesh: SolverMesh) -> np.ndarray:
    mass = igl.massmatrix(mesh.vertices, mesh.faces, igl.MASSMATRIX_TYPE_VORONOI).diagonal()
    return np.maximum(mass, 1e-12 * mass.max())


OPERATORS: list[Operator] = [mollified, intrinsic_delaunay, mollified_delaunay, tufted_cover]


def broken(vertices: np.ndarray, faces: np.ndarray) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield copies of a mesh, each broken in one of the ways in which files are broken."""
    rng = np.random.default_rng(0)
    some = rng.random(len(faces)) < BROKEN_SHARE
    a, b, c = faces[some].T
    new = len(vertices) + np.arange(len(a))
    middle = (vertices[a] + vertices[b]) / 2

    needle = middle + 1e-6 * (vertices[c] - middle)
    split = np.concatenate([np.column_stack(t) for t in ((a, b, new), (b, c, new), (c, a, new))])
    yield "needles", np.concatenate([vertices, needle]), np.concatenate([faces[~some], split])

    slid = vertices.copy()
    slid[a] += 0.999 * (vertices[b] - vertices[a])
    yield "slivers", slid, faces

    normal = np.cross(vertices[b] - vertices[a], vertices[c] - vertices[a])
    height = np.linalg.norm(vertices[b] - vertices[a], axis=1, keepdims=True)
    fin = middle + height * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    yield "fins", np.concatenate([vertices, fin]), np.concatenate([faces, np.column_stack([a, b, new])])

    turned = np.where((rng.random(len(faces)) < 0.4)[:, None], faces[:, ::-1], faces)
    yield "turned faces", vertices, turned

    noise = 1e-8 * np.ptp(vertices, axis=0).max() * rng.normal(size=(3 * len(faces), 3))
    yield "doubled vertices", vertices[faces.ravel()] + noise, np.arange(3 * len(faces)).reshape(-1, 3)

    yield "holes", vertices, faces[~some]


def narrowest(mesh: SolverMesh, operator: Operator) -> float:
    """Return the smallest share of the surface that any of the 8 fields covers; near 0 if a field is a spike."""
    L, mass = operator(mesh)
    operator = fields.SurfaceOperator(fields.field_operator(L, contacts(mesh), mesh.diagonal), mass, mesh.vertices)
    modes = operator.propagation_fields(8)
    return float(((mass @ modes**2) ** 2 / (mass @ modes**4)).min() / mass.sum())


def measure(
    character: Character, mesh: SolverMesh, puppet: Puppet, log: Path, operator: Operator, whole: np.ndarray | None
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return a cell for each column, and some frames; `whole` are the frames of the unbroken mesh."""
    fields.laplacian = operator
    start = time.process_time()
    model = build(mesh)
    seconds = time.process_time() - start
    timeline, _ = load_timeline(log, Settings())
    rest = body.resting_pose(timeline.positions, timeline.confidence, 0, round(REST_SECONDS * timeline.fps))
    motion = CharacterMotion(Rig(puppet, character, mesh, model), rest)
    deformer = motion.deformer
    rows = model.rows(mesh, deformer.handles)
    solve, missed = deformer.solve, [0.0]

    def watched(targets: np.ndarray, *more: object) -> np.ndarray:
        R = solve(targets, *more)
        missed.append(float(np.linalg.norm(rows @ R - model.to_model(targets), axis=1).max()))
        return R

    deformer.solve = watched
    binding, stretch = Binding.of_solver_mesh(model, mesh), EdgeStretch(mesh)
    frames = []
    for time_, positions, confidence in zip(timeline.times, timeline.positions, timeline.confidence, strict=True):
        pose = motion.step(SkeletonFrame(time_, 0, positions, confidence))
        frames.append(binding.vertices(to_file_units(pose.R, model)))
        stretch.add(frames[-1][:, :, None])
    shown = np.array([mesh.vertices, *frames[::COMPARISON_FRAMES]])
    cells = (
        f"{seconds:.2f}",
        f"{narrowest(mesh, operator):.2f}",
        f"{max(missed):.1e}",
        f"{stretch.percentiles(99)[0]:.3f}",
    )
    return (*cells, "–" if whole is None else f"{_apart(whole, shown) / mesh.diagonal:.1e}"), shown


def _apart(whole: np.ndarray, broken: np.ndarray) -> float:
    """Return the 99th percentile of the distances between vertices that are nearest in the first frame, at rest."""
    same = cKDTree(broken[0]).query(whole[0])[1]
    return float(np.percentile(np.linalg.norm(whole[1:] - broken[1:, same], axis=2), 99))


def _measured(*arguments: Any) -> tuple[tuple[str, ...], np.ndarray | None]:
    """Return the result of `measure`, or dashes if the operator fails."""
    try:
        return measure(*arguments)
    except (np.linalg.LinAlgError, MemoryError):
        return ("–",) * 5, None
    finally:
        fields.laplacian = tufted_cover


def main() -> None:
    log, *places = map(Path, sys.argv[1:])
    resource.setrlimit(resource.RLIMIT_AS, (MAX_MEMORY_BYTES, MAX_MEMORY_BYTES))
    print(HEADER)
    found = {file for place in places for file in (place.rglob("*") if place.is_dir() else [place])}
    for file in sorted(file for file in found if file.suffix.lower() in CHARACTER_FILES):
        try:
            proposed = new_puppet(file, file, limbs=False)
        except PuppetlineError as error:
            print(f"| {file.name} | refused: {error.found} | | | | |", flush=True)
            continue
        puppet, character = proposed.puppet, proposed.character
        mesh = character.solver_mesh()
        breakable = mesh.parts == 1 and len(mesh.vertices) <= MAX_BROKEN_VERTICES
        copies = broken(character.vertices, character.triangles) if breakable else []
        whole: list[np.ndarray | None] = [None] * len(OPERATORS)
        for title, copy in [(file.stem, mesh), *((f"… with {name}", weld(v, f)) for name, v, f in copies)]:
            found = [_measured(character, copy, puppet, log, *one) for one in zip(OPERATORS, whole, strict=True)]
            row = " | ".join(" / ".join(values) for values in zip(*(cells for cells, _ in found), strict=True))
            print(f"| {title} | {len(copy.vertices):,} | {row} |", flush=True)
            if copy is mesh:
                whole = [frames for _, frames in found]


if __name__ == "__main__":
    main()
