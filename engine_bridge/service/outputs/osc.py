"""Frames out as OSC over UDP, for TouchDesigner, Unity, Max and whatever else reads it: docs/osc.md.

A target is sent the newest frame when its turn comes, and never more frames a second than it asked for.
"""

import math
import re
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from capture.network.osc import bundle, encode
from capture.skeleton import JOINTS
from engine_bridge.service.outputs import vmc
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.header import NOBODY
from puppetline.errors import ServiceError

KINDS = ("controls", "morphs", "joints", "handles", "vertices", "performer", "vmc")
"""What can be sent."""

CHUNK = 250
"""Vertices a datagram: 7.6 kB, for some systems send no more than 9."""

AGAIN = 1.0
"""Seconds after which the performer's state is sent again, for datagrams get lost."""

SLACK = 0.1
"""Of a period: a turn that was a little late does not put off the next one, or frames of just that rate get lost."""

SEND_BUFFER = 1 << 20
"""Bytes."""

UNFIT = re.compile(r"[^!-~]|[#*,/?\[\]{}]")
"""What the name of a part of an address must not contain."""


@dataclass(frozen=True)
class OscTarget:
    """Where to send, what, and how often.

    Attributes
    ----------
    host : str
    port : int
    rate : float
        Frames a second of each character: n more of them never take less than n − `SLACK` periods.
    kinds : tuple of str
        Some of `KINDS`.
    characters : tuple of str
        Names; all of them if empty.
    """

    host: str
    port: int
    rate: float = 30.0
    kinds: tuple[str, ...] = ("controls",)
    characters: tuple[str, ...] = ()


@dataclass
class _Turn:
    """A character at a target: the newest frame that has not been sent, and when the next one may be."""

    frame: Frame | None = None
    earliest: float = -math.inf
    performer: tuple[str, int | None] | None = None
    performer_sent: float = -math.inf


@dataclass
class _Line:
    """A target with its address, found once, and what has gone out."""

    target: OscTarget
    family: int
    address: Any
    turns: dict[str, _Turn] = field(default_factory=dict)
    sent: int = 0
    skipped: int = 0
    failed: int = 0


