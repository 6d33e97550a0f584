"""Receives a character that `puppetline serve` streams (docs/protocol.md), and prints one line per second."""

import argparse
import json
import secrets
import struct
import sys
import time
from collections import namedtuple
from collections.abc import Iterator
from typing import Any

import numpy as np
import zmq
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Header = namedtuple("Header", "major minor kind state user revision length sequence time received published x y z")
LAYOUT = struct.Struct("<4Bi2IQd2Q3f4x")
STATES = "waiting", "calibrating", "performing", "leaving"


def follow(
    address: str, character: str, mode: str, token: str | None = None, targets: Floats | None = None
) -> Iterator[tuple[Header, Floats, Floats | None]]:
    """Yield header, positions and unit normals of the newest frames; morphs require `targets` and have no normals."""
    scene: dict[str, Any] | None = None
    own = f"{character}/scene/{secrets.token_hex(8)}\0"
    with zmq.Context() as context, context.socket(zmq.SUB) as socket:
        socket.tcp_keepalive, socket.tcp_keepalive_idle, socket.tcp_maxrt = 1, 2, 6000
        if token is not None:
            socket.plain_username, socket.plain_password = b"follow", token.encode()
        socket.connect(address)
        socket.subscribe(own)
        socket.subscribe(f"{character}/{mode}\0")
        asked = time.monotonic()
        while True:
            for message in newest(socket):
                try:
                    header = Header._make(LAYOUT.unpack_from(message, 64))
                    if header.major != 1:
                        raise RuntimeError(f"The service uses protocol version {header.major}, not 1.")
                    payload = message[128 : 128 + header.length]
                    if message.startswith(own.encode()):
                        scene, sequence = read_scene(payload) | {"targets": targets}, -1
                    elif scene is None or header.revision != scene["revision"] or header.sequence <= sequence:
                        scene = None
                    else:
                        yield header, *vertices(mode, scene, header[-3:], np.frombuffer(payload, "<f4"))
                        sequence = header.sequence
                except (struct.error, ValueError, TypeError, LookupError):
                    continue  # skip a damaged message
            if scene is None and time.monotonic() > asked + 1:
                asked = time.monotonic()
                socket.unsubscribe(own)
                socket.subscribe(own)


def newest(socket: zmq.Socket[bytes]) -> list[bytes]:
    """Return the last waiting message of each topic, oldest first; wait up to one second for a message."""
    messages: dict[bytes, bytes] = {}
    while socket.poll(0 if messages else 1000):
        message = socket.recv()
        messages.pop(message[:64], None)
        messages[message[:64]] = message
    return list(messages.values())


def read_scene(payload: bytes) -> dict[str, Any]:
    """Return the description of a scene, with its arrays by name."""
    start = 4 + int.from_bytes(payload[:4], "little")
    scene: dict[str, Any] = json.loads(payload[4:start])
    for name in "positions", "normals", "ladder", "slopes":
        shape, offset = scene["arrays"][name]["shape"], scene["arrays"][name]["offset"]
        scene[name] = np.frombuffer(payload, "<f4", int(np.prod(shape)), start + offset).reshape(shape)
    return scene


def vertices(mode: str, scene: dict[str, Any], root: tuple[float, ...], values: Floats) -> tuple[Floats, Floats | None]:
    """Return positions and normals, (n, 3) each, from the payload of a frame."""
    if mode == "vertices":
        positions, normals = values.reshape(2, scene["vertices"], 3)
        return positions, normals
    if mode == "morphs":
        return scene["positions"] + np.tensordot(values[1:], scene["targets"], 1) + root, None
    x, n, t, s, w = (np.asarray(scene[name]) for name in ("positions", "normals", "ladder", "slopes", "weights"))
    T, fields = values.reshape(len(w), -1, 3, 4), np.arange(len(w))
    k = np.minimum(t, scene["isolines"] - 2).astype(int)
    D = T[fields, k + 1] - T[fields, k]
    B = np.einsum("i,vixy->vxy", w, T[fields, k] + (t - k)[..., None, None] * D)
    x = np.pad(x, [(0, 0), (0, 1)], constant_values=1)[..., None]
    a = unit(np.cross(np.eye(3)[np.abs(n).argmin(axis=1)], n))
    along = B[..., :3] @ np.stack([a, np.cross(n, a)], axis=2)
    along += np.einsum("i,vix,via->vxa", w, (D @ x[:, None])[..., 0], s)
    return (B @ x)[..., 0], unit(np.cross(along[..., 0], along[..., 1]))


def unit(vectors: Floats) -> Floats:
    """Return vectors of length 1; a zero vector stays zero."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-30)


def main() -> None:
    """Print one line per second about the received frames."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("character")
    parser.add_argument("mode", choices=["controls", "vertices"])
    parser.add_argument("--address", default="tcp://127.0.0.1:7400")
    parser.add_argument("--token")
    printed, count = time.monotonic(), 0
    for header, positions, _ in follow(**vars(parser.parse_args())):
        count += 1
        if (passed := time.monotonic() - printed) >= 1:
            box = f"{positions.min(axis=0).round(3)} to {positions.max(axis=0).round(3)}"
            sys.stdout.write(f"frame {header.sequence}, {STATES[header.state]}, {count / passed:.0f} fps, {box}\n")
            printed, count = time.monotonic(), 0


if __name__ == "__main__":
    main()
