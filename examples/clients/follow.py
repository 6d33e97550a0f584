"""Follows a character of `puppetline serve` as docs/protocol.md describes it, and says what it sees."""

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
Scene = dict[str, Any]
HEADER = struct.Struct("<4Bi2IQd2Q3f4x")
KINDS = {"scene": 1, "controls": 2, "morphs": 3, "vertices": 4}
STATES = "waiting", "calibrating", "performing", "leaving"
MALFORMED = ValueError, TypeError, LookupError, struct.error


class Header(NamedTuple):
    """What stands before each payload; x, y and z are the root."""

    major: int
    minor: int
    kind: int
    state: int
    user: int
    revision: int
    length: int
    sequence: int
    time: float
    received: int
    published: int
    x: float
    y: float
    z: float


class Frame(NamedTuple):
    """A frame of a character: positions in file coordinates and unit normals, n × 3."""

    header: Header
    positions: Floats
    normals: Floats


def follow(
    address: str, character: str, mode: str, token: str | None = None, baked: Path | None = None
) -> Iterator[Frame]:
    """
    Frames of a character, the newest whenever one is asked for; without end.

    Parameters
    ----------
    mode : str
        Which messages to follow: controls, morphs or vertices.
    baked : pathlib.Path, optional
        The .glb that has the targets, for the mode morphs.
    """
    scene: Scene | None = None
    sequence, asked = -1, time.monotonic()
    own = f"{character}/scene/{secrets.token_hex(8)}\0"
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.heartbeat_ivl, socket.heartbeat_timeout = 2000, 6000
        if token is not None:
            socket.plain_username, socket.plain_password = b"follow", token.encode()
        socket.connect(address)
        socket.subscribe(own)
        socket.subscribe(f"{character}/{mode}\0")
        while True:
            for message in newest(socket):
                if baked is not None and scene is not None and "targets" not in scene:
                    scene["targets"] = read_targets(baked, scene)
                try:
                    header, payload = split(message)
                    if header.kind == KINDS["scene"]:
                        scene, sequence = read_scene(payload), -1
                    if header.kind != KINDS[mode] or scene is None:
                        continue
                    if header.revision != scene["revision"] or header.sequence <= sequence:
                        scene = None
                        continue
                    frame = Frame(header, *pose(scene, header, payload))
                except MALFORMED:
                    continue
                sequence = header.sequence
                yield frame
            if scene is None and time.monotonic() > asked + 1:
                asked = time.monotonic()
                socket.unsubscribe(own)
                socket.subscribe(own)


def newest(socket: zmq.Socket[bytes]) -> list[bytes]:
    """Last message of each topic that has come, in the order of their coming; waits for one, a second at most."""
    messages: dict[bytes, bytes] = {}
    while socket.poll(0 if messages else 1000):
        message = socket.recv()
        messages.pop(message[:64], None)
        messages[message[:64]] = message
    return list(messages.values())


def split(message: bytes) -> tuple[Header, bytes]:
    """Header and payload."""
    header = Header._make(HEADER.unpack_from(message, 64))
    if header.major != 1:
        raise RuntimeError(f"This client speaks version 1 of the protocol, and the service version {header.major}.")
    if len(message) < 128 + header.length:
        raise ValueError("The message is cut short.")
    return header, message[128 : 128 + header.length]


def read_scene(payload: bytes) -> Scene:
    """Description of a scene, and its arrays by their names."""
    (length,) = struct.unpack_from("<I", payload)
    scene: Scene = json.loads(payload[4 : 4 + length])
    for name in "positions", "normals", "ladder", "slopes":
        shape, offset = scene["arrays"][name]["shape"], scene["arrays"][name]["offset"]
        scene[name] = np.frombuffer(payload, "<f4", int(np.prod(shape)), 4 + length + offset).reshape(shape)
    return scene


def pose(scene: Scene, header: Header, payload: bytes) -> Floats:
    """Positions and normals of a frame."""
    values = np.frombuffer(payload, "<f4")
    if header.kind == KINDS["controls"]:
        return deform(scene, values.reshape(scene["fields"], scene["isolines"], 3, 4))
    if header.kind == KINDS["vertices"]:
        return values.reshape(2, scene["vertices"], 3)
    positions, normals = [scene["positions"], scene["normals"]] + np.tensordot(values[1:], scene["targets"], 1)
    return np.stack([positions + header[-3:], unit(normals)])


