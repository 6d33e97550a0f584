"""The bodies in a character's file, and a character of one of them beside which everything else stays still."""

from collections import Counter
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from engine_bridge.character.character import TRIANGLES, CharacterMesh, Part, from_document
from engine_bridge.character.document import ELEMENT_ARRAY_BUFFER, Document
from engine_bridge.character.scene import own_mesh, show_all, tree, world_transforms
from engine_bridge.character.schema import Node, Primitive, copied
from puppetline.errors import PuppetError
from solver.anatomy.bodies import find_bodies


def bodies_of(character: CharacterMesh) -> NDArray[np.int64]:
    """Return the number (N,) of the body of each vertex, from 1, or `solver.anatomy.bodies.STILL`."""
    mesh = character.solver_mesh()
    together = np.full(len(mesh.vertices), -1)
    for part, place in zip(character.parts, character.vertex_slices, strict=True):
        together[mesh.of_render[place]] = _skeleton(character, part)
    return find_bodies(mesh, together)[mesh.of_render]


def _skeleton(character: CharacterMesh, part: Part) -> int:
    """Return the top joint of the skeleton that moves a part; −1 for none."""
    gltf = character.document.gltf
    if "skin" not in gltf["nodes"][part.node]:
        return -1
    joints = character.joints
    above, top = dict(tree(character.document)), gltf["skins"][gltf["nodes"][part.node]["skin"]]["joints"][0]
    way: int | None = top
    while way is not None:
        top, way = (way if way in joints else top), above.get(way)  # none above a joint in a circle of nodes
    return top


def with_body(character: CharacterMesh, bodies: NDArray[np.int64], number: int, where: str) -> CharacterMesh:
    """Return a character of which one body moves.

    Everything else that the file shows is in nodes of its own, at the top of the scene.

    Parameters
    ----------
    character : CharacterMesh
    bodies : (N,) int64
        From `bodies_of`.
    number : int
        From 1.
    where : str
        What chose the number, for the error.

    Raises
    ------
    PuppetError
        There is no body of this number.
    """
    if number > bodies.max():
        raise PuppetError(
            where,
            found=f"body {number} of a file that shows {int(bodies.max())}",
            expected="the number of a body, from 1 in the order of the file",
            fix="Choose one of these numbers, or leave it out.",
        )
    return character if (bodies == number).all() else _split(character, bodies == number)


def _split(character: CharacterMesh, moves: NDArray[np.bool_]) -> CharacterMesh:
    """Return a character of which some vertices (N,) move; the corners of a triangle do together."""
    document = character.document.copy()
    document.notes += character.document.notes
    gltf = document.gltf
    show_all(gltf)
    world, still = world_transforms(document), list[int]()
    shown = Counter(node.get("mesh") for node in gltf["nodes"])
    own = {(part.node, part.primitive): part for part in character.parts}
    rows = {key: moves[place] for key, place in zip(own, character.vertex_slices, strict=True)}
    for node in dict.fromkeys(part.node for part in character.parts):
        if all(chosen.all() for (other, _), chosen in rows.items() if other == node):
            continue
        mesh, moved, rest = own_mesh(document, node, shown), list[Primitive](), list[Primitive]()
        for index, primitive in enumerate(mesh["primitives"]):
            chosen = rows.get((node, index), np.zeros(0, dtype=bool))
            for kept, primitives in ((chosen, moved), (~chosen, rest)):
                if kept.all() and len(kept):
                    primitives.append(primitive)
                elif kept.any():
                    primitives.append(_part_of(document, primitive, own[node, index], kept))
        gltf["meshes"].append({**copied(mesh), "primitives": rest})
        still.append(_add_still(document, node, world[node]))
        if moved:
            mesh["primitives"] = moved
        else:
            for key in ("mesh", "skin", "weights"):
                gltf["nodes"][node].pop(key, None)  # type: ignore[misc]
    whole = from_document(document)
    parts = [part for part in whole.parts if part.node not in still]
    return replace(whole, parts=parts, still=tuple(part for part in whole.parts if part.node in still))


def _add_still(document: Document, node: int, world: NDArray[np.float64]) -> int:
    """Add a node at the top of the scene that shows the last mesh where another node is, and return its number."""
    gltf = document.gltf
    own = gltf["nodes"][node]
    added: Node = {"mesh": len(gltf["meshes"]) - 1, "name": f"{own.get('name', 'node')} still"}
    if "skin" in own:
        added["skin"] = own["skin"]
    if "weights" in own:
        added["weights"] = own["weights"]
    if not np.array_equal(world, np.eye(4)):
        added["matrix"] = world.T.ravel().tolist()
    gltf["nodes"].append(added)
    gltf["scenes"][gltf.get("scene", 0)].setdefault("nodes", []).append(len(gltf["nodes"]) - 1)
    return len(gltf["nodes"]) - 1


def _part_of(document: Document, primitive: Primitive, part: Part, kept: NDArray[np.bool_]) -> Primitive:
    """Return a primitive with some of the vertices (n,) of another one."""
    taken: Primitive = copied(primitive)
    for attributes in (taken["attributes"], *taken.get("targets", [])):
        for name, accessor in attributes.items():
            attributes[name] = document.add_rows(accessor, kept)
    number = np.cumsum(kept) - 1
    corners = number[part.triangles[kept[part.triangles[:, 0]]]].astype(np.uint32)
    taken["indices"], taken["mode"] = document.add(corners.ravel(), ELEMENT_ARRAY_BUFFER), TRIANGLES
    return taken
