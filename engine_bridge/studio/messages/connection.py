"""The beginning of a connection: tokens, the greeting, close codes, and requests about the connection itself."""

from enum import IntEnum
from typing import Literal

from engine_bridge.studio.messages.base import Request
from puppetline.toml_schema import Table


class CloseCode(IntEnum):
    """Why the server closes a WebSocket."""

    NOT_UNDERSTOOD = 4400
    """The first frame is not `Hello`, or many frames in a row are not understood."""
    REFUSED = 4401
    """The token is wrong, or a one-time token that was used before. Open the address that the terminal shows."""
    TOO_SLOW = 4408
    """More replies wait for this client than the server keeps. Connect again."""
    NO_SERVICE = 4503
    """Only on ``/stream``: the service is not running, or has ended. Connect again in a second."""


class ServerError(Table):
    """Why a request is refused: where, what was found, what was expected, and what to do."""

    where: str
    found: str
    expected: str
    fix: str


class Hello(Table):
    """First frame of ``/api`` and of ``/stream``: a token.

    ``/api`` accepts a one-time token (from the address, after ``#token=``), a session token, or the token of the
    file that the server was started with. ``/stream``, ``POST /uploads`` and ``GET /files/ID`` accept session tokens
    only; the last two as the header ``Authorization: Bearer TOKEN``.
    """

    token: str


class Greeting(Table):
    """Answer to `Hello`, under the key ``hello``: ``{"hello": {…}}``.

    Attributes
    ----------
    session : str
        Session token, to keep in sessionStorage. It stays valid until the server ends.
    version : str
        Version of Puppetline.
    joints : list of str
        Names of all joints, in the order of arrays of joints.
    parents : dict
        Each joint's parent in the performer's skeleton; the root is not in it.
    forms : list of str
        Values of `Export.form`.
    suffixes : dict
        Endings of file names by kind of upload, for the file chooser: ``{"character": [".glb", …], …}``. The kind of an
        upload is detected from its content.
    limits : dict
        ``upload_bytes``, ``uploads``: maximum size of an upload, and maximum number of uploads.
    joined : bool
        Whether the studio has joined a service that it did not start: its characters and source cannot be changed.
    """

    session: str
    version: str
    joints: list[str]
    parents: dict[str, str]
    forms: list[str]
    suffixes: dict[str, list[str]]
    limits: dict[str, int]
    joined: bool


class Ping(Request):
    """Test the connection. Result: ``"pong"``."""

    do: Literal["ping"]


class GetState(Request):
    """Request the state, for tests and programs that ignore events. Result: `State`."""

    do: Literal["state"]


class Invite(Request):
    """Make another one-time token, for a second browser. Result: ``{"address": "http://127.0.0.1:7480/#token=…"}``."""

    do: Literal["invite"]
