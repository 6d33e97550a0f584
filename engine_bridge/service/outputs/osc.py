"""The output over OSC: UDP datagrams for TouchDesigner, Unity, Max and other programs (docs/osc.md).

A target receives the newest frame when its time has come, and never more frames per second than it asks for.
"""

import math
import re
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Field, FiniteFloat

from capture.network.osc import bundle, encode
from capture.skeleton import JOINTS
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.rigging.humanoid import is_humanoid
from engine_bridge.rigging.joints import LIMB_JOINTS, MIDDLE_LIMBS
from engine_bridge.service.monitoring.status import OutputStatus
from engine_bridge.service.outputs import vmc
from engine_bridge.service.outputs.output import Opening, Output, OutputTable
from engine_bridge.service.protocol.frame import Frame
from engine_bridge.service.protocol.header import NO_USER
from engine_bridge.service.security.endpoints import Text
from puppetline import clock
from puppetline.errors import PuppetError, ServiceError, at
from puppetline.toml_schema import mistake
from solver.motion.limbs import TRUNK

Kind = Literal["controls", "morphs", "joints", "handles", "bones", "vertices", "performer", "channels", "vmc"]

KINDS = get_args(Kind)
"""All kinds of data that can be sent."""

CHUNK_VERTICES = 250
"""Number of vertices per datagram: 7.6 kB, because some systems send no more than 9 kB."""

PERFORMER_SECONDS = 1.0
"""Time after which an unchanged performer is sent again, in seconds, because datagrams get lost."""

EARLY_SHARE = 0.1
"""Share of the sending period by which a send may come early after a late one.

Without it, frames that arrive at exactly the rate would be lost.
"""

SEND_BUFFER_BYTES = 1 << 20

UNFIT = re.compile(r"[^!-~]|[#*,/?\[\]{}]")
"""A character that a part of an OSC address must not contain."""


class OscTable(OutputTable):
    """[[osc]]: a program that receives OSC over UDP.

    Attributes
    ----------
    port, host
        Its address.
    rate : float
        Maximum frames per second of each character: n more frames take at least n − `EARLY_SHARE` periods.
    send : tuple of Kind
        Kinds of data to send.
    characters : tuple of str
        Names; empty for all characters.
    """

    port: Annotated[int, Field(strict=True, ge=1, le=65535)]
    host: Text = "127.0.0.1"
    rate: Annotated[FiniteFloat, Field(strict=True, gt=0, le=1000)] = 30.0
    send: Annotated[tuple[Kind, ...], Field(min_length=1)] = ("morphs", "joints", "handles", "performer")
    characters: tuple[Text, ...] = ()

    def receives(self, name: str) -> bool:
        """Tell whether the frames of a character are sent."""
        return not self.characters or name in self.characters

    def check(self, place: tuple[str | int, ...], morphs: Mapping[str, bool]) -> None:
        """Refuse characters that do not exist, morph weights that no character has, and VMC of several characters."""
        for index, name in enumerate(self.characters):
            if name not in morphs:
                raise mistake(
                    *place,
                    "characters",
                    index,
                    found=f"no character {name!r}",
                    expected=f"one of {', '.join(morphs)}",
                    fix="Choose one of these, or omit characters to send all of them.",
                )
        receives = [name for name in morphs if self.receives(name)]
        if self.send == ("morphs",) and not any(morphs[name] for name in receives):
            raise mistake(
                *place,
                "send",
                found="morph weights, and no character that has morph targets",
                expected="a character with morphs = FILE.glb",
                fix="Make the file with puppetline bake, or send something else.",
            )
        if "vmc" in self.send and len(receives) > 1:
            raise mistake(
                *place,
                "characters",
                found=f"VMC of {len(receives)} characters ({', '.join(receives)})",
                expected="one character, because VMC has no names for several",
                fix="Choose one of them, and add an [[osc]] with another port for each of the others.",
            )

    def check_puppet(self, name: str, puppet: Puppet, path: Path) -> None:
        """Refuse a puppet without the limbs that VMC sends."""
        if "vmc" not in self.send or not self.receives(name) or is_humanoid(puppet):
            return
        limbs = ", ".join(limb.name for limb in puppet.limb)
        sided = ", ".join(name for name in LIMB_JOINTS if name not in MIDDLE_LIMBS)
        raise PuppetError(
            at(path, field="[[limb]]"),
            found=f"the limbs {limbs}" if limbs else "no limb",
            expected=f"a limb {TRUNK} and one or more of {sided}, to send VMC",
            fix='Name its limbs like this, as puppetline new does, or remove "vmc" from send.',
        )

    def open(self, opening: Opening) -> Output:  # noqa: ARG002
        """Open a socket for the target; see `OscOutput`."""
        return OscOutput(self)


