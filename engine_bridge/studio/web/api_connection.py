"""One page's connection to ``/api``: its requests, the replies, and pushed events."""

import asyncio
import contextlib
import json
import logging
from collections import deque
from collections.abc import Callable
from typing import Any, get_args

from aiohttp import WSMsgType, web

from capture.skeleton import JOINTS, PARENTS
from engine_bridge.character.character import CHARACTER_FILES
from engine_bridge.performance.settings import DEFAULT_TOLERANCES, PerformerFormat
from engine_bridge.service.control.requests import error_reply, ok_reply
from engine_bridge.service.monitoring.logs import OnceASecond
from engine_bridge.service.security.web_sockets import CLOSE_SECONDS, Heartbeat, first_text, refuse
from engine_bridge.studio.backend.backend import Backend
from engine_bridge.studio.long_work.media import SUFFIXES
from engine_bridge.studio.messages.base import MAX_REQUEST_BYTES
from engine_bridge.studio.messages.connection import CloseCode, Greeting
from engine_bridge.studio.messages.state import JobState, ProgressEvent
from engine_bridge.studio.project.workspace import MAX_UPLOAD_BYTES, MAX_UPLOADS
from engine_bridge.studio.web.page_access import Tokens
from puppetline import __version__
from puppetline.errors import PuppetlineError, ServiceError

MAX_REASON_BYTES = 123
"""Maximum length of the reason with which a WebSocket is closed (RFC 6455, 5.5)."""

HELLO_SECONDS = 10.0
"""Maximum time until a page sends its first frame, in seconds."""

STATE_SECONDS, PROGRESS_SECONDS = 0.1, 0.5
"""Minimum time between two states, and between two reports of progress, that are pushed to a client, in seconds. A page
draws everything again for each; without a graphics card, that takes long enough to delay the work."""

MAX_PENDING = 32
"""Maximum number of requests of a client that are carried out at a time."""

MAX_REPLIES = 256
"""Maximum number of replies that wait for a client."""

MAX_MISTAKES = 100
"""Number of frames in a row that are not requests after which a client is disconnected."""

HEARTBEAT_SECONDS = 20.0
"""Interval of pings, in seconds; a client that does not answer is disconnected."""

LOG_SUFFIXES = ".log", ".bvh", ".csv", ".json", ".mat", ".skeleton", ".txt"
"""Usual endings of recordings, for the page's file chooser; the format is detected by content."""

FAILED = ServiceError(
    "the studio",
    found="an internal error",
    expected="a result",
    fix="Read the log of the studio, and report the error.",
)

log = logging.getLogger(__name__)
_rarely = OnceASecond(log)


