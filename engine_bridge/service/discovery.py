"""The service announced by multicast DNS as ``_puppetline._tcp.local.``, so that an engine needs no address.

The TXT record holds ``version``, ``characters`` (their names with commas between them, as many as fit), ``control``
(the port of the control socket) and ``mechanism`` (``NULL``, ``PLAIN`` or ``CURVE``). What is found so is a hint from
the network and nothing more: who connects still checks who answers.
"""

import ipaddress
import logging
import socket
import threading
import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from importlib.metadata import version
from typing import TYPE_CHECKING

import psutil

if TYPE_CHECKING:
    from zeroconf import ServiceInfo, ServiceStateChange, Zeroconf

TYPE = "_puppetline._tcp.local."

MOST_FOUND = 100
"""Services looked at; more than one network has."""

RETRY = 30.0
"""Seconds until it is tried again where there is no network, and until it is noticed that there is another one."""

GOODBYE = 0.5
"""Seconds that the end waits for the network to hear of it."""

RESOLVE = 0.5
"""Seconds in all for addresses that did not come with the announcements."""

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
    """Announces the service, from a thread of its own. Where there is no network it says so once, and tries again.

    Parameters
    ----------
    host : str
        The address that the service listens at: one of this machine's, or ``"*"`` or ``"0.0.0.0"`` for all. What
        listens on loopback is announced on loopback only.
    port, control : int
        Of the stream and of the control socket.
    mechanism : {"NULL", "PLAIN", "CURVE"}
    characters : sequence of str
        Their names.
    """

    def __init__(self, host: str, port: int, control: int, mechanism: str, characters: Sequence[str]) -> None:
        self._host = host
        self._everywhere = host in ("*", "0.0.0.0", "::")  # noqa: S104 - it is compared, not bound
        self._port = port
        self._properties = {"version": version("puppetline"), "control": str(control), "mechanism": mechanism}
        self._name = f"Puppetline on {socket.gethostname().partition('.')[0]}"
        self._characters = tuple(characters)
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, name="announcement", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Take the announcement back. Closing again does nothing."""
        self._closed.set()
        self._thread.join(GOODBYE)

    def _run(self) -> None:
        warned = False
        while not self._closed.is_set():
            try:
                self._announce()
            except Exception as error:  # the stream goes on, whatever the network has against multicast
                if not warned:
                    log.warning("not announced in the network: %s", str(error) or type(error).__name__)
                    warned = True
                self._closed.wait(RETRY)

    def _announce(self) -> None:
        """Announce the service until the end, a failure, or a change of this machine's addresses."""
        from zeroconf import InterfaceChoice, Zeroconf  # it takes a while, for which nothing should wait

        addresses = _own_addresses() if self._everywhere else [self._host]
        with closing(Zeroconf(InterfaceChoice.All if self._everywhere else addresses)) as zeroconf:
            zeroconf.register_service(self._info(addresses), allow_name_change=True)
            while not self._closed.wait(RETRY):
                if self._everywhere and _own_addresses() != addresses:
                    return

    def _info(self, addresses: list[str]) -> "ServiceInfo":
        from zeroconf import ServiceInfo

        return ServiceInfo(
            TYPE,
            f"{_cut(self._name, _LABEL_LENGTH)}.{TYPE}",
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
        How long.
    addresses : sequence of str, optional
        This machine's addresses at which to look; all of them where none is given.

    Returns
    -------
    list of Found
        In the order of their names.

    Raises
    ------
    OSError
        There is no network at all.
    """
    from zeroconf import InterfaceChoice, ServiceBrowser, ServiceInfo, ServiceStateChange, Zeroconf

    names: set[str] = set()

    def heard(zeroconf: "Zeroconf", service_type: str, name: str, state_change: "ServiceStateChange") -> None:  # noqa: ARG001
        if state_change is ServiceStateChange.Removed:
            names.discard(name)
        elif len(names) < MOST_FOUND:
            names.add(name)

    with closing(Zeroconf(InterfaceChoice.All if addresses is None else list(addresses))) as zeroconf:
        browser = ServiceBrowser(zeroconf, TYPE, handlers=[heard])
        time.sleep(seconds)
        browser.cancel()
        infos = [ServiceInfo(TYPE, name) for name in sorted(names)]
        until = time.monotonic() + RESOLVE
        for info in infos:
            if not info.load_from_cache(zeroconf):
                info.request(zeroconf, 1000 * max(until - time.monotonic(), 0.0))
    return [_found(info) for info in infos if info.port]


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
    """Join names with commas, leaving out those for which a TXT record has no room."""
    joined = ""
    for name in names:
        longer = f"{joined},{name}" if joined else name
        if len(f"characters={longer}".encode()) > _TEXT_LENGTH:
            break
        joined = longer
    return joined


def _cut(text: str, length: int) -> str:
    return text.encode()[:length].decode(errors="ignore")


def _own_addresses() -> list[str]:
    """Return this machine's IPv4 addresses, loopback left out unless there is no other."""
    found = [
        address.address
        for interface in psutil.net_if_addrs().values()
        for address in interface
        if address.family == socket.AF_INET
    ]
    return [address for address in found if not ipaddress.ip_address(address).is_loopback] or ["127.0.0.1"]
