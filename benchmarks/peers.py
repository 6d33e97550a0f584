"""Compare exported files in Blender with the solver: ``python -m benchmarks.peers [--data FOLDER]``.

Each example character plays its own motion. With a folder of real meshes and recordings, five characters with proposed
puppet files also play three recordings each. A row of the table is a file with morph targets: the largest distance of a
vertex from its position in the solver at forty evenly spaced times, relative to the diagonal.
"""

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks import players
from benchmarks.own_cache import own_cache
from engine_bridge.character import examples
from engine_bridge.character.document_reader import load_document
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet

TIMES = 40
CHARACTERS = (
    "armadillo.obj",
    "gltf/kaykit_Knight.glb",
    "gltf/khronos_Fox.glb",
    "gltf/quaternius_Adventurer.glb",
    "gltf/quaternius_George.glb",
)
RECORDINGS = ("utkinect/joints_s01_e01.txt", "msrc12/P1_1_1_p19.csv", "kinect_v2_laban_csv/Ges02_balancinghands.csv")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="a folder with the real meshes (mesh/) and recordings (logs/)")
    options = parser.parse_args()
    blender = players.commands()["Blender"]
    if blender is None:
        parser.error("Blender is not installed: run make peers")
    with tempfile.TemporaryDirectory() as place, own_cache(Path(place)):
        folder, version = Path(place), None
        for character, log, puppet in [*_examples(folder), *(_real(folder, options.data) if options.data else ())]:
            output = folder / "out.glb"
            clip, summary = convert(log, puppet, output, Settings())
            shown = players.play(blender, output, TIMES, folder / "shown")
            if version is None:
                version = shown.report["version"]
                print(f"Blender {version}, {TIMES} times per file; distances as % of the diagonal\n")
                print("| character | recording | frames | targets | weights | printed error | largest distance |")
                print("| --- | --- | --- | --- | --- | --- | --- |")
            distance = (
                players.farthest(shown.meshes, players.solved(clip)(shown.times)) / clip.motion.prepared.mesh.diagonal
            )
            low, high = _weights(output)
            print(
                f"| {character} | {log.stem} | {summary.frames:,} | {summary.targets} | {low:.3g} to {high:.3g} "
                f"| {100 * summary.error:.3f} % | {100 * distance:.3f} % |",
                flush=True,
            )


def _examples(folder: Path) -> Iterator[tuple[str, Path, Path]]:
    for name in examples.MOTIONS:
        yield name, *examples.prepare(name, folder)


def _real(folder: Path, data: Path) -> Iterator[tuple[str, Path, Path]]:
    for name in CHARACTERS:
        mesh = data / "mesh" / name
        puppet = folder / f"{mesh.stem}.toml"
        puppet_file.dump(new_puppet(mesh, puppet, handles={}, maps={}).puppet, puppet)
        for log in RECORDINGS:
            yield mesh.stem, data / "logs" / log, puppet


def _weights(file: Path) -> tuple[float, float]:
    """Return the smallest and the largest weight of the first animation."""
    document = load_document(file)
    animation = document.gltf["animations"][0]
    keys = [
        document.array(animation["samplers"][channel["sampler"]]["output"])
        for channel in animation["channels"]
        if channel["target"]["path"] == "weights"
    ]
    return min(float(values.min()) for values in keys), max(float(values.max()) for values in keys)


if __name__ == "__main__":
    main()