class ApiClient:
    """A page that is connected.

    Parameters
    ----------
    studio : Backend
    tokens : Tokens
    entered : callable
        Called when a one-time token was used.
    """

    def __init__(self, studio: Backend, tokens: Tokens, entered: Callable[[], None]) -> None:
        self._studio, self._tokens, self._entered = studio, tokens, entered
        self._replies: deque[str] = deque()
        self._progress: dict[str, JobState] = {}
        self._stale = True
        self._wake = asyncio.Event()
        self._requests: set[asyncio.Task[None]] = set()
        self._socket = web.WebSocketResponse(
            timeout=CLOSE_SECONDS, autoping=False, max_msg_size=MAX_REQUEST_BYTES, compress=False
        )

    async def run(self, request: web.Request, handshakes: asyncio.Semaphore) -> web.WebSocketResponse:
        """Serve the page until it disconnects."""
        socket = self._socket
        async with handshakes:
            await socket.prepare(request)
            token = token_of(await first_text(socket, HELLO_SECONDS))
        session = await self._greet(request, token)
        if session is None:
            return socket
        await socket.send_str(json.dumps({"hello": _greeting(session, self._studio.joined).model_dump(mode="json")}))
        unwatch = self._studio.watch(self._notice)
        sides = [asyncio.create_task(each) for each in (self._read(request), self._write())]
        try:
            ended, _ = await asyncio.wait(sides, return_when=asyncio.FIRST_COMPLETED)
            for side in ended:
                side.result()  # an error ends the connection: the page would show an old state for ever
        finally:
            unwatch()
            for task in (*sides, *self._requests):
                task.cancel()
            await asyncio.gather(*sides, *self._requests, return_exceptions=True)
        return socket

    async def _greet(self, request: web.Request, token: str | None) -> str | None:
        """Return the session token for the token of the first frame; without one, close the connection."""
        if token is None:
            _rarely.warning("client refused", reason="no token", address=request.remote)
            await refuse(request, self._socket, CloseCode.NOT_UNDERSTOOD, b"the first frame has no token")
            return None
        try:
            session = self._tokens.enter(token)
        except ServiceError as error:
            _rarely.warning("client refused", reason=error.found, address=request.remote)
            text = f"The studio refused {error.found}."
            await refuse(request, self._socket, CloseCode.REFUSED, text.encode()[:MAX_REASON_BYTES])
            return None
        if session != token:
            self._entered()
        return session

    async def _read(self, request: web.Request) -> None:
        mistakes = 0
        async for frame in Heartbeat(request, self._socket, HEARTBEAT_SECONDS).messages():
            try:
                if frame.type is not WSMsgType.TEXT:
                    raise ValueError("a binary frame")
                values = json.loads(frame.data)
                if not isinstance(values, dict) or type(values.get("id")) is not int:
                    raise ValueError("no map with an id")
            except (ValueError, RecursionError):
                mistakes += 1
                _rarely.warning("request not understood", address=request.remote)
                if mistakes >= MAX_MISTAKES:
                    await self._socket.close(code=CloseCode.NOT_UNDERSTOOD, message=b"frames that are no requests")
                    return
                self._reply(error_reply(None, _NOT_A_REQUEST))
                continue
            mistakes = 0
            if len(self._requests) >= MAX_PENDING:
                self._reply(error_reply(values["id"], _BUSY))
                continue
            task = asyncio.create_task(self._answer(values))
            self._requests.add(task)
            task.add_done_callback(self._requests.discard)

    async def _answer(self, values: dict[str, Any]) -> None:
        number = values["id"]
        try:
            reply = ok_reply(number, await self._studio.answer(values))
        except PuppetlineError as error:
            reply = error_reply(number, ServiceError(**self._studio.workspace.told(error)))
        except Exception:
            log.exception("request failed")
            reply = error_reply(number, FAILED)
        self._reply(reply)

    def _reply(self, reply: dict[str, Any]) -> None:
        self._replies.append(json.dumps(reply))
        self._wake.set()

    def _notice(self, job: JobState | None) -> None:
        if job is None:
            self._stale = True
        else:
            self._progress[job.job] = job
        self._wake.set()

    async def _write(self) -> None:
        """Send what waits: first replies, then the newest progress of each job and the newest state."""
        loop, state_at, progress_at = asyncio.get_running_loop(), 0.0, 0.0
        with contextlib.suppress(ConnectionError):
            while True:
                if len(self._replies) > MAX_REPLIES:
                    await self._socket.close(code=CloseCode.TOO_SLOW, message=b"replies are not read")
                    return
                now = loop.time()
                if self._replies:
                    await self._socket.send_str(self._replies.popleft())
                elif self._progress and now >= progress_at:
                    progress_at = now + PROGRESS_SECONDS
                    jobs, self._progress = self._progress, {}
                    for job in jobs.values():
                        event = ProgressEvent(job=job.job, text=job.text, fraction=job.fraction)
                        await self._socket.send_str(event.model_dump_json())
                elif self._stale and now >= state_at:
                    self._stale, state_at = False, now + STATE_SECONDS
                    state = self._studio.state.model_dump(mode="json")
                    await self._socket.send_str(json.dumps({"event": "state", "state": state}))
                else:
                    dues = [*([progress_at] if self._progress else []), *([state_at] if self._stale else [])]
                    await self._wait(min(dues) - now if dues else None)

    async def _wait(self, seconds: float | None) -> None:
        self._wake.clear()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._wake.wait()


def token_of(text: str | None) -> str | None:
    """Return the token of a page's first frame; None if there is none."""
    try:
        token = None if text is None else json.loads(text)["token"]
    except (ValueError, TypeError, KeyError, RecursionError):
        return None
    return token if isinstance(token, str) else None


_NOT_A_REQUEST = ServiceError(
    "the frame", found="no request", expected="a JSON map with do and id", fix="Reload the page."
)
_BUSY = ServiceError(
    "the studio", found="too many pending requests", expected="fewer requests at a time", fix="Try again in a second."
)


def _greeting(session: str, joined: bool) -> Greeting:
    return Greeting(
        session=session,
        version=__version__,
        joints=list(JOINTS),
        parents=dict(PARENTS),
        forms=[*DEFAULT_TOLERANCES, *get_args(PerformerFormat)],
        suffixes={
            "character": list(CHARACTER_FILES),
            "log": list(LOG_SUFFIXES),
            "puppet": [".toml"],
            **{kind: list(suffixes) for kind, suffixes in SUFFIXES.items()},
        },
        limits={"upload_bytes": MAX_UPLOAD_BYTES, "uploads": MAX_UPLOADS},
        joined=joined,
    )
