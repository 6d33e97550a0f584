"""Announces the service by multicast DNS as ``_puppetline._tcp.local.``, so that an engine needs no address.

The TXT record has ``version``, ``characters`` (names separated by commas, as many as fit), ``control`` (the port of the
control socket) and ``mechanism`` (``NULL``, ``PLAIN`` or ``CURVE``). An announcement is a hint from the network: a
client still has to authenticate the service.
"""

import ipaddress
import logging
import socket
import threading
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING

import psutil

from engine_bridge.service.security.endpoints import Endpoint
from puppetline import clock

if TYPE_CHECKING:
    from zeroconf import ServiceInfo, ServiceStateChange, Zeroconf

TYPE = "_puppetline._tcp.local."

MAX_FOUND = 100
"""Maximum number of services that `find` returns."""

RETRY_SECONDS = 30.0
"""Time between two attempts without a network, and between two checks for changed addresses, in seconds."""

CLOSE_SECONDS = 0.5
"""Maximum time that closing waits for the withdrawal of the announcement, in seconds."""

RESOLVE_SECONDS = 0.5
"""Maximum time that `find` waits for addresses that did not arrive with the announcements, in seconds."""

_TEXT_LENGTH = 255  # of a string in a TXT record, key and = included, RFC 6763
_LABEL_LENGTH = 63  # of a part of a name, RFC 1035

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Found:
    """A service that announced itself.

    Attributes
    ----------
    name : str
    addresses : tuple of str
    port : int
        Of the stream.
    control : int or None
        Port of the control socket.
    mechanism : str
        ``"NULL"``, ``"PLAIN"``, ``"CURVE"``, or empty.
    characters : tuple of str
    version : str
    """

    name: str
    addresses: tuple[str, ...]
    port: int
    control: int | None
    mechanism: str
    characters: tuple[str, ...]
    version: str


class Announcement:
    """Announces the service, from a thread of its own. Without a network, it logs this once and retries.

    Parameters
    ----------
    host : str
        Address that the service listens at: one of this machine's, or ``"*"``, ``"0.0.0.0"`` or ``"::"`` for all of
        them. A service on loopback is announced on loopback only.
    port, control : int
        Of the stream and of the control socket.
    mechanism : {"NULL", "PLAIN", "CURVE"}
    characters : sequence of str
        Their names.
    """

    @classmethod
    def of_most_open(
        cls, streams: Sequence[str], controls: Sequence[str], endpoints: Sequence[Endpoint], characters: Sequence[str]
    ) -> "Announcement":
        """Announce an endpoint that other machines can reach, if there is one.

        Parameters
        ----------
        streams, controls : sequence of str
            Addresses at each endpoint.
        endpoints : sequence of Endpoint
        characters : sequence of str
        """
        places = [stream.removeprefix("tcp://").rpartition(":") for stream in streams]
        best = max(range(len(places)), key=lambda k: not ipaddress.ip_address(places[k][0].strip("[]")).is_loopback)
        host, _, port = places[best]
        control = controls[best].rpartition(":")[2]
        return cls(host.strip("[]"), int(port), int(control), endpoints[best].mechanism, characters)

    def __init__(self, host: str, port: int, control: int, mechanism: str, characters: Sequence[str]) -> None:
        self._host = host
        self._everywhere = host in ("*", "0.0.0.0", "::")  # noqa: S104 - it is compared, not bound
        self._port = port
        self._properties = {"version": version("puppetline"), "control": str(control), "mechanism": mechanism}
        self._name = f"Puppetline on {socket.gethostname().partition('.')[0]}"
        self._characters = tuple(characters)
        self._closed = False
        self._changed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="announcement", daemon=True)
        self._thread.start()

    def rename(self, characters: Sequence[str]) -> None:
        """Announce other characters, as after a reload."""
        self._characters = tuple(characters)
        self._changed.set()

    def close(self) -> None:
        """Withdraw the announcement. Closing again does nothing."""
        self._closed = True
        self._changed.set()
        self._thread.join(CLOSE_SECONDS)

    def _run(self) -> None:
        warned = False
        while not self._closed:
            self._changed.clear()
            try:
                self._announce()
            except Exception as error:  # without multicast, the stream continues
                if not warned:
                    log.warning("could not announce the service on the network: %s", str(error) or type(error).__name__)
                    warned = True
                clock.block(clock.now() + RETRY_SECONDS, self._changed.wait)

    def _announce(self) -> None:
        """Announce the service until the end, a failure, or a change of this machine's addresses."""
        from zeroconf import InterfaceChoice, Zeroconf  # importing it takes a while

        addresses = _own_addresses() if self._everywhere else [self._host]
        with closing(Zeroconf(InterfaceChoice.All if self._everywhere else addresses)) as zeroconf:
            info = self._info(addresses, f"{self._name.encode()[:_LABEL_LENGTH].decode(errors='ignore')}.{TYPE}")
            zeroconf.register_service(info, allow_name_change=True)
            while not self._closed:
                renamed = clock.block(clock.now() + RETRY_SECONDS, self._changed.wait)
                self._changed.clear()
                if renamed and not self._closed:
                    zeroconf.update_service(self._info(addresses, info.name))
                elif self._everywhere and _own_addresses() != addresses:
                    return

    def _info(self, addresses: list[str], name: str) -> "ServiceInfo":
        from zeroconf import ServiceInfo

        return ServiceInfo(
            TYPE,
            name,
            port=self._port,
            properties=self._properties | {"characters": _as_many_as_fit(self._characters)},
            server=f"{socket.gethostname().partition('.')[0]}.local.",
            parsed_addresses=addresses,
        )


