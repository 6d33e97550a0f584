"""Reads the morph targets of a .glb from `puppetline bake`, as engines do when they import it (docs/morphs.md)."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]


def read_targets(baked: Path) -> Floats:
    """Return the displacement of each vertex by each morph target (K, n, 3), in the order of the scene's vertices."""
    content = baked.read_bytes()
    start = 28 + int.from_bytes(content[12:16], "little")
    gltf = json.loads(content[20 : start - 8])
    count = len(gltf["asset"]["extras"]["puppetline_morphs"]["lengths"])
    targets = []
    for primitive, linear in primitives(gltf, gltf["scenes"][gltf.get("scene", 0)]["nodes"], np.eye(3)):
        accessors = [gltf["accessors"][target["POSITION"]] for target in primitive["targets"][-count:]]
        offsets = [start + gltf["bufferViews"][each["bufferView"]]["byteOffset"] for each in accessors]
        shape = count, accessors[0]["count"], 3
        values = [np.frombuffer(content, "<f4", shape[1] * 3, offset) for offset in offsets]
        targets.append(np.reshape(values, shape) @ linear.T)
    return np.concatenate(targets, axis=1)


def primitives(gltf: dict[str, Any], nodes: list[int], above: Floats) -> Iterator[tuple[dict[str, Any], Floats]]:
    """Yield the primitives with triangles in a tree of nodes, each with the linear part of its node's transform."""
    for node in (gltf["nodes"][index] for index in nodes):
        *axis, w = node.get("rotation", (0, 0, 0, 1))
        cross = np.cross(np.eye(3), axis)
        linear = (np.eye(3) + 2 * (w * cross + cross @ cross)) * node.get("scale", 1)
        linear = above @ (np.reshape(node["matrix"], (4, 4)).T[:3, :3] if "matrix" in node else linear)
        if "skin" in node:
            raise ValueError("This example does not support morph targets of a mesh with a skin.")
        if "mesh" in node:
            own = gltf["meshes"][node["mesh"]]["primitives"]
            yield from ((primitive, linear) for primitive in own if primitive.get("mode", 4) >= 4)
        yield from primitives(gltf, node.get("children", []), linear)
