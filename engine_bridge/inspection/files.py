"""The contents of a mesh, a recording, a puppet file or an animated .glb, as plain values."""

from pathlib import Path
from typing import Any, Literal

import numpy as np

from capture.formats import FORMATS, read_log, recognize, table
from capture.formats.kinds import refusal
from capture.formats.options import ReadOptions
from capture.skeleton import LOST, TRACKED
from engine_bridge.character.character import CHARACTER_FILES, CharacterMesh, load_character, rest_weights
from engine_bridge.character.gltf_file import MAGIC
from engine_bridge.character.surface_document import SURFACE_FILES
from engine_bridge.puppet import puppet_file
from engine_bridge.service.protocol.clip_file import read_clip
from engine_bridge.service.protocol.header import WireError
from puppetline import toml_schema
from puppetline.errors import PuppetlineError
from puppetline.files import read_whole
from solver.anatomy.standing import propose_standing

Kind = Literal["puppet", "scene", "service", "log", "clip", "character"]

KIND_NAMES: dict[Kind, str] = {
    "puppet": "a puppet file",
    "scene": "a scene file",
    "service": "a service file",
    "log": "a recording",
    "clip": "a clip",
    "character": "a mesh",
}
"""What files are called in messages, by their kind."""


def inspect(path: Path) -> dict[str, Any]:
    """Describe a file, whose kind is detected by content.

    Returns
    -------
    dict
        Plain values for JSON; ``kind`` is a `Kind`.

    Raises
    ------
    PuppetlineError
        The file cannot be read, or is of no supported kind.
    """
    kind = kind_of(path)
    describe = {"puppet": _puppet, "log": _log, "clip": _clip, "character": _character}.get(kind, _tables)
    return {"kind": kind, **describe(path)}


def kind_of(path: Path) -> Kind:
    """Return the kind of a file, which is detected by content.

    Raises
    ------
    PuppetlineError
        The file cannot be read, or is of no supported kind.
    """
    if not path.is_file():
        found = "a folder" if path.is_dir() else "no such file"
        raise PuppetlineError(path, found=found, expected="a file", fix="Check the path.")
    if path.suffix.lower() == ".toml":
        return toml_schema.kind_of(_tables(path)) or "puppet"
    if recognize(path) is not None:
        return "log"
    with path.open("rb") as file:
        is_glb = file.read(len(MAGIC)) == MAGIC
    if path.suffix.lower() == ".clip":
        return "clip"
    if is_glb or path.suffix.lower() in CHARACTER_FILES:
        return "character"
    other = refusal(path)
    expected = f"a puppet file (.toml), a clip (.clip), a mesh ({', '.join(CHARACTER_FILES)}), or {other.expected}"
    raise PuppetlineError(path, found=other.found, expected=expected, fix=other.fix)


def _tables(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file, as they are written."""
    return toml_schema.parse(
        toml_schema.read_text(path, "a TOML file", "Check the path.", PuppetlineError), path, PuppetlineError
    )


def _puppet(path: Path) -> dict[str, Any]:
    puppet = puppet_file.load(path)
    mesh = path.parent / puppet.character.mesh
    return {
        "character": puppet.character.mesh,
        "mesh_found": mesh.is_file(),
        "limbs": {
            limb.name: limb.model_dump(mode="json", include={"nodes", "points", "follow", "gain"})
            | {"joints": [list(joints) for joints in limb.driven_by], "parent": puppet.limb_parents[limb.name]}
            for limb in puppet.limb
        },
        "handles": {
            handle.name: handle.model_dump(mode="json", include={"position", "axes", "gain"})
            | {"joints": list(handle.driven_by)}
            for handle in puppet.handle
        },
        "root": None if puppet.root is None else puppet.root.model_dump(),
        "retarget": puppet.retarget.model_dump(),
        "smoothing": puppet.smoothing.model_dump(),
        "solver": puppet.solver.model_dump() | {"rotations": puppet.solver.rotations or "automatic"},
    }


def _log(path: Path) -> dict[str, Any]:
    module = recognize(path)
    name = module.__name__.rpartition(".")[2] if module else ""
    users = {}
    for clip in read_log(path):
        steps = np.diff(clip.times)
        users[str(clip.user)] = {
            "frames": len(clip.times),
            "tracked_frames": clip.tracked_frames,
            "seconds": float(clip.times[-1] - clip.times[0]),
            "frames_a_second": float(1 / np.median(steps)) if len(steps) else None,
            "longest_gap_seconds": float(steps.max()) if len(steps) else 0.0,
            "joints_tracked": float(np.mean(clip.confidence >= TRACKED)),
            "joints_lost": float(np.mean(clip.confidence == LOST)),
            "notes": list(clip.notes),
        }
    columns = {"columns": table.columns(path, ReadOptions())} if module is table else {}
    return {"format": FORMATS[name], "users": users, **columns}


def _clip(path: Path) -> dict[str, Any]:
    content = read_whole(path, "a clip that puppetline clip wrote", PuppetlineError)
    try:
        facts, scene, *frames = read_clip(content)
    except (WireError, ValueError) as error:
        raise PuppetlineError(
            path,
            found=f"a damaged clip ({error})",
            expected="a clip that puppetline clip wrote",
            fix="Write it again with puppetline clip.",
        ) from error
    counts = {name: scene.body.facts[name] for name in ("vertices", "triangles", "diagonal")}
    return {**facts.body, "seconds": frames[-1].header.time, **counts}


def _character(path: Path) -> dict[str, Any]:
    character = load_character(path)
    gltf = character.document.gltf
    mesh = character.solver_mesh()
    stands = propose_standing(mesh, specified=path.suffix.lower() not in SURFACE_FILES)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    return {
        "vertices": len(character.vertices),
        "triangles": len(character.triangles),
        "primitives": len(character.parts),
        "materials": [material.get("name", "") for material in gltf["materials"]],
        "bounds": [low.tolist(), high.tolist()],
        "diagonal": mesh.diagonal,
        "solver_vertices": len(mesh.vertices),
        "solver_triangles": len(mesh.faces),
        "connected_parts": mesh.parts,
        "repairs": mesh.repairs.describe(),
        "border_edges": mesh.border_edges,
        "nonmanifold_edges": mesh.nonmanifold_edges,
        "stands": {"up": stands.up, "front": stands.front, "because": list(stands.reasons)},
        "skins": len(gltf["skins"]),
        "pictures": len(gltf["images"]),
        "animations": [_animation(character, index) for index in range(len(gltf["animations"]))],
        "notes": character.document.notes,
    }


def _animation(character: CharacterMesh, index: int) -> dict[str, Any]:
    gltf = character.document.gltf
    animation = gltf["animations"][index]
    clocks = [gltf["accessors"][sampler["input"]] for sampler in animation["samplers"]]
    targets = [channel["target"] for channel in animation["channels"]]
    morphed = [gltf["nodes"][target["node"]] for target in targets if target["path"] == "weights" and "node" in target]
    return {
        "name": animation.get("name", ""),
        "keyframes": max((clock["count"] for clock in clocks), default=0),
        "seconds": max((clock["max"][0] for clock in clocks if clock.get("max")), default=0.0),
        "morph_targets": max(
            (len(rest_weights(node, gltf["meshes"][node["mesh"]])) for node in morphed if "mesh" in node), default=0
        ),
        "moves_nodes": any(target["path"] != "weights" for target in targets),
    }