@dataclass
class _Turn:
    """The newest frame of a character if it has not been sent, and when the next one may be sent."""

    frame: Frame | None = None
    earliest: float = -math.inf
    performer: tuple[str, int | None] | None = None
    performer_sent: float = -math.inf


class OscOutput(Output):
    """Sends frames to one target.

    Parameters
    ----------
    target : OscTable

    Raises
    ------
    ServiceError
        The host is unknown.
    """

    def __init__(self, target: OscTable) -> None:
        self._target = target
        self._began = clock.now()
        self._turns: dict[str, _Turn] = {}
        self._sent = self._bytes = self._skipped = self._failed = 0
        family, self._address = _resolved(target)  # once: sending to a name would look up its address each time
        self._socket = _socket(family)

    @property
    def statistics(self) -> OutputStatus:
        """Datagrams sent, frames replaced by newer ones, datagrams not sent."""
        target = f"{self._target.host}:{self._target.port}"
        return OutputStatus("osc", target, self._sent, self._bytes, self._skipped, self._failed)

    def offer(self, frame: Frame) -> None:
        """Hold a frame of a character that the target receives, in place of one that still waits."""
        name = frame.character.name
        if self._target.receives(name):
            turn = self._turns.setdefault(name, _Turn())
            self._skipped += turn.frame is not None
            turn.frame = frame

    def due(self) -> float:
        """Return when to call `send_due`, in seconds of `puppetline.clock`; infinity for never."""
        return min((turn.earliest for turn in self._turns.values() if turn.frame is not None), default=math.inf)

    def send_due(self) -> None:
        """Send each frame whose time has come."""
        now, period = clock.now(), 1 / self._target.rate
        for turn in self._turns.values():
            if turn.frame is not None and turn.earliest <= now:
                self._send(turn, turn.frame, now)
                turn.frame, turn.earliest = None, max(turn.earliest + period, now + (1 - EARLY_SHARE) * period)

    def _send(self, turn: _Turn, frame: Frame, now: float) -> None:
        performer = (frame.state, frame.user)
        for kind in self._target.send:
            if kind == "performer":
                if performer == turn.performer and now < turn.performer_sent + PERFORMER_SECONDS:
                    continue
                turn.performer, turn.performer_sent = performer, now
            if kind == "vmc":  # addresses and a clock of its own
                datagrams = vmc.datagrams(frame, now - self._began)
            else:
                datagrams = _DATAGRAMS[kind](f"/puppetline/{frame.character.name}", frame)
            for datagram in datagrams:
                try:
                    self._bytes += self._socket.sendto(datagram, self._address)
                    self._sent += 1
                except OSError:  # no receiver, no route, no room: the next frame is another try
                    self._failed += 1

    def close(self) -> None:
        """Close the socket; closing again does nothing."""
        self._socket.close()


def part_names(names: Sequence[str]) -> list[str]:
    """Return names for parts of addresses: characters that OSC forbids become _, and repeated names get numbers."""
    fit: list[str] = []
    for number, name in enumerate(names):
        own = UNFIT.sub("_", name)
        fit.append(f"{own}_{number}" if own in fit else own)
    return fit


