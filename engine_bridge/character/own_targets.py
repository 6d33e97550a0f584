"""Morph targets that a character's file has, by their names."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import CharacterMesh, rest_weights
from engine_bridge.character.schema import Mesh, Primitive


def target_names(mesh: Mesh) -> list[str]:
    """Return the names of a mesh's morph targets, which programs write to its extras."""
    extras = mesh.get("extras")
    named = extras.get("targetNames") if isinstance(extras, dict) else None
    count = max((len(primitive.get("targets", [])) for primitive in mesh["primitives"]), default=0)
    return [str(name) for name in named][:count] if isinstance(named, list) else []


def names_of(character: CharacterMesh) -> list[str]:
    """Return the names of a character's morph targets, without duplicates."""
    gltf = character.document.gltf
    meshes = [gltf["meshes"][gltf["nodes"][part.node]["mesh"]] for part in character.parts]
    return list(dict.fromkeys(name for mesh in meshes for name in target_names(mesh)))


def displacements(character: CharacterMesh, target: str) -> NDArray[np.float32]:
    """Return the displacement (N, 3) of each vertex from rest to a weight of 1 of a target, world coordinates.

    Raises
    ------
    MeshError
        The target's array is damaged.
    """
    gltf, found = character.document.gltf, []
    for part in character.parts:
        node, moved = gltf["nodes"][part.node], np.zeros_like(part.vertices)
        mesh = gltf["meshes"][node["mesh"]]
        names, primitive = target_names(mesh), mesh["primitives"][part.primitive]
        if target in names and names.index(target) < len(primitive.get("targets", [])):
            number = names.index(target)
            attributes: Primitive = {"attributes": primitive["targets"][number]}
            local = character.document.attribute(attributes, "POSITION", len(part.vertices), 3)
            if local is not None:
                share = 1 - rest_weights(node, mesh)[number]
                moved = share * (part.to_world[:, :3, :3] @ local.astype(np.float64)[:, :, None])[:, :, 0]
        found.append(moved)
    return np.concatenate(found).astype(np.float32)


def weights_over_time(
    mesh: Mesh, rest: list[float], moved: Mapping[str, NDArray[np.float32]], count: int
) -> NDArray[np.float32]:
    """Return the weights (count, K) of a mesh's targets: those that are moved, by name, and the others at rest.

    Parameters
    ----------
    mesh : Mesh
    rest : list of float
        Of its K targets.
    moved : mapping of str to (count,) float32
    count : int
        Number of keyframes.
    """
    weights = np.tile(np.array(rest, dtype=np.float32), (count, 1))
    for number, name in enumerate(target_names(mesh)):
        if name in moved:
            weights[:, number] = rest[number] + (1 - np.float32(rest[number])) * moved[name]
    return weights
