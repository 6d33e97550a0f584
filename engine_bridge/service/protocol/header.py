"""Wire protocol version 1, the frame around every payload: docs/protocol.md.

A message is one part: 64 bytes of topic, 64 bytes of header, the payload. All numbers are little-endian.
"""

import json
import re
import struct
from enum import IntEnum
from typing import Any, NamedTuple, NoReturn, Self

from typing_extensions import Buffer  # of collections.abc from Python 3.12

MAJOR, MINOR = 1, 0
"""Clients refuse another major version, and take any minor one."""

TOPIC = 64
"""Bytes of the topic field."""

BEFORE_PAYLOAD = TOPIC + 64

NOBODY = -1

STATES = ("waiting", "calibrating", "performing", "leaving")
"""Nobody performs; the performer's rest pose is being taken; the performer moves the character; it eases to rest."""

NAME = re.compile(r"[A-Za-z0-9_-]{1,32}")
"""Of a character."""


class WireError(ValueError):
    """Bytes that are no message of this protocol."""


class Kind(IntEnum):
    """What a payload is."""

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

    @property
    def word(self) -> str:
        """The last part of its topics."""
        return self.name.lower()


FRAME_KINDS = (Kind.CONTROLS, Kind.MORPHS, Kind.VERTICES, Kind.VERTICES16, Kind.JOINTS, Kind.HANDLES)
"""What a frame is made into; all else is sent when it changes or is asked for."""

SERVICE_KINDS = (Kind.STATUS, Kind.CHARACTERS)
"""What is sent about the whole service, below ``service/``."""

WORDS = {kind.word: kind for kind in Kind}


class Header(NamedTuple):
    """The second 64 bytes of a message.

    Attributes
    ----------
    kind : int
        A `Kind`, or a number that a later minor version has added.
    length : int
        Bytes of the payload.
    revision : int
        Of the character's scene; 0 for what concerns no character.
    sequence : int
        One more with each frame of the character; 0 for what is no frame.
    state : int
        Index in `STATES`.
    user : int
        The performer, or `NOBODY`.
    time : float
        Seconds, the source's clock.
    received, published : int
        Nanoseconds, the service's monotonic clock.
    root : (float, float, float)
        Translation of the whole character, mesh file's coordinates.
    major, minor : int
    """

    kind: int
    length: int
    revision: int = 0
    sequence: int = 0
    state: int = 0
    user: int = NOBODY
    time: float = 0.0
    received: int = 0
    published: int = 0
    root: tuple[float, float, float] = (0.0, 0.0, 0.0)
    major: int = MAJOR
    minor: int = MINOR

    def pack(self) -> bytes:
        """Return the 64 bytes."""
        return _LAYOUT.pack(
            self.major,
            self.minor,
            self.kind,
            self.state,
            self.user,
            self.revision,
            self.length,
            self.sequence,
            self.time,
            self.received,
            self.published,
            *self.root,
        )

    @classmethod
    def unpack(cls, content: bytes | memoryview) -> Self:
        """Read 64 bytes."""
        major, minor, kind, state, user, revision, length, sequence, time, received, published, *root = _LAYOUT.unpack(
            content
        )
        return cls(kind, length, revision, sequence, state, user, time, received, published, tuple(root), major, minor)


_LAYOUT = struct.Struct("<4BiIIQdQQ3f4x")


class Message(NamedTuple):
    """A message taken apart, its payload not yet."""

    topic: str
    header: Header
    payload: memoryview


def topic(name: str, kind: Kind) -> bytes:
    """Return the topic field of a character's kind, or of ``service``'s."""
    return topic_field(f"{name}/{kind.word}")


def topic_field(text: str) -> bytes:
    """Return a topic as the 64 bytes that a message begins with.

    Raises
    ------
    ValueError
        No topic, or one too long.
    """
    if not is_topic(text):
        raise ValueError(f"{text!r:.80} is no topic of 1 to {TOPIC - 1} printable ASCII characters")
    return text.encode("ascii").ljust(TOPIC, b"\0")


def is_topic(text: str) -> bool:
    """Tell whether a text can stand in a topic field with a zero after it."""
    return 0 < len(text) < TOPIC and text.isascii() and text.isprintable()


def subscription(text: str) -> bytes:
    """Return what to subscribe to for exactly this topic; without the zero, longer ones would match as well."""
    return topic_field(text)[: len(text) + 1]


def join(field: bytes, header: Header, *parts: Buffer) -> bytes:
    """Put a message together; `parts` are the payload, arrays of them C-contiguous."""
    return b"".join((field, header.pack(), *parts))


def split(message: bytes | memoryview) -> Message:
    """Take a message apart.

    Raises
    ------
    WireError
        Too short, no topic, another major version, a state that there is not, a payload cut off.
    """
    view = memoryview(message)
    if len(view) < BEFORE_PAYLOAD:
        raise WireError(f"{len(view)} bytes, and a message has at least {BEFORE_PAYLOAD}")
    text, _, rest = bytes(view[:TOPIC]).partition(b"\0")
    if rest.strip(b"\0") or not is_topic(text.decode("latin-1")):
        raise WireError("a topic field that holds no topic")
    header = Header.unpack(view[TOPIC:BEFORE_PAYLOAD])
    if header.major != MAJOR:
        raise WireError(f"protocol version {header.major}.{header.minor}, and this is {MAJOR}.{MINOR}")
    if header.state >= len(STATES):
        raise WireError(f"state {header.state} of {len(STATES)}")
    if BEFORE_PAYLOAD + header.length > len(view):
        raise WireError(f"{len(view) - BEFORE_PAYLOAD} bytes of payload of {header.length} announced")
    payload = view[BEFORE_PAYLOAD : BEFORE_PAYLOAD + header.length]
    return Message(text.decode("ascii"), header, payload)


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
