"""Security of the studio: addresses, tokens and the headers of pages (docs/security.md).

A page of another site can make a browser send requests to this machine. It cannot change the headers Host and Origin,
and does not know a token. Therefore every request must name an address at which the studio is served, and everything
but the page itself requires a token.
"""

import contextlib
import hashlib
import hmac
import logging
import secrets
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import urlsplit

from engine_bridge.service.security.endpoints import address_of
from engine_bridge.service.security.web_access import WebAccess
from puppetline.errors import PuppetlineError, ServiceError
from puppetline.files import written_whole

MAX_SESSIONS = 64
"""Maximum number of sessions; beyond it, the one that was used least recently ends."""

MAX_SPENT = 1024
"""Maximum number of spent one-time tokens that are remembered, so that their second use gets its own reason."""

log = logging.getLogger(__name__)


class Addresses:
    """The addresses at which the studio is served.

    Parameters
    ----------
    host : str
        Host that is bound.
    port : int
    origins : iterable of str
        Further addresses that lead to the studio, such as that of a proxy: ``https://studio.example``.

    Attributes
    ----------
    bound : str
        The one IP address to bind.
    is_loopback : bool
    access : WebAccess
        Accepts requests by their headers Host and Origin.
    first : str
        Beginning of the addresses that a user opens.

    Raises
    ------
    ServiceError
        The host has no IP address, or an origin is not the beginning of an address.
    """

    def __init__(self, host: str, port: int, origins: Sequence[str] = ()) -> None:
        address = address_of(host, "--host")
        self.bound, self.is_loopback = str(address), address.is_loopback
        self.access = WebAccess(address, host, [_origin(each) for each in origins])
        name = "localhost" if address.is_unspecified else f"[{address}]" if address.version == 6 else str(address)
        self.first = origins[0].rstrip("/") if origins else f"http://{name}:{port}"

    def link(self, token: str) -> str:
        """Return the address to open in a browser; the token is in its fragment, which browsers do not send."""
        return f"{self.first}/#token={token}"


class Tokens:
    """One-time tokens, and the session tokens that they are exchanged for. Only their hashes are kept.

    Parameters
    ----------
    fixed : str, optional
        A token that is valid any number of times, from a file.
    file : Path, optional
        Keeps the hashes of session tokens, so that windows continue after a restart unless `fixed` has changed. Without
        it, they end.
    """

    def __init__(self, fixed: str | None = None, file: Path | None = None) -> None:
        self._fixed = None if fixed is None else _hash(fixed)
        self._file = file
        self._unspent: OrderedDict[bytes, None] = OrderedDict()
        self._spent: OrderedDict[bytes, None] = OrderedDict()
        self._sessions = OrderedDict[bytes, None].fromkeys(self._stored())

    def invite(self) -> str:
        """Return a new one-time token; the oldest unused ones beyond `MAX_SESSIONS` become invalid."""
        token = secrets.token_urlsafe(32)
        _add(self._unspent, _hash(token), MAX_SESSIONS)
        return token

    def enter(self, token: str) -> str:
        """Return the session token for a one-time, fixed or session token.

        Raises
        ------
        ServiceError
            It is wrong, or a one-time token that was used before.
        """
        hashed = _hash(token)
        if hashed in self._sessions:
            self._sessions.move_to_end(hashed)
            return token
        if hashed in self._unspent:
            del self._unspent[hashed]
            _add(self._spent, hashed, MAX_SPENT)
        elif self._fixed is None or not hmac.compare_digest(hashed, self._fixed):
            raise _refused("a one-time token that was used before" if hashed in self._spent else "a wrong token")
        session = secrets.token_urlsafe(32)
        _add(self._sessions, _hash(session), MAX_SESSIONS)
        self._store()
        return session

    def _stored(self) -> list[bytes]:
        """Return the hashes in the file; none if there is no readable one, or if it is of another fixed token."""
        with contextlib.suppress(OSError, ValueError):
            if self._file is not None:
                fixed, *sessions = map(bytes.fromhex, self._file.read_text(encoding="ascii").split("\n"))
                return [each for each in sessions if each] if fixed == (self._fixed or b"") else []
        return []

    def _store(self) -> None:
        if self._file is None:
            return
        hashes = "".join(f"{each.hex()}\n" for each in (self._fixed or b"", *self._sessions))
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True)
            with written_whole(self._file) as beside:
                beside.touch(mode=0o600)
                beside.write_text(hashes, encoding="ascii")
        except (OSError, PuppetlineError) as error:
            log.warning("windows must be opened again after a restart: %s", error)

    def is_session(self, token: str) -> bool:
        """Tell whether a token is that of a session."""
        hashed = _hash(token)
        if hashed not in self._sessions:
            return False
        self._sessions.move_to_end(hashed)
        return True


def bearer(headers: Mapping[str, str]) -> str:
    """Return the token of the header Authorization, or an empty string."""
    scheme, _, token = headers.get("Authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


def page_headers(host: str) -> dict[str, str]:
    """Return the headers of every answer to a request whose header Host is `host`.

    The page may load only what this server sends. ``blob:`` is for textures that the page unpacks from a .glb and for
    films, and ``data:`` for images of a sensor. The WebSocket's address is written out, because not every browser
    includes it in 'self'.
    """
    policy = (
        "default-src 'self'",
        "img-src 'self' blob: data:",
        "media-src 'self' blob:",
        f"connect-src 'self' blob: ws://{host} wss://{host}",
        "object-src 'none'",
        "base-uri 'none'",
        "form-action 'self'",
        "frame-ancestors 'none'",
    )
    return {
        "Content-Security-Policy": "; ".join(policy),
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "X-Content-Type-Options": "nosniff",
        "Cache-Control": "no-store",
    }


def check_exposure(addresses: Addresses, token: str | None) -> None:
    """Refuse an address that other machines can reach if there is no token in a file.

    Raises
    ------
    ServiceError
    """
    if token is None and not addresses.is_loopback:
        raise ServiceError(
            "--host",
            found=f"{addresses.bound}, which other machines can reach, and no credentials",
            expected="a token if other machines can connect",
            fix="Make a token (puppetline token FILE) and give it with --token-file, or omit --host.",
        )


def _refused(found: str) -> ServiceError:
    return ServiceError(
        "the token",
        found=found,
        expected="the token of this server",
        fix="Open the address that the terminal shows, or make one in a window that is open (Another window).",
    )


def _origin(url: str) -> str:
    parts = urlsplit(url.rstrip("/").lower())
    if parts.scheme not in ("http", "https") or not parts.netloc or parts.path or parts.query:
        raise ServiceError(
            "--origin",
            found=repr(url),
            expected="the beginning of an address",
            fix="Write it like https://studio.example or http://192.168.1.5:7480.",
        )
    return f"{parts.scheme}://{parts.netloc}"


def _hash(token: str) -> bytes:
    return hashlib.sha256(token.encode("utf-8", "surrogatepass")).digest()


def _add(known: OrderedDict[bytes, None], key: bytes, maximum: int) -> None:
    known[key] = None
    while len(known) > maximum:
        known.popitem(last=False)
