"""Programs that open a .glb: run their players in tests/peers, and compare what they show with the solver.

Each player gets a file, a number of times and an output path. It writes the world positions of each (node, primitive)
of the file at evenly spaced times, from the start of the animation to its end.
"""

import ctypes.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.document import Document
from engine_bridge.character.document_reader import load_document
from engine_bridge.performance.clip import Clip
from solver.model.reduced_model import position_matrix

ROOT = Path(__file__).parents[1]
PEERS = ROOT / "tests" / "peers"
BLENDER = ROOT / ".venv-blender"
"""Virtual environment with bpy, which `make peers` creates."""

ASSIMP_VERSIONS = {(5, 1), (5, 2)}
"""Versions of assimp whose structures the player supports."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Shown:
    """Positions that a program shows.

    Attributes
    ----------
    times : (n,) float64
        Seconds.
    meshes : dict
        (node, primitive) of the file to (n, V, 3) world positions; NaN where the program dropped a vertex.
    report : dict
        Other output of the player; see its script.
    """

    times: Floats
    meshes: dict[tuple[int, int], Floats]
    report: dict[str, Any]


def commands() -> dict[str, list[str | Path] | None]:
    """Return the command of each program's player; None if the program is not installed."""
    node, godot = shutil.which("node"), shutil.which(os.environ.get("GODOT", "godot"))
    modules = node is not None and (PEERS / "node_modules").is_dir()
    bpy = any(BLENDER.glob("lib/*/site-packages/bpy"))
    return {
        "Blender": [BLENDER / "bin" / "python", PEERS / "play_blender.py"] if bpy else None,
        "three.js": [node, PEERS / "play.mjs"] if modules else None,
        "Babylon.js": [node, PEERS / "play_babylon.mjs"] if modules else None,
        "assimp": [sys.executable, PEERS / "play_assimp.py"] if _has_assimp() else None,
        "Godot": [godot, "--headless", "--path", PEERS / "godot", "--script", "play.gd", "--"] if godot else None,
    }


def _has_assimp() -> bool:
    """Return whether the C library of assimp is installed in a version that the player supports."""
    name = ctypes.util.find_library("assimp")
    if name is None:
        return False
    library = ctypes.CDLL(name)
    return (library.aiGetVersionMajor(), library.aiGetVersionMinor()) in ASSIMP_VERSIONS


def play(command: list[str | Path], file: Path, count: int, base: Path, *more: str) -> Shown:
    """Play a file's first animation at `count` times, the start and the end included.

    Raises
    ------
    RuntimeError
        The program failed; the message contains its output.
    """
    ran = subprocess.run(
        [*map(str, command), str(file), str(count), str(base), *more], capture_output=True, text=True, check=False
    )
    output = base.with_name(f"{base.name}.json")
    if ran.returncode or not output.exists():
        raise RuntimeError(f"{command[0]} on {file}: exit code {ran.returncode}\n{ran.stdout}\n{ran.stderr}")
    report = json.loads(output.read_text(encoding="utf-8"))
    floats = np.fromfile(base.with_name(f"{base.name}.bin"), dtype="<f4")
    document = load_document(file)
    used, numbers = (
        vertices_used(document),
        {node.get("name"): index for index, node in enumerate(document.gltf["nodes"])},
    )
    meshes = {}
    for mesh in report["meshes"]:
        if isinstance(mesh["node"], str):
            mesh["node"] = numbers[mesh["node"]]
        start = mesh["positions"]
        block = floats[start : start + 3 * count * mesh["count"]].reshape(count, mesh["count"], 3).astype(np.float64)
        if mesh["primitive"] is None:  # Blender: all primitives together, without the vertices that none of them uses
            own = {key: vertices for key, vertices in used.items() if key[0] == mesh["node"]}
            pieces = np.split(block, np.cumsum([len(vertices) for vertices in own.values()]), axis=1)
            if len(pieces[-1][0]):
                raise RuntimeError(f"{file}: {mesh['name']} has {len(pieces[-1][0])} vertices more than the file")
            for (key, vertices), piece in zip(own.items(), pieces[:-1], strict=True):
                meshes[key] = np.full((count, vertices[-1] + 1, 3), np.nan)
                meshes[key][:, vertices] = piece
        else:
            meshes[mesh["node"], mesh["primitive"]] = block
    return Shown(np.array(report["times"]), meshes, report)


def vertices_used(document: Document) -> dict[tuple[int, int], NDArray[np.int64]]:
    """Return the sorted vertices of each (node, primitive) that its indices use."""
    used = {}
    for index, node in enumerate(document.gltf["nodes"]):
        if "mesh" in node:
            for number, primitive in enumerate(document.gltf["meshes"][node["mesh"]]["primitives"]):
                if "indices" in primitive:
                    used[index, number] = np.unique(document.array(primitive["indices"])).astype(np.int64)
                else:
                    count = document.gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
                    used[index, number] = np.arange(count)
    return used


def solved(clip: Clip) -> Callable[[Floats], dict[tuple[int, int], Floats]]:
    """Return a function from times to the world positions of each (node, primitive), linear between keyframes.

    Positions are float64 and computed from the control variables, not from the exported file; key times are float32, as
    in the file.
    """
    motion, prepared = clip.motion, clip.motion.prepared
    model, mesh, character = prepared.model, prepared.mesh, prepared.character
    W = position_matrix(
        model.to_model(mesh.vertices), model.isoline_coordinates.astype(np.float64), model.weights, model.isolines
    )
    last = len(motion) - 1
    clock = motion.times.astype(np.float32)

    def positions(times: Floats) -> dict[tuple[int, int], Floats]:
        at = np.interp(times, clock, np.arange(last + 1))
        before = np.minimum(np.floor(at).astype(int), last - 1)
        share = (at - before)[:, None, None]
        R = (1 - share) * motion.R[before].astype(np.float64) + share * motion.R[before + 1].astype(np.float64)
        moved = np.array([W @ each for each in R]) * model.diagonal + model.center
        if prepared.puppet.root is not None:
            moved += (1 - share) * motion.root[before][:, None] + share * motion.root[before + 1][:, None]
        return {
            (part.node, part.primitive): moved[:, mesh.of_render[place]]
            for part, place in zip(character.parts, character.vertex_slices, strict=True)
        }

    return positions


def farthest(shown: dict[tuple[int, int], Floats], expected: dict[tuple[int, int], Floats]) -> float:
    """Return the largest distance of a vertex from its expected position, over all times and meshes.

    Raises
    ------
    KeyError
        A mesh that is not shown.
    """
    worst = 0.0
    for key, positions in expected.items():
        seen = shown[key]
        positions = positions[:, : seen.shape[1]]
        distances = np.linalg.norm(seen - positions, axis=2)
        if np.isnan(distances).all():
            raise KeyError(key)
        worst = max(worst, float(np.nanmax(distances)))
    return worst
