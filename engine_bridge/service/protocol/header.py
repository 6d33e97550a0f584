"""Wire protocol version 1: topic and header of every message (docs/protocol.md).

A message has one part: 64 bytes of topic, 64 bytes of header, the payload. All numbers are little-endian.
"""

import json
import re
import struct
from enum import IntEnum
from typing import Any, NamedTuple, NoReturn, Self

from typing_extensions import Buffer  # of collections.abc from Python 3.12

from engine_bridge.service.states import STATES

MAJOR, MINOR = 1, 0
"""Protocol version; clients refuse other major versions, and accept all minor ones."""

TOPIC_BYTES = 64

PAYLOAD_OFFSET = TOPIC_BYTES + 64
"""Position of the payload in a message, in bytes."""

NO_USER = -1
"""User number of a frame without a performer."""

NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
"""Pattern of a character's name."""


class WireError(ValueError):
    """Raised for bytes that are not a message of this protocol."""


class Kind(IntEnum):
    """The kind of a payload."""

    SCENE = 1
    CONTROLS = 2
    MORPHS = 3
    VERTICES = 4
    VERTICES16 = 5
    JOINTS = 6
    HANDLES = 7
    PERFORMER = 8
    STATUS = 9
    CHARACTERS = 10
    CLIP = 11
    BONES = 12
    CHANNELS = 13

    @property
    def word(self) -> str:
        """The last part of its topics."""
        return self.name.lower()


FRAME_KINDS = (
    *(Kind.CONTROLS, Kind.MORPHS, Kind.VERTICES, Kind.VERTICES16),
    *(Kind.JOINTS, Kind.HANDLES, Kind.BONES, Kind.CHANNELS),
)
"""Kinds sent for every frame; the others are sent when they change or are requested."""

WORDS = {kind.word: kind for kind in Kind if kind != Kind.CLIP}
"""Kinds of the stream by the last part of their topics; `Kind.CLIP` occurs in files only."""


class Header(NamedTuple):
    """The second 64 bytes of a message, in the order of the bytes.

    Attributes
    ----------
    major, minor : int
    kind : int
        A `Kind`, or a number added by a later minor version.
    state : int
        Index in `STATES`.
    user : int
        The performer, or `NO_USER`.
    revision : int
        Of the character's scene; 0 if the message concerns no character.
    length : int
        Bytes of the payload.
    sequence : int
        Increases by one with each frame of the character; 0 if the message is no frame.
    time : float
        Seconds, the source's clock.
    received, published : int
        Nanoseconds, the service's monotonic clock.
    root : (float, float, float)
        Translation of the whole character, mesh file's coordinates.
    targets : int
        Number of weights of the mesh's own morph targets, which follow the payload.
    """

    major: int = MAJOR
    minor: int = MINOR
    kind: int = 0
    state: int = 0
    user: int = NO_USER
    revision: int = 0
    length: int = 0
    sequence: int = 0
    time: float = 0.0
    received: int = 0
    published: int = 0
    root: tuple[float, float, float] = (0.0, 0.0, 0.0)
    targets: int = 0

    def pack(self) -> bytes:
        """Return the 64 bytes."""
        *before, root, targets = self
        return _LAYOUT.pack(*before, *root, targets)

    @property
    def message_length(self) -> int:
        """Length of the whole message in bytes."""
        return PAYLOAD_OFFSET + self.length + 4 * self.targets

    @classmethod
    def unpack(cls, content: bytes | memoryview) -> Self:
        """Read 64 bytes."""
        *before, x, y, z, targets = _LAYOUT.unpack(content)
        return cls._make([*before, (x, y, z), targets])


_LAYOUT = struct.Struct("<4BiIIQdQQ3fI")


class Message(NamedTuple):
    """The parts of a message, with its payload and the weights of morph targets as bytes."""

    topic: str
    header: Header
    payload: memoryview
    targets: memoryview


def topic(name: str, kind: Kind) -> bytes:
    """Return the topic field of a kind of message of a character, or of ``service``."""
    return topic_field(f"{name}/{kind.word}")


def topic_field(text: str) -> bytes:
    """Return a topic as the first 64 bytes of a message.

    Raises
    ------
    ValueError
        The topic is invalid or too long.
    """
    if not is_topic(text):
        raise ValueError(f"{text!r:.80} is no topic of 1 to {TOPIC_BYTES - 1} printable ASCII characters")
    return text.encode("ascii").ljust(TOPIC_BYTES, b"\0")


def is_topic(text: str) -> bool:
    """Tell whether a text is a topic: printable ASCII that fits in a topic field with a zero after it."""
    return 0 < len(text) < TOPIC_BYTES and text.isascii() and text.isprintable()


def subscription(text: str) -> bytes:
    """Return the subscription to exactly one topic, ended by a zero; without it, longer topics would match as well."""
    return topic_field(text)[: len(text) + 1]


def join(field: bytes, header: Header, *parts: Buffer) -> bytes:
    """Return a whole message; `parts` are the payload, arrays among them C-contiguous."""
    return b"".join((field, header.pack(), *parts))


def split(message: bytes | memoryview) -> Message:
    """Split a message into its parts.

    Raises
    ------
    WireError
        Too short, an invalid topic or state, another major version, or an incomplete payload.
    """
    view = memoryview(message)
    if len(view) < PAYLOAD_OFFSET:
        raise WireError(f"{len(view)} bytes, and a message has at least {PAYLOAD_OFFSET}")
    text, _, rest = bytes(view[:TOPIC_BYTES]).partition(b"\0")
    if rest.strip(b"\0") or not is_topic(text.decode("latin-1")):
        raise WireError("a topic field that holds no topic")
    header = Header.unpack(view[TOPIC_BYTES:PAYLOAD_OFFSET])
    if header.major != MAJOR:
        raise WireError(f"protocol version {header.major}.{header.minor}, and this is {MAJOR}.{MINOR}")
    if header.state >= len(STATES):
        raise WireError(f"state {header.state} of {len(STATES)}")
    if PAYLOAD_OFFSET + header.length > len(view):
        raise WireError(f"{len(view) - PAYLOAD_OFFSET} bytes of payload of {header.length} announced")
    end = PAYLOAD_OFFSET + header.length
    if header.message_length > len(view):
        raise WireError(f"{len(view) - end} bytes for {header.targets} weights of morph targets")
    weights = view[end : header.message_length]
    return Message(text.decode("ascii"), header, view[PAYLOAD_OFFSET:end], weights)


def write_json(value: Any) -> bytes:
    """Return a value as the payload of a JSON kind."""
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode()


def read_json(payload: bytes | memoryview) -> Any:
    """Read a payload of a JSON kind.

    Raises
    ------
    WireError
    """
    try:
        return json.loads(bytes(payload).decode(), parse_constant=_refuse)
    except (ValueError, RecursionError):
        raise WireError("a payload that is not JSON") from None


def _refuse(constant: str) -> NoReturn:
    raise ValueError(constant)