def _morphs(base: str, frame: Frame) -> Iterator[bytes]:
    if frame.morphs is not None:
        yield encode(f"{base}/morphs", frame.morphs.weights)
        residual = encode(f"{base}/residual", frame.morphs.residual)
        yield bundle(residual, encode(f"{base}/root", frame.pose.root.astype(np.float32)))


def _joints(base: str, frame: Frame) -> Iterator[bytes]:
    if frame.seen is not None:
        values = np.column_stack([frame.seen.positions, frame.seen.confidence]).astype(np.float32)
        known = np.isfinite(values).all(axis=1)
        yield bundle(*(encode(f"{base}/joint/{JOINTS[j]}", values[j]) for j in np.flatnonzero(known)))


def _handles(base: str, frame: Frame) -> Iterator[bytes]:
    names = part_names([handle.name for handle in frame.character.prepared.puppet.handle])
    targets = frame.handles.astype(np.float32)
    if names:
        yield bundle(*(encode(f"{base}/handle/{name}", target) for name, target in zip(names, targets, strict=True)))


def _bones(base: str, frame: Frame) -> Iterator[bytes]:
    skeleton, pose = frame.character.skeleton, frame.bones
    if skeleton is None or pose is None:
        return
    names = part_names(skeleton.names)
    travelling = [name for name, travels in zip(names, skeleton.travelling, strict=True) if travels]
    turned = [encode(f"{base}/bone/{name}", turn) for name, turn in zip(names, pose.rotations, strict=True)]
    moved = [encode(f"{base}/bone_position/{name}", at) for name, at in zip(travelling, pose.translations, strict=True)]
    yield bundle(*turned, *moved)


def _vertices(base: str, frame: Frame) -> Iterator[bytes]:
    positions, normals = frame.vertices_and_normals
    chunks = math.ceil(len(positions) / CHUNK_VERTICES)
    number = frame.sequence % 2**31
    for chunk in range(chunks):
        own = slice(chunk * CHUNK_VERTICES, (chunk + 1) * CHUNK_VERTICES)
        both = np.concatenate([positions[own], normals[own]], axis=1)
        yield encode(f"{base}/vertices", number, chunk, chunks, own.start, both)


def _channels(base: str, frame: Frame) -> Iterator[bytes]:
    values = [encode(f"{base}/channel/{name}", value) for name, value in (frame.pose.channels or {}).items()]
    names = part_names(frame.character.prepared.puppet.targets)
    weights = zip(names, frame.targets_moved.tolist(), strict=True)
    values += [encode(f"{base}/target/{name}", weight) for name, weight in weights]
    if values:
        yield bundle(*values)


def _performer(base: str, frame: Frame) -> Iterator[bytes]:
    yield encode(f"{base}/performer", frame.state, NO_USER if frame.user is None else frame.user)


_DATAGRAMS: dict[str, Callable[[str, Frame], Iterator[bytes]]] = {
    "controls": lambda base, frame: iter([encode(f"{base}/controls", frame.pose.controls)]),
    "morphs": _morphs,
    "joints": _joints,
    "handles": _handles,
    "bones": _bones,
    "vertices": _vertices,
    "performer": _performer,
    "channels": _channels,
}


def _resolved(target: OscTable) -> tuple[int, Any]:
    """Return the family and the address of a target, IPv4 if it has both."""
    try:
        found = socket.getaddrinfo(target.host, target.port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise ServiceError(
            f"[[osc]], host {target.host!r}",
            found="an unknown name" if isinstance(error, socket.gaierror) else str(error),
            expected="an IP address, or the name of a machine",
            fix="Check its spelling, or use the IP address.",
        ) from error
    family, _, _, _, address = min(found, key=lambda each: each[0] != socket.AF_INET)
    return family, address


def _socket(family: int) -> socket.socket:
    made = socket.socket(family, socket.SOCK_DGRAM)
    made.setblocking(False)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
    return made
