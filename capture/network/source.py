"""Performers out of UDP datagrams: the sources ``osc:`` and ``vmc:``."""

import errno
import ipaddress
import math
import socket
import time
from dataclasses import dataclass

import numpy as np

from capture.events import TICK, Event, Lost, Tick
from capture.formats.layouts import synthesise_missing
from capture.network.address import ANYBODY, FIX, Address, parse
from capture.network.assembly import QUIET, Assembly, Whole
from capture.network.dialect import Dialect, FrameEnd, Gone, Nothing, Part, Pose, Reading
from capture.network.kinect_sdk import KinectSDK
from capture.network.ni_mate import NIMate
from capture.network.nuitrack import Nuitrack
from capture.network.osc import BUNDLE, MAX_DATAGRAM, Message, OscError, decode
from capture.network.osceleton import OSCeleton
from capture.network.refusals import Refusals
from capture.network.vmc import Vmc
from capture.skeleton import LOST, OPPOSITE, SkeletonFrame, mirrored
from capture.source import Counts
from puppetline.errors import SourceError

OSC_PORT, VMC_PORT = 7110, 39539
"""Where OSCeleton sends, and where receivers of VMC listen."""

MAX_USERS = 32
"""Performers at once; whoever was heard of the longest ago is forgotten for another one."""
MAX_DATAGRAMS, MAX_MESSAGES = 256, 4096
"""Taken at a time. What is still there is taken the next time, or dropped by the system when its buffer is full."""
FARTHEST = 1000.0
"""Metres from the origin beyond which a position is a fault of the sender."""
RECEIVE_BUFFER = 1 << 20
"""Bytes asked of the system, which may give less."""
USERS = range(-(2**31), 2**31)


@dataclass(frozen=True, slots=True)
class _Frame:
    """A frame that is whole and has no positions yet."""

    time: float
    user: int
    dialect: Dialect
    whole: Whole


_News = _Frame | Lost


def open_osc(rest: str) -> "OscSource":
    """Listen to any dialect of OSC, as ``osc:`` and this text say: ``7110``, ``HOST:PORT?units=mm&mirrored=1``, ….

    Raises
    ------
    SourceError
        The text cannot be read, the port is taken, or the host is none of this machine's.
    """
    return OscSource(f"osc:{rest}", parse("osc", rest, OSC_PORT))


def open_vmc(rest: str) -> "OscSource":
    """Do the same for ``vmc:`` and this text, with VMC's port where none is given.

    Raises
    ------
    SourceError
        As of `open_osc`.
    """
    return OscSource(f"vmc:{rest}", parse("vmc", rest, VMC_PORT))


