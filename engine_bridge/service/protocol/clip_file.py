"""Clip files: motion that an engine plays without a service (docs/clips.md).

A clip file is the messages that a client of the live stream receives, one after another: a description (kind
`Kind.CLIP`), the scene, and the controls of each frame. Clients that decode the stream can therefore read it.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from engine_bridge.performance.pose import Pose
from engine_bridge.service.protocol.header import Header, Kind, WireError, join, split, topic, write_json
from engine_bridge.service.protocol.payloads import Received, decode
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.states import STATES


@dataclass(frozen=True)
class ClipFacts:
    """The description of a clip file.

    Attributes
    ----------
    character : str
    revision : int
        Revision of the scene.
    frames : int
    fps : float
        Frames per second.
    recording : str
        Name of the recording.
    """

    character: str
    revision: int
    frames: int
    fps: float
    recording: str


def beginning(character: StreamedCharacter, facts: ClipFacts) -> bytes:
    """Return the first two messages of a clip file: its description and the scene."""
    return b"".join(
        join(topic(character.name, kind), Header(kind=kind, length=len(payload), revision=character.revision), payload)
        for kind, payload in ((Kind.CLIP, write_json(asdict(facts))), (Kind.SCENE, character.scene))
    )


def frame_message(
    character: StreamedCharacter, number: int, time: float, pose: Pose, weights: NDArray[np.float32]
) -> bytes:
    """Return the message of a frame.

    Parameters
    ----------
    character : StreamedCharacter
    number : int
        0 for the first frame.
    time : float
        Seconds since the first frame.
    pose : Pose
    weights : (k,) float32
        Weights of the mesh's own morph targets, in the order of `Puppet.targets`.
    """
    x, y, z = map(float, pose.root)
    header = Header(
        kind=Kind.CONTROLS,
        length=pose.controls.nbytes,
        revision=character.revision,
        sequence=number,
        state=STATES.index("performing"),
        time=time,
        root=(x, y, z),
        targets=len(weights),
    )
    return join(topic(character.name, Kind.CONTROLS), header, pose.controls.data, weights.tobytes())


def read_clip(content: bytes | memoryview) -> Iterator[Received]:
    """Decode all messages of a clip file.

    Raises
    ------
    WireError
        Bytes that do not follow this protocol, an order of messages that is not that of a clip file, another number of
        frames than described, or frames of another scene. It is raised when the iteration arrives there.
    """
    view, number, frames, revision = memoryview(content), 0, -1, 0
    while len(view):
        end = split(view).header.message_length
        message = decode(view[:end])
        expected = (Kind.CLIP, Kind.SCENE)[number] if number < 2 else Kind.CONTROLS
        if message.header.kind != expected:
            raise WireError(f"message {number} of kind {message.header.kind}, and a clip file has {expected} there")
        if number == 0:
            frames, revision = _frames(message.body), message.header.revision
        if message.header.revision != revision:
            raise WireError(f"message {number} of the scene {message.header.revision}, and the clip's is {revision}")
        yield message
        view, number = view[end:], number + 1
    if number != frames + 2:
        raise WireError(f"{max(number - 2, 0)} frames, and {frames} are described")


def _frames(facts: object) -> int:
    frames = facts.get("frames") if isinstance(facts, dict) else None
    if type(frames) is not int or frames < 1:
        raise WireError("a description without a number of frames")
    return frames
