"""Films as one .glb: all characters of a scene with their animations, in one animation on the film's clock."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from engine_bridge.character.document import Document
from engine_bridge.character.scene import top_nodes
from engine_bridge.character.schema import LISTS, REFERENCES, Animation, Node, empty, found_at
from engine_bridge.export.animation import add_channel
from engine_bridge.export.motion_export import export_motion
from engine_bridge.film.actor import Actor
from engine_bridge.film.film import FilmSummary, check_output
from engine_bridge.film.production import Production, Progress, produce
from engine_bridge.film.scene import load
from engine_bridge.performance.motion import SolvedMotion
from engine_bridge.performance.settings import Settings

OTHER_LISTS = ("cameras", "samplers")
"""Lists of a glTF file that Puppetline does not read, but whose items others refer to."""

OTHER_REFERENCES = {
    "nodes.*.camera": "cameras",
    "nodes.*.extensions.EXT_mesh_gpu_instancing.attributes.*": "accessors",
    "textures.*.sampler": "samplers",
    "textures.*.extensions.*.source": "images",
}
"""Paths of further indices, as in `REFERENCES`."""

NOT_MERGED = ("scenes", "animations", "buffers", "extensionsUsed", "extensionsRequired")
"""Lists of a glTF file that are not simply appended to another file's."""


def make_document(path: Path, output: Path, progress: Progress) -> FilmSummary:
    """Write the characters of a scene file and their animations as one .glb.

    Parameters
    ----------
    path, output : Path
    progress : callable

    Raises
    ------
    PuppetlineError
        Before anything is written.
    """
    check_output(output, path)
    scene = load(path)
    production = produce(path, scene, progress)
    production.extents(progress)
    film = Document(empty(), name=output.name)
    film.gltf["scenes"], film.gltf["scene"] = [{"nodes": []}], 0
    animation: Animation = {"name": path.stem, "channels": [], "samplers": []}
    notes = list(production.notes)
    for actor in production.actors:
        settings = Settings(fps=production.fps).for_puppet(actor.prepared.puppet)
        document, result = export_motion(_motion(actor, production), path.stem, settings, progress)
        notes += [f"{actor.name}: {note}" for note in result.notes]
        before = len(actor.prepared.character.document.gltf["animations"])
        drop_animations(document, len(document.gltf["animations"]) - before)
        top, moved = merge(film, document)
        for each in moved:
            first = len(animation["samplers"])
            animation["samplers"] += each["samplers"]
            animation["channels"] += [
                {**channel, "sampler": channel["sampler"] + first} for channel in each["channels"]
            ]
        _add_placed(film, animation, actor, production, top)
    if animation["channels"]:
        film.gltf["animations"] = [animation]
    film.repack()
    film.save(output)
    return FilmSummary(
        output=str(output),
        frames=production.frames,
        seconds=(production.frames - 1) / production.fps,
        fps=production.fps,
        bytes=output.stat().st_size,
        notes=tuple(notes),
    )


def _motion(actor: Actor, production: Production) -> SolvedMotion:
    """Return the motion of an actor in the whole film."""
    motion = SolvedMotion(actor.prepared, production.fps)
    for frame in range(production.frames):
        motion.append(actor.pose(frame))
    return motion


def _add_placed(film: Document, animation: Animation, actor: Actor, production: Production, top: list[int]) -> None:
    """Add a node that puts an actor on the stage, animated if it changes its place.

    Skinned meshes stay at the top, because they follow their joints and not their parents.
    """
    nodes, footing = film.gltf["nodes"], actor.footing
    places = [actor.place(frame) for frame in range(production.frames)]
    translations = np.array([place.position - footing.lift for place in places])
    angles = np.radians([place.turn for place in places])
    turns = scipy.spatial.transform.Rotation.from_rotvec(angles[:, None] * np.array([0.0, 1.0, 0.0]))
    rotations = (turns * scipy.spatial.transform.Rotation.from_matrix(footing.basis)).as_quat()
    hanging = [node for node in top if "skin" in nodes[node] and not nodes[node].get("children")]
    node: Node = {
        "name": actor.name,
        "translation": translations[0].tolist(),
        "rotation": rotations[0].tolist(),
        "scale": [footing.scale] * 3,
    }
    if len(hanging) < len(top):
        node["children"] = [each for each in top if each not in hanging]
    nodes.append(node)
    film.gltf["scenes"][0]["nodes"] += [len(nodes) - 1, *hanging]
    for values, name in ((translations, "translation"), (rotations, "rotation")):
        if (values != values[0]).any():
            clock = film.add((np.arange(production.frames) / production.fps).astype(np.float32), bounds=True)
            add_channel(film, animation, clock, values.astype(np.float32), len(nodes) - 1, name)


