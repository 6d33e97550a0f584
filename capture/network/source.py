"""Sources of skeletons from UDP datagrams: ``osc:`` and ``vmc:``."""

import errno
import ipaddress
import math
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from capture.events import TICK_SECONDS, Event, Lost, Tick
from capture.formats.layouts import synthesise_missing
from capture.network.address import ANY_SENDER, FIX, Address, parse
from capture.network.assembly import PART_TIMEOUT_SECONDS, CompleteFrame, FrameAssembly
from capture.network.channels import HeldChannels, read_channel
from capture.network.dialect import (
    AcceptedReading,
    ChannelValues,
    Dialect,
    FrameEnd,
    Part,
    PerformerLost,
    PerformerPose,
    Values,
)
from capture.network.frozen_joints import FrozenJoints
from capture.network.identities import Identities
from capture.network.kinect_sdk import KinectSDK
from capture.network.ni_mate import NIMate
from capture.network.nuitrack import Nuitrack
from capture.network.osc import BUNDLE, MAX_DATAGRAM_BYTES, Message, OscError, decode
from capture.network.osceleton import OSCeleton
from capture.network.refusals import Refusals
from capture.network.vmc import Vmc
from capture.skeleton import JOINTS, LOST, MAX_DISTANCE_METRES, OPPOSITE, SkeletonFrame, mirrored, swap_sides
from capture.source import Counts
from puppetline import clock
from puppetline.errors import SourceError

OSC_PORT, VMC_PORT = 7110, 39539
"""Default ports: the port to which OSCeleton sends, and the port of VMC receivers."""

MAX_PERFORMERS = 32
"""Maximum number of performers; the one with the oldest packet is removed for a new one."""
MAX_DATAGRAMS, MAX_MESSAGES = 256, 4096
"""Limits of one call of `receive`. The system keeps further datagrams until its buffer is full."""
RECEIVE_BUFFER_BYTES = 1 << 20
"""Size of the receive buffer that is requested from the system, which may provide less."""
MAX_WAITING_FRAMES = 256
"""Maximum number of frames of a performer that one call of `receive` returns: eight seconds at 30 per second."""
TIMESTAMP_NS = 35
"""Linux's option SO_TIMESTAMPNS of sockets, and the kind of the ancillary data that it adds to datagrams."""
TIMESPEC = struct.Struct("@ll")
"""What these data are: seconds and nanoseconds of the system's clock."""
MAX_ATTEMPTS = 10
"""Maximum number of attempts to read the date and the time without an interruption between them."""
LONGEST_MOMENT_SECONDS = 1e-4
"""Maximum duration of an attempt that was not interrupted, in seconds."""
MAX_AGE_NS = 10_000_000_000
"""Maximum plausible time that a datagram has waited; beyond, the system's clock was set meanwhile."""
USERS = range(-(2**31), 2**31)
"""Valid user numbers."""


@dataclass(frozen=True, slots=True)
class _Frame:
    """A complete frame whose positions are not computed yet."""

    time: float
    user: int
    dialect: Dialect
    parts: Mapping[str, Values]


_Pending = _Frame | Lost


def open_osc(rest: str) -> "OscSource":
    """Open the source ``osc:`` with this rest of the URI: ``7110``, ``HOST:PORT?units=mm&mirrored=1``, ….

    Raises
    ------
    SourceError
        The rest is invalid, the port is in use, or the host is not an address of this machine.
    """
    return OscSource(f"osc:{rest}", parse("osc", rest, OSC_PORT))


def open_vmc(rest: str) -> "OscSource":
    """Open the source ``vmc:``, which differs from `open_osc` in the default port only."""
    return OscSource(f"vmc:{rest}", parse("vmc", rest, VMC_PORT))


