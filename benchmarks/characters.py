"""Propose a puppet file for every character file, play a recording on it, and print a row of a table.

python -m benchmarks.characters LOG OUTPUT FILE_OR_FOLDER [FILE_OR_FOLDER …]

Folders are searched. OUTPUT is a folder for the puppet files, the animated characters and a contact sheet of all
characters: the rest pose and four frames of each.
"""

import json
import shutil
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import numpy as np

from engine_bridge.character.character import CHARACTER_FILES, load_character
from engine_bridge.export.convert import write
from engine_bridge.performance.clip import Clip, load_timeline, perform
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.performance.settings import Settings
from engine_bridge.pictures.contact_sheet import write_contact_sheet
from engine_bridge.pictures.mesh_picture import render
from engine_bridge.pictures.view import View
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet
from puppetline.errors import PuppetlineError
from solver.model import reduced_model
from solver.model.binding import Binding
from solver.motion.deformer import to_file_units

VALIDATOR = Path(__file__).parents[1] / "tests" / "peers" / "validate.mjs"
SHEET_FRAMES = 4
TILE_PIXELS = (200, 200)
HEADER = """| character | vertices | parts | repaired | pre-computation, s | limbs / handles | targets \
| largest error | stretch p99 | parts apart, worst | validator before → after |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"""


def main() -> None:
    log, output, *places = map(Path, sys.argv[1:])
    output.mkdir(parents=True, exist_ok=True)
    files = sorted({file for place in places for file in (_characters(place) if place.is_dir() else [place])})
    print(HEADER)
    tiles, labels = [], []
    for file in files:
        try:
            row, pictures = _play(file, log, output)
        except PuppetlineError as error:
            row = f"refused: found {error.found}; expected {error.expected}" + " |" * 9
        else:
            tiles += pictures
            labels += [file.stem, *[""] * SHEET_FRAMES]
        print(f"| {file.name} | {row} |", flush=True)
    write_contact_sheet(
        tiles, labels, 1 + SHEET_FRAMES, output / "characters.png", f"{len(labels) // (1 + SHEET_FRAMES)} characters"
    )


def _characters(folder: Path) -> list[Path]:
    return [path for path in folder.rglob("*") if path.suffix.lower() in CHARACTER_FILES]


def _play(file: Path, log: Path, output: Path) -> tuple[str, list[np.ndarray]]:
    puppet = output / f"{file.stem}.toml"
    puppet_file.dump(new_puppet(file, puppet, handles={}, maps={}).puppet, puppet)
    character = load_character(file)
    mesh = character.solver_mesh()
    start = time.perf_counter()
    reduced_model.build(mesh)
    seconds = time.perf_counter() - start
    prepared = load_prepared(puppet)
    timeline, notes = load_timeline(log, Settings())
    clip = perform(prepared, timeline, Settings(), notes, lambda *_: None)
    found = write(clip, output / f"{file.stem}.glb", log.stem, Settings(), lambda *_: None)
    columns = [
        f"{len(character.vertices):,}",
        mesh.parts,
        ", ".join(f"{count:,} {name}" for name, count in asdict(mesh.repairs).items() if count) or "–",
        f"{seconds:.2f}",
        f"{len(prepared.puppet.limb)} / {len(prepared.puppet.handle)}",
        found.targets,
        f"{found.error:.2g}",
        f"{found.stretch_p99:.3f}",
        "–" if found.parts_apart is None else f"{found.parts_apart:.2g}",
        f"{_validator_counts(file)} → {_validator_counts(Path(found.output))}",
    ]
    return " | ".join(map(str, columns)), _tiles(clip)


def _validator_counts(path: Path) -> str:
    """Return the numbers of the validator's errors and warnings, or a dash if the file is no glTF."""
    node = shutil.which("node")
    if node is None or path.suffix.lower() not in (".glb", ".gltf"):
        return "–"
    text = subprocess.run([node, VALIDATOR, path], capture_output=True, text=True, check=True).stdout
    report = json.loads(text)[str(path)]
    return f"{report['errors']}/{report['warnings']}"


def _tiles(clip: Clip) -> list[np.ndarray]:
    """Draw the rest pose, and `SHEET_FRAMES` frames evenly spaced over the clip."""
    prepared = clip.motion.prepared
    binding = Binding.of_solver_mesh(prepared.model, prepared.mesh)
    chosen = np.linspace(0, len(clip.motion) - 1, SHEET_FRAMES + 1).astype(int)[1:]
    solved = np.array([binding.vertices(to_file_units(clip.motion.R[index], prepared.model)) for index in chosen])
    poses = (
        np.concatenate([prepared.character.vertices[None], solved[:, prepared.mesh.of_render]])
        @ prepared.puppet.character.basis.T
    )
    view = View.around(poses)
    return [render(pose, prepared.character.triangles, view, TILE_PIXELS, prepared.character.colors) for pose in poses]


if __name__ == "__main__":
    main()