def deform(scene: Scene, T: Floats) -> Floats:
    """Positions and normals that the transforms of the isolines make."""
    rest, ladder, weights = scene["normals"], scene["ladder"], np.array(scene["weights"])
    k = np.minimum(np.floor(ladder), scene["isolines"] - 2).astype(int)
    fields = np.arange(scene["fields"])
    D = T[fields, k + 1] - T[fields, k]
    B = np.einsum("f,vfij->vij", weights, T[fields, k] + (ladder - k)[..., None, None] * D)
    x = np.pad(scene["positions"], [(0, 0), (0, 1)], constant_values=1)[..., None]
    a = unit(np.cross(np.eye(3)[np.argmin(np.abs(rest), axis=1)], rest))
    tangents = np.stack([a, np.cross(rest, a)], axis=2)
    bent = B[..., :3] @ tangents + np.einsum("f,vfi,vfs->vis", weights, (D @ x[:, None])[..., 0], scene["slopes"])
    return np.stack([(B @ x)[..., 0], unit(np.cross(bent[..., 0], bent[..., 1]))])


def unit(vectors: Floats) -> Floats:
    """Vectors of length 1; zero stays zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


def read_targets(path: Path, scene: Scene) -> Floats:
    """How the targets of the file move positions and normals of the scene: K × 2 × n × 3."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    gltf = json.loads(data[20 : 20 + length])
    targets = np.zeros((len(scene["morphs"]), 2, scene["vertices"], 3), np.float32)
    parts = iter(scene["parts"])

    def read(index: int) -> Floats:
        accessor = gltf["accessors"][index]
        view = gltf["bufferViews"][accessor["bufferView"]]
        start = 28 + length + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        return np.frombuffer(data, "<f4", 3 * accessor["count"], start).reshape(-1, 3)

    def placed(index: int, above: Floats) -> Iterator[tuple[int, Floats]]:
        node = gltf["nodes"][index]
        *axis, w = node.get("rotation", (0, 0, 0, 1))
        cross = np.cross(np.eye(3), axis)
        linear = (np.eye(3) + 2 * (w * cross + cross @ cross)) * node.get("scale", (1, 1, 1))
        linear = above @ (np.reshape(node["matrix"], (4, 4)).T[:3, :3] if "matrix" in node else linear)
        yield index, linear
        for child in node.get("children", []):
            yield from placed(child, linear)

    roots = gltf["scenes"][gltf.get("scene", 0)]["nodes"]
    nodes = dict(item for root in roots for item in placed(root, np.eye(3)))
    for index in sorted(index for index in nodes if "mesh" in gltf["nodes"][index]):
        linear = nodes[index]
        for primitive in gltf["meshes"][gltf["nodes"][index]["mesh"]]["primitives"]:
            first, count = next(parts)["vertices"]
            part = slice(first, first + count)
            stretch = np.linalg.norm(scene["normals"][part] @ linear, axis=1, keepdims=True)
            for target, moves in zip(primitive["targets"][-len(targets) :], targets, strict=True):
                moves[0, part] = read(target["POSITION"]) @ linear.T
                moves[1, part] = read(target["NORMAL"]) @ np.linalg.inv(linear) * stretch
    return targets


def main() -> None:
    """Say once a second what came."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("character")
    parser.add_argument("mode", choices=["controls", "morphs", "vertices"])
    parser.add_argument("--address", default="tcp://127.0.0.1:7400")
    parser.add_argument("--token")
    parser.add_argument("--baked", type=Path, help="The .glb that has the targets, for the mode morphs.")
    options = parser.parse_args()
    said, frames = time.monotonic(), 0
    for header, positions, _ in follow(options.address, options.character, options.mode, options.token, options.baked):
        frames += 1
        if (passed := time.monotonic() - said) >= 1:
            box = f"{positions.min(axis=0).round(3)} to {positions.max(axis=0).round(3)}"
            line = f"frame {header.sequence}, {STATES[header.state]}, {frames / passed:.0f} frames/s, {box}\n"
            sys.stdout.write(line)
            said, frames = time.monotonic(), 0


if __name__ == "__main__":
    main()