class OscSource:
    """A port that OSC comes to, in all dialects at once; implements `capture.source.SkeletonSource`.

    Parameters
    ----------
    name : str
        The URI.
    address : Address

    Attributes
    ----------
    name : str
    counts : Counts
    port : int
        Where it listens: the system's choice for port 0.

    Raises
    ------
    SourceError
        The port is taken, or the host is none of this machine's.
    """

    recorded = False

    def __init__(self, name: str, address: Address) -> None:
        self.name = name
        self.counts = Counts()
        self._address = address
        self._flip = np.where([axis in address.flip for axis in "xyz"], -1.0, 1.0)
        self._dialects: tuple[Dialect, ...] = (OSCeleton(), Nuitrack(), KinectSDK(), Vmc(), NIMate())
        self._refusals = Refusals(name, self.counts.refused)
        self._assemblies: dict[tuple[Dialect, int], Assembly] = {}  # the one heard of last is last
        self._news: dict[tuple[type[_News], int], _News] = {}  # not taken yet, the newest last
        self._present: set[int] = set()  # performers of whom frames were given
        self._newest = self._given = time.monotonic()  # of the last news, and when something was given
        self._socket = _listen(name, address)
        self.port: int = self._socket.getsockname()[1]

    def fileno(self) -> int:
        """Return the socket's file descriptor."""
        return self._socket.fileno()

    def due(self) -> float:
        """Return when a tick is due, or a frame that lacks a joint has waited long enough for it."""
        waiting = [assembly.time + QUIET for assembly in self._assemblies.values() if assembly.parts]
        return min([self._given + TICK, *waiting])

    def now(self) -> float:
        """Return the time on the clock of the events."""
        return time.monotonic()

    def receive(self) -> list[Event]:
        """Return the latest frame of each performer that has come, who has gone, or a tick in silence.

        Never raises: what is no skeleton is refused and counted.
        """
        self._drain()
        now = self.now()
        for key, assembly in self._assemblies.items():
            if assembly.parts and now - assembly.time >= QUIET:
                self._hold(*key, assembly.end())
        events = [event for news in self._news.values() if (event := self._event(news))]
        self._news.clear()
        if not events and now - self._given >= TICK:
            events.append(Tick(self._moment(now)))
        if events:
            self._given = events[-1].time
        self._refusals.report(now)
        return events

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _drain(self) -> None:
        messages = 0
        for _ in range(MAX_DATAGRAMS):
            try:
                datagram, sender = self._socket.recvfrom(MAX_DATAGRAM)
            except BlockingIOError:
                return
            except OSError:  # such as an ICMP message that Windows hands over: the socket itself is well
                self._refusals.add("socket error")
                return
            self.counts.received += 1
            if self._address.sender not in (None, ANYBODY, sender[0].removeprefix("::ffff:")):
                self._refusals.add("another sender")
                continue
            messages += self._take(datagram)
            if messages >= MAX_MESSAGES:
                return

    def _take(self, datagram: bytes) -> int:
        """Take one datagram in; return how many messages were in it."""
        try:
            messages = decode(datagram)
        except OscError as error:
            self._refusals.add(error.reason)
            return 1
        now = self.now()
        bundled = datagram.startswith(BUNDLE)
        ending: list[tuple[Dialect, int]] = []
        for message in messages:
            ending += self._hear(message, now, bundled=bundled)
        for key in dict.fromkeys(ending):
            if key in self._assemblies:
                self._hold(*key, self._assemblies[key].end())
        return len(messages)

    def _hear(self, message: Message, now: float, *, bundled: bool) -> list[tuple[Dialect, int]]:
        """Take one message in; return the performers whose frames end with the datagram."""
        for dialect in self._dialects:
            reading = dialect.read(message)
            if reading is not None:
                return self._follow(dialect, reading, now, bundled=bundled)
        self._refusals.add("unknown message")
        return []

    def _follow(self, dialect: Dialect, reading: Reading, now: float, *, bundled: bool) -> list[tuple[Dialect, int]]:
        if isinstance(reading, Part | Gone) and reading.user not in USERS:
            reading = "wrong arguments"
        if isinstance(reading, Part):
            key = dialect, reading.user
            end_follows = bundled and dialect.bundle_is_frame
            self._hold(*key, self._assembly(key).add(reading, now, end_follows=end_follows))
            return [key] if end_follows else []
        if isinstance(reading, FrameEnd):
            return [key for key in self._assemblies if key[0] is dialect]
        if isinstance(reading, Gone):
            self._forget(reading.user, now)
        elif not isinstance(reading, Nothing):
            self._refusals.add(reading)
        return []

    def _assembly(self, key: tuple[Dialect, int]) -> Assembly:
        """Return what has come of a performer, which is now the one heard of last."""
        assembly = self._assemblies.pop(key, None) or Assembly()
        self._assemblies[key] = assembly
        if len(self._assemblies) > MAX_USERS:
            self._forget(next(iter(self._assemblies))[1], self.now())
        return assembly

    def _forget(self, user: int, now: float) -> None:
        for key in [key for key in self._assemblies if key[1] == user]:
            del self._assemblies[key]
        self._tell(Lost(self._moment(now), user), user)

    def _hold(self, dialect: Dialect, user: int, frames: list[Whole]) -> None:
        """Keep frames that are whole until they are taken: what is overtaken before costs no more than that."""
        for whole in frames:
            self._tell(_Frame(self._moment(whole.time), user, dialect, whole), user)

    def _tell(self, news: _News, user: int) -> None:
        key = type(news), user
        if self._news.pop(key, None) is not None and isinstance(news, _Frame):
            self.counts.dropped += 1
        self._news[key] = news

    def _moment(self, came: float) -> float:
        """Return a time for an event of what came then: time never stands still and never goes back."""
        self._newest = max(came, math.nextafter(self._newest, math.inf))
        return self._newest

    def _event(self, news: _News) -> Event | None:
        """Return what is told of news; None of a performer who never was there, and of a frame that cannot be."""
        if isinstance(news, Lost):
            if news.user not in self._present:
                return None
            self._present.discard(news.user)
            return news
        with np.errstate(over="ignore", invalid="ignore"):
            positions, confidence = self._in_sensor_frame(news.dialect, news.whole)
            known = confidence > LOST
            near = bool((np.abs(positions[known]) <= FARTHEST).all())
        if not near:
            self._refusals.add("position too far away")
        if not (near and known.any()):
            return None
        self._present.add(news.user)
        return SkeletonFrame(news.time, news.user, positions, confidence)

    def _in_sensor_frame(self, dialect: Dialect, whole: Whole) -> Pose:
        positions, confidence = dialect.pose(whole.parts, self._address.units)
        positions *= self._flip
        if dialect.mirrors if self._address.mirrored is None else self._address.mirrored:
            positions, confidence = mirrored(positions), confidence[OPPOSITE]
        return synthesise_missing(positions, confidence)


def _listen(name: str, address: Address) -> socket.socket:
    """Open the socket; nothing else may listen on the same port."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError):
        raise _no_such_host(name, address.host) from None
    # Senders that are told "localhost" mean IPv4.
    family, kind, protocol, _, place = min(found, key=lambda choice: choice[0] != socket.AF_INET)
    listener = socket.socket(family, kind, protocol)
    try:
        listener.setblocking(False)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        listener.bind(place)
    except OSError as error:
        listener.close()
        raise _cannot_listen(name, address, error) from error
    if address.sender is None and not ipaddress.ip_address(str(place[0]).partition("%")[0]).is_loopback:
        listener.close()
        raise SourceError(
            name,
            found=f"{address.host!r}, which other machines can reach, and nobody named who may send",
            expected="the sender's IP address, as OSC has no password",
            fix=f"Add ?from=ADDRESS to it, or ?from={ANYBODY} where a firewall decides.",
        )
    return listener


def _cannot_listen(name: str, address: Address, error: OSError) -> SourceError:
    if error.errno == errno.EADDRNOTAVAIL:
        return _no_such_host(name, address.host)
    if error.errno == errno.EADDRINUSE:
        return SourceError(
            name,
            found=f"another program that listens on UDP port {address.port}",
            expected="a free port",
            fix="End that program, or choose another port here and in the sender.",
        )
    return SourceError(
        name,
        found=f"UDP port {address.port}, which cannot be opened ({error.strerror})",
        expected="a port that this user may open, above 1023",
        fix=FIX,
    )


def _no_such_host(name: str, host: str) -> SourceError:
    return SourceError(
        name,
        found=f"{host!r}, which is no address of this machine",
        expected="one of its own, 127.0.0.1 for senders on it or 0.0.0.0 for those in its networks",
        fix="The sender's address does not belong here: tell the sender this machine's, and here 0.0.0.0.",
    )