class OscSource:
    """A UDP port that receives OSC in all dialects; implements `capture.source.SkeletonSource`.

    Parameters
    ----------
    name : str
        The URI.
    address : Address

    Attributes
    ----------
    port : int
        The port in use, which the system chooses for port 0.

    Raises
    ------
    SourceError
        The port is in use, or the host is not an address of this machine.
    """

    recorded = False

    def __init__(self, name: str, address: Address) -> None:
        self.name = name
        self.counts = Counts()
        self._address = address
        self._flip = np.where([axis in address.flip for axis in "xyz"], -1.0, 1.0)
        self._dialects: tuple[Dialect, ...] = (OSCeleton(), Nuitrack(), KinectSDK(), Vmc(), NIMate())
        self._refusals = Refusals(name, self.counts.refused)
        self._channels = HeldChannels()
        self._assemblies: dict[tuple[Dialect, int], FrameAssembly] = {}  # in the order of the last packets
        self._pending: dict[tuple[type[_Pending], int], deque[_Pending]] = {}  # not returned yet
        self._frozen: dict[int, FrozenJoints] = {}
        self._identities = Identities()
        self._present: set[int] = set()  # performers of whom frames were returned
        self._last_time = self._last_return = clock.now()  # of the last pending event, and of the last return
        self._socket = _listen(name, address)
        self.port: int = self._socket.getsockname()[1]

    def fileno(self) -> int:
        """Return the socket's file descriptor."""
        return self._socket.fileno()

    def due(self) -> float:
        """Return the time of the next tick, or the earliest time at which an incomplete frame ends."""
        ends = [assembly.time + PART_TIMEOUT_SECONDS for assembly in self._assemblies.values() if assembly.parts]
        return min([self._last_return + TICK_SECONDS, *ends])

    def now(self) -> float:
        """Return the time on the clock of the events."""
        return clock.now()

    def receive(self) -> list[Event]:
        """Return the frames that have arrived, the performers who have left, or a tick if nothing happens.

        On Linux, a frame has the time at which its last datagram arrived at this machine, however late it is read;
        elsewhere, the time at which it is read. Packets that are not skeletons are refused and counted; they raise no
        error.
        """
        self._drain()
        now = self.now()
        for key, assembly in self._assemblies.items():
            if assembly.parts and now >= assembly.time + PART_TIMEOUT_SECONDS:  # as `due` says
                self._queue_frames(*key, assembly.end())
        pending = sorted((each for queue in self._pending.values() for each in queue), key=lambda each: each.time)
        events = [event for each in pending if (event := self._event(each))]
        self._pending.clear()
        if not events and now >= self._last_return + TICK_SECONDS:
            events.append(Tick(self._next_time(now)))
        if events:
            self._last_return = events[-1].time
        self._refusals.report(now)
        return events

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _drain(self) -> None:
        messages = 0
        for _ in range(MAX_DATAGRAMS):
            try:
                datagram, sender, arrival = _received(self._socket)
            except BlockingIOError:
                return
            except OSError:  # Windows reports ICMP messages so; the socket still works
                self._refusals.add("socket error")
                return
            self.counts.received += 1
            if self._address.sender not in (None, ANY_SENDER, sender[0].removeprefix("::ffff:")):
                self._refusals.add("another sender")
                continue
            messages += self._read_datagram(datagram, arrival)
            if messages >= MAX_MESSAGES:
                return

    def _read_datagram(self, datagram: bytes, now: float) -> int:
        """Process one datagram; return its number of messages."""
        try:
            messages = decode(datagram, lambda error: self._refusals.add(error.reason, error.address))
        except OscError as error:
            self._refusals.add(error.reason)
            return 1
        bundled = datagram.startswith(BUNDLE)
        ended: list[tuple[Dialect, int]] = []
        for message in messages:
            ended += self._read_message(message, now, bundled=bundled)
        for key in dict.fromkeys(ended):
            if key in self._assemblies:
                self._queue_frames(*key, self._assemblies[key].end())
        return len(messages)

    def _read_message(self, message: Message, now: float, *, bundled: bool) -> list[tuple[Dialect, int]]:
        """Process one message; return the performers whose frames end with the datagram."""
        channel = read_channel(message)
        if channel is not None:
            if isinstance(channel, ChannelValues):
                self._take_channels(channel, now)
            else:
                self._refusals.add(channel)
            return []
        for dialect in self._dialects:
            reading = dialect.read(message)
            if reading is not None:
                if isinstance(reading, Part | PerformerLost) and reading.user not in USERS:
                    reading = "wrong arguments"
                if isinstance(reading, str):
                    self._refusals.add(reading, message.address)
                    return []
                return self._apply(dialect, reading, now, bundled=bundled)
        self._refusals.add("unknown message")
        return []

    def _apply(
        self, dialect: Dialect, reading: AcceptedReading, now: float, *, bundled: bool
    ) -> list[tuple[Dialect, int]]:
        if isinstance(reading, Part):
            key = dialect, reading.user
            end_follows = bundled and dialect.bundle_is_frame
            self._queue_frames(*key, self._assembly(key).add(reading, now, end_follows=end_follows))
            return [key] if end_follows else []
        if isinstance(reading, FrameEnd):
            return [key for key in self._assemblies if key[0] is dialect]
        if isinstance(reading, PerformerLost):
            self._remove(reading.user, now)
        elif isinstance(reading, ChannelValues):
            self._take_channels(reading, now)
        return []

    def _take_channels(self, reading: ChannelValues, now: float) -> None:
        swapped = swap_sides if self._address.mirrored else str
        self._channels.add({swapped(name): value for name, value in reading.values.items()}, now)

    def _assembly(self, key: tuple[Dialect, int]) -> FrameAssembly:
        """Return the assembly of a performer's frames, now the last in the order of packets."""
        assembly = self._assemblies.pop(key, None) or FrameAssembly()
        self._assemblies[key] = assembly
        if len(self._assemblies) > MAX_PERFORMERS:
            self._remove(next(iter(self._assemblies))[1], self.now())
        return assembly

    def _remove(self, user: int, now: float) -> None:
        for key in [key for key in self._assemblies if key[1] == user]:
            del self._assemblies[key]
        self._queue(Lost(self._next_time(now), user), user)

    def _queue_frames(self, dialect: Dialect, user: int, frames: list[CompleteFrame]) -> None:
        for frame in frames:
            self._queue(_Frame(self._next_time(frame.time), user, dialect, frame.parts), user)

    def _queue(self, pending: _Pending, user: int) -> None:
        """Keep an event until `receive` returns it or too many newer ones of the same performer replace it."""
        waiting = self._pending.setdefault((type(pending), user), deque(maxlen=MAX_WAITING_FRAMES))
        self.counts.dropped += len(waiting) == MAX_WAITING_FRAMES and isinstance(pending, _Frame)
        waiting.append(pending)

    def _next_time(self, arrival: float) -> float:
        """Return the time of an event that arrived at `arrival`; times increase strictly."""
        self._last_time = max(arrival, math.nextafter(self._last_time, math.inf))
        return self._last_time

    def _event(self, pending: _Pending) -> Event | None:
        """Return the event to report; None for a lost performer who was never reported and for an invalid frame."""
        if isinstance(pending, Lost):
            user = self._identities.lost(pending.user)
            if user is None or user not in self._present:
                return None
            self._present.discard(user)
            self._frozen.pop(user, None)
            return replace(pending, user=user)
        with np.errstate(over="ignore", invalid="ignore"):
            pose = self._sensor_pose(pending.dialect, pending.parts)
            known = pose[1] > LOST
            near = bool((np.abs(pose[0][known]) <= MAX_DISTANCE_METRES).all())
        if not near:
            self._refusals.add("position too far away")
        if not (near and known.any()):
            return None
        user = self._identities.user(pending.user, pose, pending.time)
        if pending.dialect.sends_positions:
            confidence = self._frozen.setdefault(user, FrozenJoints()).lost(pose, pending.time)
            pose = np.where(confidence[:, None] > LOST, pose[0], np.nan), confidence
        positions, confidence = synthesise_missing(*pose)
        self._present.add(user)
        return SkeletonFrame(pending.time, user, positions, confidence, channels=self._channels.at(pending.time))

    def _sensor_pose(self, dialect: Dialect, parts: Mapping[str, Values]) -> PerformerPose:
        """Return the pose of a frame; joints that were not sent, or at exactly (0, 0, 0), are lost."""
        if dialect.sends_positions:
            parts = {name: values for name, values in parts.items() if any(values[:3])}
        if not parts:
            return np.full((len(JOINTS), 3), np.nan), np.full(len(JOINTS), LOST, np.float32)
        positions, confidence = dialect.pose(parts, self._address.units)
        positions *= self._flip
        if dialect.mirrors if self._address.mirrored is None else self._address.mirrored:
            positions, confidence = mirrored(positions), confidence[OPPOSITE]
        return positions, confidence


