"""Credentials of the service and its clients: tokens, and CURVE keys in the files of `zmq.auth` and CZMQ."""

import errno
import os
import re
import secrets
import stat
import sys
import tempfile
from pathlib import Path

import zmq
import zmq.auth
from zmq.utils import z85

from puppetline.errors import OutputError, PuppetlineError, ServiceError
from puppetline.files import check_new, written_whole

TOKEN_VARIABLE = "PUPPETLINE_TOKEN"  # noqa: S105
TOKEN = re.compile(r"[!-~]{16,255}")
"""Pattern of a token: PLAIN carries up to 255 bytes, and fewer than 16 could be guessed."""

SECRET = ".key_secret"  # noqa: S105
PUBLIC = ".key"
MAX_FILE_BYTES = 4096

READABLE_BY_OTHERS = 0o077
WRITABLE_BY_OTHERS = 0o022


def read_token(path: Path | None) -> str | None:
    """Return the token of a file, else of the environment variable PUPPETLINE_TOKEN, or None without both.

    Raises
    ------
    ServiceError
        The file cannot be read, others can read it, or the token is invalid.
    """
    if path is not None:
        _check_file(path, "a token file", READABLE_BY_OTHERS)
        try:
            return check_token(path.read_text(encoding="utf-8", errors="replace").strip(), path)
        except OSError as error:
            raise _unreadable(path, "a token file", error) from error
    if TOKEN_VARIABLE in os.environ:
        return check_token(os.environ[TOKEN_VARIABLE], f"the environment variable {TOKEN_VARIABLE}")
    return None


def check_token(token: str, where: str | Path) -> str:
    """Return a token if it is valid.

    Raises
    ------
    ServiceError
        The token is invalid; the message does not show it.
    """
    if not TOKEN.fullmatch(token):
        raise ServiceError(
            where,
            found=f"a token of {len(token)} characters",
            expected="16 to 255 letters, digits and symbols of ASCII, without spaces",
            fix="Make a new one: puppetline token FILE",
        )
    return token


def make_token(path: Path) -> None:
    """Write a new token to a file that only its owner can read.

    Raises
    ------
    OutputError
        The file exists, or it cannot be written.
    """
    _check_new(path)
    with written_whole(path) as beside:
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "w") as file:
            file.write(secrets.token_hex(32) + "\n")  # no option takes a value that begins with a dash


def make_curve_keys(path: Path) -> None:
    """Write a new secret key to ``NAME.key_secret``, which only its owner can read, and its public key to ``NAME.key``.

    Raises
    ------
    OutputError
        The path has another ending, or one of the files exists or cannot be written.
    """
    if path.suffix != SECRET:
        raise OutputError(
            path, found=f"the ending {path.suffix!r}", expected=repr(SECRET), fix=f"Call it {path.stem}{SECRET}."
        )
    public = path.with_suffix(PUBLIC)
    _check_new(path)
    _check_new(public)
    with (
        written_whole(path) as new_secret,
        written_whole(public) as new_public,
        tempfile.TemporaryDirectory(dir=path.parent) as private,  # which others cannot enter
    ):
        made_public, made_secret = map(Path, zmq.auth.create_certificates(private, path.stem))
        made_secret.chmod(0o600)
        made_public.replace(new_public)
        made_secret.replace(new_secret)


def read_secret_key(path: Path) -> bytes:
    """Return the secret key of a file that only its owner can read, in Z85.

    Raises
    ------
    ServiceError
    """
    _, secret = _load(path, READABLE_BY_OTHERS)
    if secret is None:
        raise _no_key(path, "secret key")
    return _checked(path, secret, "secret")


def read_public_keys(folder: Path) -> frozenset[bytes]:
    """Return the keys of all files ``*.key`` in a folder that only its owner can change, 32 bytes each.

    Raises
    ------
    ServiceError
    """
    try:
        _check_mode(folder, folder.stat().st_mode, WRITABLE_BY_OTHERS)
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
    return frozenset(z85.decode(_checked(path, _load(path, WRITABLE_BY_OTHERS)[0], "public")) for path in paths)


def _load(path: Path, forbidden: int) -> tuple[bytes, bytes | None]:
    """Return the public and the secret key of a file."""
    _check_file(path, "a CURVE key file", forbidden)
    try:
        return zmq.auth.load_certificate(path)
    except ValueError as error:
        raise _no_key(path, "public key") from error
    except OSError as error:
        raise _unreadable(path, "a CURVE key file", error) from error


def _checked(path: Path, key: bytes, kind: str) -> bytes:
    try:
        zmq.curve_public(key)  # accepts any 32 bytes in correct Z85
    except zmq.ZMQError as error:
        raise _no_key(path, f"valid {kind} key") from error
    return key


def _no_key(path: Path, which: str) -> PuppetlineError:
    return ServiceError(
        path,
        found=f"no {which}",
        expected='a line such as public-key = "…" with 40 characters of Z85',
        fix="Make keys: puppetline keys NAME.key_secret",
    )


def _check_file(path: Path, what: str, forbidden: int) -> None:
    """Refuse a path that is not a small file, and a file that others may read or change."""
    try:
        if not path.is_file():  # reading a pipe would wait
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        found = path.stat()
    except OSError as error:
        raise _unreadable(path, what, error) from error
    _check_mode(path, found.st_mode, forbidden)
    if found.st_size > MAX_FILE_BYTES:
        raise ServiceError(path, found=f"{found.st_size} bytes", expected=what, fix="Check which file was given.")


def _check_mode(path: Path, mode: int, forbidden: int) -> None:
    if sys.platform != "win32" and mode & forbidden:
        verb, right = ("read", "go-rwx") if forbidden == READABLE_BY_OTHERS else ("change", "go-w")
        raise ServiceError(
            path,
            found=f"a mode ({stat.S_IMODE(mode):03o}) with which others on this machine may {verb} it",
            expected=f"a mode with which only you may {verb} it",
            fix=f"Type: chmod {right} {path}",
        )


def _unreadable(path: Path, what: str, error: OSError) -> PuppetlineError:
    return ServiceError(
        path, found=f"a path that cannot be read ({error.strerror})", expected=what, fix="Check the path and its owner."
    )


def _check_new(path: Path) -> None:
    expected = "a new file, because the old one's secret may be in use"
    check_new(path, "Choose another name, or delete the file first.", expected)