def drop_animations(document: Document, kept: int) -> None:
    """Drop all but the first animations of a document, and the arrays that only the others use."""
    gltf: Any = document.gltf
    samplers = [sampler for animation in gltf["animations"][kept:] for sampler in animation["samplers"]]
    gltf["animations"] = gltf["animations"][:kept]
    gone = {sampler[name] for sampler in samplers for name in ("input", "output")}
    for name in ("accessors", "bufferViews"):
        paths = [path.split(".") for path, target in (REFERENCES | OTHER_REFERENCES).items() if target == name]
        gone -= {index for steps in paths for index in found_at(gltf, steps)}
        left = [index for index in range(len(gltf[name])) if index not in gone]
        numbers = {index: number for number, index in enumerate(left)}
        dropped = [item for index, item in enumerate(gltf[name]) if index in gone]
        gltf[name] = [gltf[name][index] for index in left]
        for steps in paths:
            _renumber(gltf, steps, numbers.__getitem__)
        gone = {accessor["bufferView"] for accessor in dropped if "bufferView" in accessor}
    document.repack()


def merge(film: Document, added: Document) -> tuple[list[int], list[Animation]]:
    """Append the contents of a document to another one.

    Extensions of the whole file are dropped, with what refers to them: lights, variants and data of avatars.

    Parameters
    ----------
    film, added : Document
        `added` must not be used afterwards.

    Returns
    -------
    top : list of int
        Numbers of its top nodes in `film`.
    animations : list of Animation
        Its animations, which are not added.
    """
    source: Any = added.gltf
    target: Any = film.gltf
    top = top_nodes(source)
    dropped = set(source.pop("extensions", {}))
    _drop_extensions(source, dropped)
    start = film.append(added.blob)
    for view in source["bufferViews"]:
        view["byteOffset"] = view.get("byteOffset", 0) + start
    offsets = {name: len(target.get(name, [])) for name in (*LISTS, *OTHER_LISTS)}
    for path, name in (*REFERENCES.items(), *OTHER_REFERENCES.items()):
        if not path.startswith(("scene", "materials", "bufferViews")):
            _renumber(source, path.split("."), offsets[name].__add__)
    _shift_textures(source["materials"], offsets["textures"])
    for name in ("extensionsUsed", "extensionsRequired"):
        target[name] += [each for each in source[name] if each not in dropped and each not in target[name]]
    for name in offsets:
        if name not in NOT_MERGED and source.get(name):
            target[name] = [*target.get(name, []), *source[name]]
    return [node + offsets["nodes"] for node in top], source["animations"]


def _renumber(value: Any, steps: list[str], number: Callable[[int], int]) -> None:
    """Replace all indices at a path in JSON, with a star for all items."""
    step, *rest = steps
    keys = (list(value) if isinstance(value, dict) else range(len(value))) if step == "*" else [step]
    for key in keys:
        if isinstance(value, dict) and key not in value:
            continue
        if rest:
            _renumber(value[key], rest, number)
        else:
            value[key] = number(value[key])


def _shift_textures(value: Any, offset: int) -> None:
    """Add an offset to the textures of materials, which their extensions refer to, too."""
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        if key == "index" and isinstance(item, int):
            value[key] = item + offset
        elif key != "extras" and isinstance(item, dict | list):
            _shift_textures(item, offset)


def _drop_extensions(value: Any, dropped: set[str]) -> None:
    """Remove extensions from all parts of a description."""
    for key, item in list(value.items() if isinstance(value, dict) else enumerate(value)):
        if key == "extensions" and isinstance(item, dict):
            value[key] = {name: content for name, content in item.items() if name not in dropped}
            if not value[key]:
                del value[key]
        elif key != "extras" and isinstance(item, dict | list):
            _drop_extensions(item, dropped)
