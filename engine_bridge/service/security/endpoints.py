"""The addresses that the service listens at, and the credentials that each requires (docs/security.md).

A loopback address requires none. Any other address requires a token (PLAIN), which clients can send without libzmq, or
keys (CURVE), which also encrypt and which clients with libzmq support.
"""

import hmac
import ipaddress
import socket
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import zmq
from pydantic import Field, model_validator

from engine_bridge.service.security.credentials import read_public_keys, read_secret_key, read_token
from puppetline.errors import ServiceError
from puppetline.toml_schema import Table, mistake

Mechanism = Literal["NULL", "PLAIN", "CURVE"]
IPAddress = ipaddress.IPv4Address | ipaddress.IPv6Address

HANDSHAKE_SECONDS = 5.0
"""Maximum time that a client may take to authenticate, in seconds."""

DEAD_PEER_SECONDS = 6.0
"""Time after which a machine that does not answer counts as disconnected, in seconds."""

MAX_MESSAGE_BYTES = {b"stream": 1024, b"control": 131_072}
"""Maximum size of a client's message in bytes; a subscription takes 65, a handshake 600."""

Text = Annotated[str, Field(strict=True, min_length=1)]
Port = Annotated[int, Field(strict=True, ge=0, le=65534)]
"""Port of the stream; the control socket has the next one, and 0 chooses any two free ports."""


class CurveTable(Table):
    """[network.curve]: an address for clients whose public keys are in a folder."""

    port: Port
    key_file: Path
    clients_folder: Path
    host: Text | None = None


class NetworkSettings(Table):
    """[network]: where the service listens, and which clients may connect."""

    host: Text = "127.0.0.1"
    port: Port = 7400
    token_file: Path | None = None
    curve: CurveTable | None = None
    max_clients: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 64

    @model_validator(mode="after")
    def _ports_differ(self) -> Self:
        if self.curve is not None and self.port and self.curve.port and abs(self.curve.port - self.port) < 2:
            raise mistake(
                "curve",
                "port",
                found=f"{self.curve.port}, and [network] takes {self.port} and {self.port + 1}",
                expected="two ports of its own",
                fix=f"Choose {self.port + 2}.",
            )
        return self


@dataclass(frozen=True)
class Endpoint:
    """The addresses of the stream and of the control socket with one mechanism.

    Attributes
    ----------
    mechanism : {"NULL", "PLAIN", "CURVE"}
        No credentials, a token, or keys.
    stream, control : str
        Addresses to bind, such as ``tcp://127.0.0.1:7400``.
    token : bytes
        PLAIN's password.
    secret_key : bytes
        CURVE's key of the service, in Z85.
    clients : frozenset of bytes
        CURVE's public keys of the accepted clients, 32 bytes each.
    """

    mechanism: Mechanism
    stream: str
    control: str
    token: bytes = field(default=b"", repr=False)
    secret_key: bytes = field(default=b"", repr=False)
    clients: frozenset[bytes] = frozenset()

    def prepare(self, socket: "zmq.Socket[Any]") -> None:
        """Make an XPUB (stream) or ROUTER (control) socket require the credentials, before it is bound.

        From then on, it accepts only clients that an `engine_bridge.service.security.guard.Guard` accepts.
        """
        socket.ipv6 = "[" in self.stream
        keep_alive(socket)
        socket.handshake_ivl = round(HANDSHAKE_SECONDS * 1000)
        socket.zap_domain = b"control" if socket.type == zmq.ROUTER else b"stream"
        socket.maxmsgsize = MAX_MESSAGE_BYTES[socket.zap_domain]
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # without it, NULL accepts every client while there is no guard
        if self.mechanism == "PLAIN":
            socket.plain_server = True
        elif self.mechanism == "CURVE":
            socket.curve_server = True
            socket.curve_secretkey = self.secret_key

    def admits(self, credentials: Sequence[bytes]) -> bool:
        """Tell whether credentials are valid: none, a user name and a password, or a public key."""
        if self.mechanism == "NULL":
            return not credentials
        if self.mechanism == "PLAIN":
            return len(credentials) == 2 and hmac.compare_digest(credentials[1], self.token)
        return len(credentials) == 1 and credentials[0] in self.clients


def keep_alive(socket: "zmq.Socket[Any]") -> None:
    """Make the system detect within `DEAD_PEER_SECONDS` that the other side's machine has disappeared.

    ZeroMQ's own heartbeats are not used: libzmq 4.3.5 aborts the process if one becomes due on a connection that has
    just failed (stream_engine_base.cpp, ``!_io_error``), which a client can cause.
    """
    socket.tcp_keepalive = 1
    socket.tcp_keepalive_idle = socket.tcp_keepalive_intvl = socket.tcp_keepalive_cnt = 2
    socket.tcp_maxrt = round(DEAD_PEER_SECONDS * 1000)


def endpoints_of(network: NetworkSettings, folder: Path = Path()) -> list[Endpoint]:
    """Return the addresses to listen at, with their credentials read.

    Parameters
    ----------
    network : NetworkSettings
    folder : Path
        Folder that the files in the settings are relative to.

    Raises
    ------
    ServiceError
        Other machines could connect without credentials, or credentials are weak, missing or readable by others.
    """
    address = address_of(network.host, "[network], host")
    token = read_token(None if network.token_file is None else folder / network.token_file)
    endpoints = []
    if token is not None:
        endpoints.append(Endpoint("PLAIN", *_urls(address, network.port), token=token.encode()))
    elif address.is_loopback:
        endpoints.append(Endpoint("NULL", *_urls(address, network.port)))
    elif network.curve is None:
        raise ServiceError(
            "[network], host",
            found=f"{network.host!r}, which other machines can reach, and no credentials",
            expected="a token or CURVE keys if other machines can connect",
            fix='Make a token (puppetline token FILE) and set token_file, or use host = "127.0.0.1".',
        )
    if network.curve is not None:
        at = address if network.curve.host is None else address_of(network.curve.host, "[network.curve], host")
        endpoints.append(
            Endpoint(
                "CURVE",
                *_urls(at, network.curve.port),
                secret_key=read_secret_key(folder / network.curve.key_file),
                clients=read_public_keys(folder / network.curve.clients_folder),
            )
        )
    return endpoints


def address_of(host: str, where: str) -> IPAddress:
    """Return the one address of a host, so that the address that is checked is the one that is bound.

    Raises
    ------
    ServiceError
        The host, which is the setting `where`, has no IP address.
    """
    if host == "*":
        return ipaddress.IPv4Address("0.0.0.0")  # noqa: S104
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        return ipaddress.ip_address(min(found)[4][0])  # IPv4 first, because clients try that for localhost
    except (OSError, UnicodeError, ValueError) as error:
        raise ServiceError(
            where,
            found=f"{host!r}, which has no IP address",
            expected="an IP address of this machine, or a name that has one",
            fix='Use "127.0.0.1", or list the machine\'s addresses: ip address',
        ) from error


def _urls(address: IPAddress, port: int) -> tuple[str, str]:
    host = f"[{address}]" if address.version == 6 else str(address)
    return f"tcp://{host}:{port or '*'}", f"tcp://{host}:{port + 1 if port else '*'}"
