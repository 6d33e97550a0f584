"""Table 1 of the paper, and the same measured here."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from puppetline.examples.characters import CHARACTERS

from benchmarks import character_cost
from benchmarks.character_cost import in_process
from benchmarks.processes import MODULE
from engine_bridge.character.character import make_character
from engine_bridge.inspection.benchmark import CHARACTER, number
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import HandleTable

PAPER = (
    ("Dinosaur", "dinosaur", 14_000, 6, 2.917, 0.6132, 0.2353, 9.873, 10.11),
    ("Dinosaur", "dinosaur", 14_000, 10, 2.915, 0.6411, 0.2185, 9.722, 9.941),
    ("Armadillo", "biped", 60_000, 6, 15.21, 3.327, 0.2540, 31.91, 32.16),
    ("Armadillo", "biped", 60_000, 10, 15.22, 3.307, 0.3021, 31.78, 32.08),
    ("Pegasus", "pegasus", 32_046, 4, 7.494, 1.704, 0.2785, 18.50, 18.78),
    ("Dog", "dog", 18_114, 8, 3.611, 0.8725, 0.2203, 11.38, 11.60),
    ("Human", "human", 15_154, 9, 3.067, 0.7757, 0.2145, 10.62, 10.83),
)
"""The paper's character, the example character, vertices, handles, t_1 and t̃_1 in s, t_2,3, t_4, t_per in ms."""

HANDLE_JOINTS = (
    "hand_left",
    "hand_right",
    "head",
    "foot_left",
    "foot_right",
    "elbow_left",
    "elbow_right",
    "knee_left",
    "knee_right",
    "spine",
)
"""Joints of the handles of a row, in this order."""

FRAMES = 300
"""Number of frames of the performance."""


def table(scratch: Path) -> Iterator[str]:
    """Yield the rows of Table 1 of the paper, with an arrow from its values to those measured here."""
    columns = (
        *("character", "vertices", "handles", "t_1, s", "t̃_1, s", "t_2,3, ms", "t_4, ms", "t_per, ms"),
        *("iteration, ms", "vertices, ms"),
    )
    yield f"| {' | '.join(columns)} |"
    yield f"|{' --- |' * len(columns)}"
    for name, ours, vertices, handles, *times in PAPER:
        folder = scratch / f"{ours}_{handles}"
        _prepare(folder, ours, handles)
        found = in_process(folder, "table1_row", module=MODULE)
        whole = found["iteration_ms"] + found["vertices_ms"]
        own = (found["precompute_s"], found["reuse_s"], found["input_ms"], whole, found["input_ms"] + whole)
        parts = (found["iteration_ms"], found["vertices_ms"])
        cells = (
            f"{name} → {ours}",
            f"{vertices:,} → {found['vertices']:,}" if vertices != found["vertices"] else f"{vertices:,}",
            str(handles),
            *(f"{number(theirs)} → **{number(here)}**" for theirs, here in zip(times, own, strict=True)),
            *map(number, parts),
        )
        yield f"| {' | '.join(cells)} |"


def _prepare(folder: Path, name: str, handles: int) -> None:
    """Write the files of an example character, with handles that are far from each other."""
    made = CHARACTERS[name]()
    folder.mkdir()
    make_character(name, made.vertices, made.faces).document.save(folder / f"{name}.glb")
    character_cost.prepare(folder, folder / f"{name}.glb", FRAMES)
    proposed = puppet_file.load(folder / CHARACTER)
    own = tuple(
        HandleTable(name=joint, position=tuple(made.vertices[vertex].tolist()), joint=joint)
        for joint, vertex in zip(HANDLE_JOINTS, _far_apart(made.vertices, handles), strict=False)
    )
    puppet_file.dump(proposed.model_copy(update={"handle": own}), folder / CHARACTER)


def _far_apart(points: NDArray[np.float64], count: int) -> list[int]:
    """Return the indices of points, each of which is farthest from those before it."""
    chosen = [int(points[:, 1].argmax())]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
        chosen.append(int(distance.argmax()))
    return chosen
