"""Follow a character of `puppetline serve` as docs/protocol.md describes it."""

import argparse
import json
import secrets
import struct
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import zmq
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
HEADER = struct.Struct("<4Bi2IQd2Q3f4x")
KINDS = {"controls": 2, "morphs": 3, "vertices": 4}
STATES = "waiting", "calibrating", "performing", "leaving"


class Frame(NamedTuple):
    """A frame of a character: positions in file coordinates and unit normals, n × 3 each."""

    sequence: int
    time: float
    state: str
    positions: Floats
    normals: Floats


def unit(vectors: Floats) -> Floats:
    """Vectors of length 1; what is zero stays so."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


def read_scene(payload: bytes) -> dict[str, Any]:
    """Description of a scene, with the arrays in place of where they lie."""
    (length,) = struct.unpack_from("<I", payload)
    scene = json.loads(payload[4 : 4 + length])
    for name in "positions", "normals", "ladder", "slopes":
        shape, offset = scene["arrays"][name]["shape"], scene["arrays"][name]["offset"]
        scene[name] = np.frombuffer(payload, "<f4", int(np.prod(shape)), 4 + length + offset).reshape(shape)
    return scene


def deform(scene: dict[str, Any], controls: Floats) -> tuple[Floats, Floats]:
    """Positions and normals that the transforms of the isolines make."""
    rest, ladder, weights = scene["normals"], scene["ladder"], np.array(scene["weights"], np.float32)
    T = controls.reshape(scene["fields"], scene["isolines"], 3, 4)
    k = np.minimum(np.floor(ladder), scene["isolines"] - 2).astype(int)
    fields = np.arange(scene["fields"])
    low, D = T[fields, k], T[fields, k + 1] - T[fields, k]
    B = np.einsum("f,vfij->vij", weights, low + (ladder - k)[..., None, None] * D)
    x = np.pad(scene["positions"], [(0, 0), (0, 1)], constant_values=1)[..., None]
    a = unit(np.cross(np.eye(3, dtype=np.float32)[np.argmin(np.abs(rest), axis=1)], rest))
    tangents = np.stack([a, np.cross(rest, a)], axis=-1)
    bent = B[:, :, :3] @ tangents + np.einsum("f,vfi,vfs->vis", weights, (D @ x[:, None])[..., 0], scene["slopes"])
    return (B @ x)[..., 0], unit(np.cross(bent[..., 0], bent[..., 1]))


def read_targets(path: Path, scene: dict[str, Any]) -> NDArray[np.float32]:
    """How the baked morph targets move positions and normals of the scene: 2 × K × n × 3."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    gltf, binary = json.loads(data[20 : 20 + length]), data[28 + length :]
    targets = np.zeros((2, len(scene["morphs"]), scene["vertices"], 3), np.float32)
    parts = iter(scene["parts"])

    def read(index: int) -> NDArray[np.float32]:
        accessor = gltf["accessors"][index]
        view = gltf["bufferViews"][accessor["bufferView"]]
        offset = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(binary, "<f4", 3 * accessor["count"], offset).reshape(-1, 3)

    def place(index: int, above: Floats) -> Iterator[tuple[int, Floats]]:
        node = gltf["nodes"][index]
        x, y, z, w = node.get("rotation", (0, 0, 0, 1))
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        turned = (np.eye(3) + 2 * (w * cross + cross @ cross)) * node.get("scale", (1, 1, 1))
        linear = above @ (np.reshape(node["matrix"], (4, 4)).T[:3, :3] if "matrix" in node else turned)
        yield index, linear
        for child in node.get("children", []):
            yield from place(child, linear)

    roots = gltf["scenes"][gltf.get("scene", 0)]["nodes"]
    for index, linear in sorted((item for root in roots for item in place(root, np.eye(3))), key=lambda item: item[0]):
        node = gltf["nodes"][index]
        for primitive in gltf["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []:
            first, count = next(parts)["vertices"]
            stretch = np.linalg.norm(scene["normals"][first : first + count] @ linear, axis=1, keepdims=True)
            for k, target in enumerate(primitive["targets"][-len(scene["morphs"]) :]):
                targets[0, k, first : first + count] = read(target["POSITION"]) @ linear.T
                targets[1, k, first : first + count] = read(target["NORMAL"]) @ np.linalg.inv(linear) * stretch
    return targets


class Follower:
    """
    Makes frames of messages.

    Parameters
    ----------
    morphs : pathlib.Path, optional
        The .glb that `puppetline bake` made, for the kind morphs.
    """

    def __init__(self, morphs: Path | None = None) -> None:
        self.scene: dict[str, Any] | None = None
        self._morphs = morphs
        self._targets = np.zeros((2, 0, 0, 3), np.float32)
        self._sequence = -1

    def take(self, message: bytes) -> Frame | None:
        """Frame that a message shows; None for any other message, and while there is no scene for it."""
        major, _, kind, state, _, revision, length, sequence, seconds, *_, x, y, z = HEADER.unpack_from(message, 64)
        if major != 1:
            raise SystemExit(f"The service speaks version {major} of the protocol, and this client version 1.")
        payload = message[128 : 128 + length]
        if len(payload) < length:
            raise ValueError("A message is cut short.")
        if kind == 1:
            self._show(read_scene(payload), revision)
        elif kind in KINDS.values() and self.scene is not None:
            if revision == self.scene["revision"] and sequence > self._sequence:
                self._sequence = sequence
                values = np.frombuffer(payload, "<f4")
                
        return None