class OscOutput:
    """Sends frames to targets.

    Parameters
    ----------
    targets : sequence of OscTarget
    clock : callable
        Seconds that never go back.

    Raises
    ------
    ServiceError
        A host that is not known.
    """

    def __init__(self, targets: Sequence[OscTarget], clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._began = clock, clock()
        self._lines = [_Line(target, *_resolved(target)) for target in targets]
        self._sockets = {family: _socket(family) for family in {line.family for line in self._lines}}

    @property
    def statistics(self) -> list[dict[str, Any]]:
        """What has gone to each target so far: datagrams sent, frames overtaken by newer ones, datagrams not sent."""
        return [
            {
                "target": f"{line.target.host}:{line.target.port}",
                "sent": line.sent,
                "skipped": line.skipped,
                "failed": line.failed,
            }
            for line in self._lines
        ]

    def offer(self, frame: Frame) -> None:
        """Hold a frame for every target that wants its character, in place of one that is still waiting there."""
        name = frame.character.name
        for line in self._lines:
            if line.target.characters and name not in line.target.characters:
                continue
            turn = line.turns.setdefault(name, _Turn())
            line.skipped += turn.frame is not None
            turn.frame = frame

    def due(self) -> float:
        """Return when `send_due` wants to be called: seconds of the clock, infinity for never."""
        turns = (turn for line in self._lines for turn in line.turns.values() if turn.frame is not None)
        return min((turn.earliest for turn in turns), default=math.inf)

    def send_due(self) -> None:
        """Send every frame whose turn has come."""
        now = self._clock()
        for line in self._lines:
            for turn in line.turns.values():
                if turn.frame is not None and turn.earliest <= now:
                    self._send(line, turn, turn.frame, now)
                    period = 1 / line.target.rate
                    turn.frame, turn.earliest = None, max(turn.earliest + period, now + (1 - SLACK) * period)

    def _send(self, line: _Line, turn: _Turn, frame: Frame, now: float) -> None:
        performer = (frame.state, frame.user)
        for kind in line.target.kinds:
            if kind == "performer":
                if performer == turn.performer and now < turn.performer_sent + AGAIN:
                    continue
                turn.performer, turn.performer_sent = performer, now
            if kind == "vmc":  # addresses and a clock of its own
                datagrams = vmc.datagrams(frame, now - self._began)
            else:
                datagrams = _DATAGRAMS[kind](f"/puppetline/{frame.character.name}", frame)
            for datagram in datagrams:
                try:
                    self._sockets[line.family].sendto(datagram, line.address)
                    line.sent += 1
                except OSError:  # nobody there, no way there, no room: the next frame is another try
                    line.failed += 1

    def close(self) -> None:
        """Close the sockets; closing again does nothing."""
        for each in self._sockets.values():
            each.close()


def part_names(names: Sequence[str]) -> list[str]:
    """Return names as they stand in addresses: without what OSC forbids there, each another one."""
    fit: list[str] = []
    for number, name in enumerate(names):
        own = UNFIT.sub("_", name)
        fit.append(f"{own}_{number}" if own in fit else own)
    return fit


def _controls(base: str, frame: Frame) -> Iterator[bytes]:
    yield encode(f"{base}/controls", frame.controls)


def _morphs(base: str, frame: Frame) -> Iterator[bytes]:
    if frame.morphs is not None:
        yield encode(f"{base}/morphs", frame.morphs.weights)
        residual = encode(f"{base}/residual", frame.morphs.residual)
        yield bundle(residual, encode(f"{base}/root", frame.root.astype(np.float32)))


def _joints(base: str, frame: Frame) -> Iterator[bytes]:
    if frame.joints is not None and frame.confidence is not None:
        values = np.column_stack([frame.joints, frame.confidence]).astype(np.float32)
        known = np.isfinite(values).all(axis=1)
        yield bundle(*(encode(f"{base}/joint/{JOINTS[j]}", values[j]) for j in np.flatnonzero(known)))


def _handles(base: str, frame: Frame) -> Iterator[bytes]:
    names = part_names([handle.name for handle in frame.character.rig.puppet.handle])
    targets = frame.targets.astype(np.float32)
    if names:
        yield bundle(*(encode(f"{base}/handle/{name}", target) for name, target in zip(names, targets, strict=True)))


def _vertices(base: str, frame: Frame) -> Iterator[bytes]:
    positions, normals = frame.vertices_and_normals
    chunks = math.ceil(len(positions) / CHUNK)
    number = frame.sequence % 2**31
    for chunk in range(chunks):
        own = slice(chunk * CHUNK, (chunk + 1) * CHUNK)
        both = np.concatenate([positions[own], normals[own]], axis=1)
        yield encode(f"{base}/vertices", number, chunk, chunks, own.start, both)


def _performer(base: str, frame: Frame) -> Iterator[bytes]:
    yield encode(f"{base}/performer", frame.state, NOBODY if frame.user is None else frame.user)


_DATAGRAMS: dict[str, Callable[[str, Frame], Iterator[bytes]]] = {
    "controls": _controls,
    "morphs": _morphs,
    "joints": _joints,
    "handles": _handles,
    "vertices": _vertices,
    "performer": _performer,
}


def _resolved(target: OscTarget) -> tuple[int, Any]:
    """Return the family and the address of a target, IPv4 where it has both."""
    try:
        found = socket.getaddrinfo(target.host, target.port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise ServiceError(
            f"[[osc]], host {target.host!r}",
            found="a name that nobody knows" if isinstance(error, socket.gaierror) else str(error),
            expected="an IP address, or the name of a machine",
            fix="Check its spelling, or give the address in numbers.",
        ) from error
    family, _, _, _, address = min(found, key=lambda each: each[0] != socket.AF_INET)
    return family, address


def _socket(family: int) -> socket.socket:
    made = socket.socket(family, socket.SOCK_DGRAM)
    made.setblocking(False)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
    return made
