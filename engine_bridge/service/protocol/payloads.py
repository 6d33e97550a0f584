"""The payload of each kind of message: encoded from a frame, and decoded by clients."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engine_bridge.service.protocol import quantisation
from engine_bridge.service.protocol.header import (
    NO_USER,
    Header,
    Kind,
    WireError,
    join,
    read_json,
    split,
    topic,
    write_json,
)
from engine_bridge.service.protocol.scene import DecodedScene
from engine_bridge.service.states import STATES
from puppetline import clock

if TYPE_CHECKING:
    from engine_bridge.service.protocol.frame import Frame

Parts = tuple[bytes | memoryview, ...]


class Morphs(NamedTuple):
    """Weights of the morph targets, (K,) float32, and their distance from the pose: see `live_basis.Projection`."""

    weights: NDArray[np.float32]
    residual: float


class Vertices(NamedTuple):
    """Positions, mesh file's coordinates, and unit normals; (n, 3) float32."""

    positions: NDArray[np.float32]
    normals: NDArray[np.float32]


class Received(NamedTuple):
    """A decoded message.

    Attributes
    ----------
    topic : str
    header : Header
    body : DecodedScene, (m, 3, 4) float32, Morphs, Vertices, (20, 4), (h, 3) or (4j + 3t,) float32, dict, list or None
        For a scene, controls, morphs, vertices of either kind, joints, handles, bones, and JSON; None for a kind that a
        later minor version has added.
    targets : (k,) float32
        Weights of the mesh's own morph targets, in the order of the scene's ``targets``; empty if it is no frame.
    """

    topic: str
    header: Header
    body: Any
    targets: NDArray[np.float32]


def encode(kind: Kind, frame: "Frame", published: int) -> bytes | None:
    """Return a frame as a message.

    Parameters
    ----------
    kind : Kind
        One of `header.FRAME_KINDS`.
    frame : Frame
    published : int
        `puppetline.clock.now_ns`.

    Returns
    -------
    bytes or None
        None if the frame has nothing of that kind: no joints, no morph targets, no channels.
    """
    payload = _PARTS[kind](frame)
    if payload is None:
        return None
    length = sum(memoryview(part).nbytes for part in payload)
    return join(
        topic(frame.character.name, kind), header(kind, length, frame, published), *payload, frame.targets_moved.data
    )


def message(kind: Kind, frame: "Frame") -> bytes | None:
    """Return a frame as a message that is encoded once, however many wires send it; see `encode`."""
    if kind not in frame.messages:
        frame.messages[kind] = encode(kind, frame, clock.now_ns())
    return frame.messages[kind]


def header(kind: Kind, length: int, frame: "Frame", published: int) -> Header:
    """Return the header of a message that belongs to a frame."""
    x, y, z = frame.pose.root.tolist()
    return Header(
        kind=kind,
        length=length,
        revision=frame.character.revision,
        sequence=frame.sequence,
        state=STATES.index(frame.state),
        user=NO_USER if frame.user is None else frame.user,
        time=frame.time,
        received=frame.received,
        published=published,
        root=(x, y, z),
        targets=len(frame.targets_moved),
    )


def _morphs(frame: "Frame") -> Parts | None:
    if frame.morphs is None:
        return None
    residual = np.float32(frame.morphs.residual)
    return residual.tobytes(), np.ascontiguousarray(frame.morphs.weights, dtype="<f4").data


def _vertices16(frame: "Frame") -> Parts:
    box, places, folded = quantisation.quantised(*frame.vertices_and_normals)
    return box.data, places.data, bytes(-places.nbytes % 4), folded.data


def _joints(frame: "Frame") -> Parts | None:
    if frame.seen is None:
        return None
    return (np.column_stack([frame.seen.positions, frame.seen.confidence]).astype("<f4").data,)


def _bones(frame: "Frame") -> Parts | None:
    pose = frame.bones
    return None if pose is None else (pose.rotations.data, pose.translations.data)


