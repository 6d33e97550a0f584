"""Ways into the service, and what opens them: docs/security.md.

On a loopback address a door stands open. Anywhere else it has a lock: a token (PLAIN), which every small client can
send, or keys (CURVE), which also encrypt and which libzmq's clients know.
"""

import errno
import hmac
import ipaddress
import os
import re
import secrets
import socket
import stat
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import zmq
from pydantic import Field, model_validator
from zmq.utils import z85

from puppetline.errors import OutputError, PuppetlineError, ServiceError
from puppetline.files import written_whole
from puppetline.toml_schema import Table, mistake

Mechanism = Literal["NULL", "PLAIN", "CURVE"]
Address = ipaddress.IPv4Address | ipaddress.IPv6Address

HANDSHAKE = 5.0
"""Seconds that a client has to say who it is."""

SILENCE = 6.0
"""Seconds after which a machine that does not answer is gone."""

LARGEST = {b"stream": 1024, b"control": 131_072}
"""Bytes of what a client sends, above which it is cut off. A subscription takes 65, a handshake 600."""

TOKEN_VARIABLE = "PUPPETLINE_TOKEN"  # noqa: S105
TOKEN = re.compile(r"[!-~]{16,255}")
"""PLAIN carries up to 255 bytes; fewer than 16 might be guessed."""

SECRET = ".key_secret"  # noqa: S105
PUBLIC = ".key"
KEY = re.compile(r'^\s*(public|secret)-key\s*=\s*"([!-~]{40})"\s*$', re.MULTILINE)
LONGEST_FILE = 4096

Text = Annotated[str, Field(strict=True, min_length=1)]
Port = Annotated[int, Field(strict=True, ge=0, le=65534)]
"""The control socket has the next one; 0 for any two that are free."""


class CurveTable(Table):
    """[network.curve]: a door of its own for clients whose public keys lie in a folder."""

    port: Port
    key_file: Path
    clients_folder: Path
    host: Text | None = None


class NetworkSettings(Table):
    """[network]: where the service listens, and who may come in."""

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
class Door:
    """One way in: two sockets with one mechanism.

    Attributes
    ----------
    mechanism : {"NULL", "PLAIN", "CURVE"}
        Anybody, who knows the token, or who has one of the keys.
    stream, control : str
        Endpoints to bind.
    token : bytes
        PLAIN's password.
    secret_key : bytes
        CURVE's key of the service, in Z85.
    clients : frozenset of bytes
        CURVE's public keys of those who may come in, 32 bytes each.
    """

    mechanism: Mechanism
    stream: str
    control: str
    token: bytes = field(default=b"", repr=False)
    secret_key: bytes = field(default=b"", repr=False)
    clients: frozenset[bytes] = frozenset()

    def prepare(self, socket: "zmq.Socket[Any]") -> None:
        """Put the lock on an XPUB (stream) or ROUTER (control) socket that is not bound yet.

        From then on nobody comes in without a `engine_bridge.service.security.guard.Guard`.
        """
        socket.ipv6 = "[" in self.stream
        keep_alive(socket)
        socket.handshake_ivl = round(HANDSHAKE * 1000)
        socket.zap_domain = b"control" if socket.type == zmq.ROUTER else b"stream"
        socket.maxmsgsize = LARGEST[socket.zap_domain]
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)  # without it, NULL lets everybody in while there is no guard
        if self.mechanism == "PLAIN":
            socket.plain_server = True
        elif self.mechanism == "CURVE":
            socket.curve_server = True
            socket.curve_secretkey = self.secret_key

    def admits(self, credentials: Sequence[bytes]) -> bool:
        """Say whether this opens the door: nothing, a user name and a password, or a public key."""
        if self.mechanism == "NULL":
            return not credentials
        if self.mechanism == "PLAIN":
            return len(credentials) == 2 and hmac.compare_digest(credentials[1], self.token)
        return len(credentials) == 1 and credentials[0] in self.clients