def find(seconds: float, addresses: Sequence[str] | None = None) -> list[Found]:
    """Look for services.

    Parameters
    ----------
    seconds : float
        Duration of the search.
    addresses : sequence of str, optional
        This machine's addresses to search from; all of them by default.

    Returns
    -------
    list of Found
        Sorted by name. Services whose addresses did not arrive are left out.

    Raises
    ------
    OSError
        There is no network.
    """
    from zeroconf import InterfaceChoice, ServiceBrowser, ServiceInfo, ServiceStateChange, Zeroconf

    names: set[str] = set()

    def heard(zeroconf: "Zeroconf", service_type: str, name: str, state_change: "ServiceStateChange") -> None:  # noqa: ARG001
        if state_change is ServiceStateChange.Removed:
            names.discard(name)
        elif len(names) < MAX_FOUND:
            names.add(name)

    with closing(Zeroconf(InterfaceChoice.All if addresses is None else list(addresses))) as zeroconf:
        browser = ServiceBrowser(zeroconf, TYPE, handlers=[heard])
        clock.sleep_until(clock.now() + seconds)
        browser.cancel()
        infos = [ServiceInfo(TYPE, name) for name in sorted(names)]
        until = clock.now() + RESOLVE_SECONDS
        for info in infos:
            if not info.load_from_cache(zeroconf):
                info.request(zeroconf, 1000 * max(until - clock.now(), 0.0))
    return [found for found in map(_found, infos) if found.port and found.addresses]


def _found(info: "ServiceInfo") -> Found:
    texts = {key: value or "" for key, value in info.decoded_properties.items()}
    return Found(
        name=info.get_name(),
        addresses=tuple(info.parsed_scoped_addresses()),
        port=info.port or 0,
        control=_port(texts.get("control", "")),
        mechanism=texts.get("mechanism", ""),
        characters=tuple(name for name in texts.get("characters", "").split(",") if name),
        version=texts.get("version", ""),
    )


def _port(text: str) -> int | None:
    return int(text) if text.isascii() and text.isdecimal() and len(text) <= 5 and 0 < int(text) < 65536 else None


def _as_many_as_fit(names: Sequence[str]) -> str:
    """Join as many of the first names with commas as fit into a string of a TXT record."""
    joined = ""
    for name in names:
        longer = f"{joined},{name}" if joined else name
        if len(f"characters={longer}".encode()) > _TEXT_LENGTH:
            break
        joined = longer
    return joined


def _own_addresses() -> list[str]:
    """Return this machine's IPv4 addresses, without loopback unless there is no other."""
    found = [
        address.address
        for interface in psutil.net_if_addrs().values()
        for address in interface
        if address.family == socket.AF_INET
    ]
    return [address for address in found if not ipaddress.ip_address(address).is_loopback] or ["127.0.0.1"]
