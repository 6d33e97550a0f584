"""Measure the time of a frame in the Unity package's core, with Mono: python -m benchmarks.unity MESH

MESH is any character file; it gets a proposed puppet file and a pose. Mono and its compiler (mono, mcs) are required.
Unity's own runtimes are not measured.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from engine_bridge.performance.pose import Pose
from engine_bridge.performance.prepared_character import load_prepared
from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.proposal import new_puppet
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.header import Header, Kind, join, topic
from engine_bridge.service.protocol.payloads import encode
from engine_bridge.service.protocol.scene import StreamedCharacter
from solver.motion.deformer import Deformer

ROOT = Path(__file__).parents[1]
CORE = ROOT / "integrations" / "unity" / "Runtime" / "Core"
PROGRAMS = ROOT / "tests" / "integrations" / "unity" / "programs"
COLUMNS = ("what", "vertices", "ms", "bytes")


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_messages(Path(sys.argv[1]), folder)
        sources = [*CORE.glob("*.cs"), PROGRAMS / "Core.cs", PROGRAMS / "Said.cs"]
        subprocess.run(["mcs", "-langversion:7.2", "-optimize+", f"-out:{folder / 'core.exe'}", *sources], check=True)
        command = ["mono", folder / "core.exe", "measure", folder / "scene", folder / "controls"]
        print("| per frame | vertices | ms | bytes |\n| --- | --- | --- | --- |")
        for line in subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines():
            row = json.loads(line)
            print("|", " | ".join(f"{row[key]:.3g}" if key == "ms" else f"{row[key]}" for key in COLUMNS), "|")


def write_messages(mesh: Path, folder: Path) -> None:
    """Write a scene and a frame of controls."""
    puppet = folder / "puppet.toml"
    puppet_file.dump(new_puppet(mesh, puppet, limbs=False).puppet, puppet)
    prepared = load_prepared(puppet)
    deformer = Deformer(prepared.model, prepared.mesh, prepared.puppet.handle_positions)
    pose = deformer.solve(deformer.handles + 0.1 * prepared.model.diagonal)
    character = StreamedCharacter("measured", prepared, 1)
    frame = Frame(
        character=character,
        sequence=1,
        time=0.0,
        received=0,
        state="performing",
        user=1,
        pose=Pose(deformer.handles, np.tile(np.eye(4, 3), (0, 1, 1)), np.zeros(3), pose, prepared.model),
    )
    scene = Header(kind=Kind.SCENE, length=len(character.scene), revision=1)
    (folder / "scene").write_bytes(join(topic("measured", Kind.SCENE), scene, character.scene))
    controls = encode(Kind.CONTROLS, frame, 0)
    assert controls is not None
    (folder / "controls").write_bytes(controls)


if __name__ == "__main__":
    main()