def _channels(frame: "Frame") -> Parts | None:
    channels = frame.pose.channels
    return (write_json({name: round(value, 4) for name, value in channels.items()}),) if channels else None


_PARTS: dict[Kind, Callable[["Frame"], Parts | None]] = {
    Kind.CONTROLS: lambda frame: (frame.pose.controls.data,),
    Kind.MORPHS: _morphs,
    Kind.VERTICES: lambda frame: (frame.vertices_and_normals.data,),
    Kind.VERTICES16: _vertices16,
    Kind.JOINTS: _joints,
    Kind.BONES: _bones,
    Kind.CHANNELS: _channels,
    Kind.HANDLES: lambda frame: (np.ascontiguousarray(frame.handles, dtype="<f4").data,),
}


def decode(message: bytes | memoryview) -> Received:
    """Decode a whole message.

    Raises
    ------
    WireError
        A message that does not follow this protocol; reading it takes no more memory than it has bytes.
    """
    name, head, payload, weights = split(message)
    targets = np.frombuffer(weights, "<f4")
    kind = next((kind for kind in Kind if kind == head.kind), None)
    if kind is None:
        return Received(name, head, None, targets)
    if name.split("/")[1:2] != [kind.word]:
        raise WireError(f"{kind.word} under the topic {name}")
    return Received(name, head, _BODIES[kind](payload), targets)


def _floats(payload: memoryview, *shape: int) -> NDArray[np.float32]:
    """Read a payload that is all float32; the first length of the shape may be −1."""
    row = 4 * int(np.prod([length for length in shape if length > 0]))
    if len(payload) % row or (shape[0] > 0 and len(payload) != row):
        raise WireError(f"{len(payload)} bytes, which are not float32 of {shape}")
    return np.frombuffer(payload, dtype="<f4").reshape(shape)


def _read_morphs(payload: memoryview) -> Morphs:
    values = _floats(payload, -1)
    if not len(values):
        raise WireError("morphs without a residual")
    return Morphs(values[1:], float(values[0]))


def _read_vertices(payload: memoryview) -> Vertices:
    if len(payload) % 24:
        raise WireError(f"{len(payload)} bytes, which are not vertices of 24")
    return Vertices(*_floats(payload, -1, 3).reshape(2, -1, 3))


def _read_vertices16(payload: memoryview) -> Vertices:
    count = (len(payload) - 24) // 10
    places, padded = 6 * count, (6 * count + 3) // 4 * 4
    if count < 0 or len(payload) != 24 + padded + 4 * count:
        raise WireError(f"{len(payload)} bytes, which are not a box and vertices of 10")
    box = np.frombuffer(payload[:24], dtype="<f4").reshape(2, 3)
    if not np.isfinite(box).all():
        raise WireError("a box without bounds")
    return Vertices(
        quantisation.positions_of(box, np.frombuffer(payload[24 : 24 + places], dtype="<u2").reshape(-1, 3)),
        quantisation.normals_of(np.frombuffer(payload[24 + padded :], dtype="<i2").reshape(-1, 2)),
    )


_BODIES: dict[Kind, Callable[[memoryview], Any]] = {
    Kind.SCENE: DecodedScene.decode,
    Kind.CONTROLS: lambda payload: _floats(payload, -1, 3, 4),
    Kind.MORPHS: _read_morphs,
    Kind.VERTICES: _read_vertices,
    Kind.VERTICES16: _read_vertices16,
    Kind.JOINTS: lambda payload: _floats(payload, 20, 4),
    Kind.HANDLES: lambda payload: _floats(payload, -1, 3),
    Kind.BONES: lambda payload: _floats(payload, -1),
    Kind.PERFORMER: read_json,
    Kind.STATUS: read_json,
    Kind.CHARACTERS: read_json,
    Kind.CLIP: read_json,
    Kind.CHANNELS: read_json,
}