def keep_alive(socket: "zmq.Socket[Any]") -> None:
    """Let the system find out within `SILENCE` that the other side's machine is gone.

    ZeroMQ's own heartbeats are of no use for that: libzmq 4.3.5 aborts the process if one falls due on a connection
    that has just failed (stream_engine_base.cpp, ``!_io_error``), which a client can bring about.
    """
    socket.tcp_keepalive = 1
    socket.tcp_keepalive_idle = socket.tcp_keepalive_intvl = socket.tcp_keepalive_cnt = 2
    socket.tcp_maxrt = round(SILENCE * 1000)


def doors(network: NetworkSettings, folder: Path = Path()) -> list[Door]:
    """Decide which doors there are, and fetch what locks them.

    Parameters
    ----------
    network : NetworkSettings
    folder : Path
        What the files it names are relative to.

    Raises
    ------
    ServiceError
        Others could come in without credentials; credentials that are too weak, that others can read, or that are not
        there.
    """
    address = _address(network.host)
    token = read_token(None if network.token_file is None else folder / network.token_file)
    opened = []
    if token is not None:
        opened.append(Door("PLAIN", *_endpoints(address, network.port), token=token.encode()))
    elif address.is_loopback:
        opened.append(Door("NULL", *_endpoints(address, network.port)))
    elif network.curve is None:
        raise ServiceError(
            "[network], host",
            found=f"{network.host!r}, which other machines can reach, and no credentials",
            expected="a token or CURVE keys wherever others can come in",
            fix='Make a token (puppetline token FILE) and set token_file, or keep to host = "127.0.0.1".',
        )
    if network.curve is not None:
        at = address if network.curve.host is None else _address(network.curve.host)
        opened.append(
            Door(
                "CURVE",
                *_endpoints(at, network.curve.port),
                secret_key=_secret_key(folder / network.curve.key_file),
                clients=_public_keys(folder / network.curve.clients_folder),
            )
        )
    return opened


def read_token(path: Path | None) -> str | None:
    """Return the token of a file, else of the environment variable PUPPETLINE_TOKEN; None where there is neither.

    Raises
    ------
    ServiceError
        A file that cannot be read or that others can read, or what is no token.
    """
    if path is not None:
        return check_token(_read(path, "a token file", 0o077).strip(), path)
    if TOKEN_VARIABLE in os.environ:
        return check_token(os.environ[TOKEN_VARIABLE], f"the environment variable {TOKEN_VARIABLE}")
    return None


def check_token(token: str, where: str | Path) -> str:
    """Return a token if it can be one.

    Raises
    ------
    ServiceError
        Which does not show it.
    """
    if not TOKEN.fullmatch(token):
        raise ServiceError(
            where,
            found=f"a token of {len(token)} characters",
            expected="16 to 255 letters, digits and signs of ASCII, without spaces",
            fix="Make a new one: puppetline token FILE",
        )
    return token


def make_token(path: Path) -> None:
    """Write a new token to a file that nobody else can read.

    Raises
    ------
    OutputError
        There is a file already, or it cannot be written.
    """
    _check_new(path)
    _write(path, secrets.token_urlsafe(32) + "\n", 0o600)


def make_curve_keys(path: Path) -> None:
    """Write a new secret key to ``NAME.key_secret``, which nobody else can read, and its public one to ``NAME.key``.

    The files are those of `zmq.auth` and CZMQ.

    Raises
    ------
    OutputError
        Another ending; one of the files exists already, or cannot be written.
    """
    if path.suffix != SECRET:
        raise OutputError(
            path, found=f"the ending {path.suffix!r}", expected=repr(SECRET), fix=f"Call it {path.stem}{SECRET}."
        )
    _check_new(path)
    _check_new(path.with_suffix(PUBLIC))
    public, secret = (key.decode() for key in zmq.curve_keypair())
    curve = f'metadata\ncurve\n    public-key = "{public}"\n'
    _write(path.with_suffix(PUBLIC), curve, 0o644)
    _write(path, f'{curve}    secret-key = "{secret}"\n', 0o600)