def _received(listener: socket.socket) -> tuple[bytes, Any, float]:
    """Return a datagram, its sender, and when it arrived at this machine, in seconds of `puppetline.clock`."""
    if sys.platform != "linux":
        return *listener.recvfrom(MAX_DATAGRAM_BYTES), clock.now()
    datagram, ancillary, _, sender = listener.recvmsg(MAX_DATAGRAM_BYTES, socket.CMSG_SPACE(TIMESPEC.size))
    real, now = _moment()
    age = 0
    for _, kind, data in ancillary:
        if kind == TIMESTAMP_NS:
            seconds, nanoseconds = TIMESPEC.unpack(data)
            age = real - 1_000_000_000 * seconds - nanoseconds
    return datagram, sender, now - age / 1e9 if 0 <= age <= MAX_AGE_NS else now


def _moment() -> tuple[int, float]:
    """Return the date in nanoseconds and the time of one moment: of the attempt that was interrupted least."""
    shortest, moment = math.inf, (0, 0.0)
    for _ in range(MAX_ATTEMPTS):
        before, date, after = clock.now(), time.time_ns(), clock.now()
        if after - before < shortest:
            shortest, moment = after - before, (date, after)
        if shortest < LONGEST_MOMENT_SECONDS:
            break
    return moment


def _listen(name: str, address: Address) -> socket.socket:
    """Open the socket for the exclusive use of its port."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError):
        raise _host_error(name, address.host) from None
    # For senders, "localhost" is an IPv4 address.
    family, kind, protocol, _, socket_address = min(found, key=lambda choice: choice[0] != socket.AF_INET)
    listener = socket.socket(family, kind, protocol)
    try:
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        if sys.platform == "linux":
            listener.setsockopt(socket.SOL_SOCKET, TIMESTAMP_NS, 1)
        listener.bind(socket_address)
    except OSError as error:
        listener.close()
        raise _listen_error(name, address, error) from error
    if address.sender is None and not ipaddress.ip_address(str(socket_address[0]).partition("%")[0]).is_loopback:
        listener.close()
        raise SourceError(
            name,
            found=f"{address.host!r}, which other machines can reach, without an allowed sender",
            expected="the sender's IP address, because OSC has no authentication",
            fix=f"Add ?from=ADDRESS to the URI, or ?from={ANY_SENDER} if a firewall protects the port.",
        )
    return listener


def _listen_error(name: str, address: Address, error: OSError) -> SourceError:
    if error.errno == errno.EADDRNOTAVAIL:
        return _host_error(name, address.host)
    if error.errno == errno.EADDRINUSE:
        return SourceError(
            name,
            found=f"another program that listens on UDP port {address.port}",
            expected="a free port",
            fix="Close that program, or choose another port here and in the sender.",
        )
    return SourceError(
        name,
        found=f"the UDP port {address.port}, which cannot be opened ({error.strerror})",
        expected="a port that this user may open, above 1023",
        fix=FIX,
    )


def _host_error(name: str, host: str) -> SourceError:
    return SourceError(
        name,
        found=f"{host!r}, which is not an address of this machine",
        expected="127.0.0.1 for senders on this machine, or 0.0.0.0 for senders on its networks",
        fix="Use 0.0.0.0 here, not the sender's address, and configure this machine's address in the sender.",
    )