def _address(host: str) -> Address:
    """Return the one address that a host stands for, so that what is judged is what is bound."""
    if host == "*":
        return ipaddress.IPv4Address("0.0.0.0")  # noqa: S104
    try:
        found = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
        return ipaddress.ip_address(min(found)[4][0])  # IPv4 first, for that is where clients look for localhost
    except (OSError, UnicodeError, ValueError) as error:
        raise ServiceError(
            "[network], host",
            found=f"{host!r}, which is no address of this machine",
            expected="an IP address, or a name of one",
            fix='Use "127.0.0.1", or see the machine\'s addresses with: ip address',
        ) from error


def _endpoints(address: Address, port: int) -> tuple[str, str]:
    host = f"[{address}]" if address.version == 6 else str(address)
    return f"tcp://{host}:{port or '*'}", f"tcp://{host}:{port + 1 if port else '*'}"


def _secret_key(path: Path) -> bytes:
    keys = _keys(path, 0o077)
    if "secret" not in keys:
        raise _no_key(path, "secret")
    return keys["secret"]


def _public_keys(folder: Path) -> frozenset[bytes]:
    """Return the keys of all files ``*.key`` in a folder that nobody else can add to."""
    try:
        _check_mode(folder, folder.stat().st_mode, 0o022)
        paths = sorted(path for path in folder.iterdir() if path.suffix == PUBLIC)
    except OSError as error:
        raise _unreadable(folder, "a folder of clients' public keys", error) from error
    if not paths:
        raise ServiceError(
            folder,
            found=f"no file *{PUBLIC} in it",
            expected="a public key for each client",
            fix="Make a client's keys (puppetline keys NAME.key_secret) and put its NAME.key there.",
        )
    public = set()
    for path in paths:
        keys = _keys(path, 0o022)
        if "public" not in keys:
            raise _no_key(path, "public")
        public.add(z85.decode(keys["public"]))
    return frozenset(public)


def _keys(path: Path, forbidden: int) -> dict[str, bytes]:
    """Return the public and the secret key of a file, in Z85."""
    keys = {kind: key.encode() for kind, key in KEY.findall(_read(path, "a CURVE key file", forbidden))}
    for kind, key in keys.items():
        try:
            zmq.curve_public(key)  # which takes any 32 bytes, rightly written
        except zmq.ZMQError as error:
            raise _no_key(path, f"valid {kind}") from error
    return keys


def _no_key(path: Path, which: str) -> PuppetlineError:
    return ServiceError(
        path,
        found=f"no {which} key",
        expected='a line such as public-key = "…" with 40 characters of Z85',
        fix="Make keys: puppetline keys NAME.key_secret",
    )


def _read(path: Path, what: str, forbidden: int) -> str:
    """Read a small file that others have no hand in."""
    try:
        if not path.is_file():  # a pipe would be waited for
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        with path.open("rb") as file:
            _check_mode(path, os.fstat(file.fileno()).st_mode, forbidden)
            data = file.read(LONGEST_FILE + 1)
    except OSError as error:
        raise _unreadable(path, what, error) from error
    if len(data) > LONGEST_FILE:
        raise ServiceError(path, found="far too much in it", expected=what, fix="Check which file was given.")
    return data.decode(errors="replace")


def _check_mode(path: Path, mode: int, forbidden: int) -> None:
    if os.name == "posix" and mode & forbidden:
        verb, right = ("read", "go-rwx") if forbidden & 0o044 else ("change", "go-w")
        raise ServiceError(
            path,
            found=f"that others on this machine may {verb} it (mode {stat.S_IMODE(mode):03o})",
            expected="that only you may",
            fix=f"Type: chmod {right} {path}",
        )


def _unreadable(path: Path, what: str, error: OSError) -> PuppetlineError:
    return ServiceError(
        path, found=f"that it cannot be read ({error.strerror})", expected=what, fix="Check the path and who owns it."
    )


def _check_new(path: Path) -> None:
    if path.exists():
        raise OutputError(
            path,
            found="a file that is there already",
            expected="a new one, for somebody may be using the old one's secret",
            fix="Choose another name, or delete it first.",
        )


def _write(path: Path, text: str, mode: int) -> None:
    with written_whole(path) as beside:
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "w") as file:
            file.write(text)
