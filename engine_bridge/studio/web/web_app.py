"""The web server of the studio: the page, the WebSockets ``/api`` and ``/stream``, uploads and downloads."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from urllib.parse import quote

from aiohttp import web

from engine_bridge.film.typeface import installed_file
from engine_bridge.service.monitoring.logs import OnceASecond
from engine_bridge.studio.backend.backend import Backend
from engine_bridge.studio.project.workspace import UploadError
from engine_bridge.studio.screen.kiosk import VisitorsKiosk
from engine_bridge.studio.screen.screen_key import ScreenKey
from engine_bridge.studio.web.api_connection import ApiClient
from engine_bridge.studio.web.film_routes import sent
from engine_bridge.studio.web.page_access import Addresses, Tokens, bearer, page_headers
from engine_bridge.studio.web.screen_routes import ScreenRoutes
from engine_bridge.studio.web.stream_proxy import Rights, pass_through
from puppetline.errors import OutputError, PuppetlineError, ServiceError

PAGE = Path(__file__).parents[1] / "page" / "dist"
"""Folder of the built page."""

CHUNK_BYTES = 65_536
"""Size of the parts in which an upload is read, in bytes."""

MAX_HANDSHAKES = 16
"""Maximum number of pages whose connections have not sent a token yet; further ones are refused."""

NOT_BUILT = "The page of the studio has not been built. Type `make studio` in the folder of the project.\n"

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

log = logging.getLogger(__name__)
_rarely = OnceASecond(log)


@dataclass(frozen=True)
class Access:
    """Access to the server: addresses, tokens, the key of screens, and a callback for when a one-time token is used."""

    addresses: Addresses
    tokens: Tokens
    screens: ScreenKey
    entered: Callable[[], None] = lambda: None


def make_app(studio: Backend, access: Access, page: Path = PAGE, kiosk: VisitorsKiosk | None = None) -> web.Application:
    """Return the application.

    Parameters
    ----------
    studio : Backend
    access : Access
    page : Path
        Folder of the built page.
    kiosk : VisitorsKiosk, optional
    """
    server = _Server(studio, access, page)
    app = web.Application(middlewares=[server.check])
    app.router.add_get("/", server.index)
    app.router.add_get("/api", server.api)
    app.router.add_get("/stream", server.stream)
    app.router.add_post("/uploads", server.upload)
    app.router.add_get("/files/{file}", server.download)
    app.router.add_get("/typefaces/{name}", server.typeface)
    screen = server.assets.get("screen.html")
    ScreenRoutes(screen, server.authorize_screen, lambda: studio.models, kiosk).add_to(app.router)
    app.router.add_get("/{path:.+}", server.asset)
    return app


class _Server:
    """The handlers of all paths."""

    def __init__(self, studio: Backend, access: Access, page: Path) -> None:
        self._studio, self._access = studio, access
        self.assets = _assets(page)
        self._handshakes = asyncio.Semaphore(MAX_HANDSHAKES)

    @web.middleware
    async def check(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse other hosts and origins, and set the headers of every answer."""
        host = request.headers.get("Host")
        refusal = self._access.addresses.access.refusal(host, request.headers.get("Origin"))
        if refusal is not None:
            _rarely.warning("request refused", reason=refusal, address=request.remote)
            return _error(403, _forbidden(refusal))
        try:
            response = await handler(request)
        except web.HTTPException as error:
            error.headers.update(page_headers(host or ""))
            raise
        except PuppetlineError as error:
            response = _error(_status(error), ServiceError(**self._studio.workspace.told(error)))
        if not response.prepared:
            response.headers.update(page_headers(host or ""))
        return response

    async def index(self, _: web.Request) -> web.StreamResponse:
        """Send the page."""
        if "index.html" not in self.assets:
            return web.Response(status=503, text=NOT_BUILT)
        return web.FileResponse(self.assets["index.html"])

    async def asset(self, request: web.Request) -> web.StreamResponse:
        """Send a file of the page that existed when the server started."""
        return sent(self.assets.get(request.match_info["path"]))

    async def typeface(self, request: web.Request) -> web.StreamResponse:
        """Send a typeface of films, in which the page shows titles and bubbles."""
        return sent(installed_file(request.match_info["name"]))

    async def api(self, request: web.Request) -> web.StreamResponse:
        """Serve the protocol of `engine_bridge.studio.messages`."""
        client = ApiClient(self._studio, self._access.tokens, self._access.entered)
        return await client.run(request, self._free_handshakes())

    async def stream(self, request: web.Request) -> web.StreamResponse:
        """Pass the service's WebSocket through."""
        handshakes = self._free_handshakes()
        return await pass_through(request, self._rights, handshakes, lambda: self._studio.service.reached)

    async def upload(self, request: web.Request) -> web.StreamResponse:
        """Receive a file."""
        self._authorize(request)
        name = request.query.get("name", "")[:200]
        path = await self._studio.workspace.receive(name, request.content_length, _chunks(request))
        reply = await self._studio.receive(name, path)
        return web.json_response(reply.model_dump(mode="json"))

    async def download(self, request: web.Request) -> web.StreamResponse:
        """Send a file that was offered."""
        self._authorize(request)
        found = self._studio.workspace.downloads.get(request.match_info["file"])
        if found is None or not found.path.is_file():
            raise web.HTTPNotFound
        response = web.FileResponse(found.path)
        response.content_type = "application/octet-stream"
        response.headers["Content-Disposition"] = f"attachment; filename*=UTF-8''{quote(found.name)}"
        return response

    def authorize_screen(self, request: web.Request) -> None:
        """Refuse a request without the key of screens and without a session token."""
        if self._rights(bearer(request.headers)) == "none":
            self._refuse(request)

    def _rights(self, token: str) -> Rights:
        if self._access.tokens.is_session(token):
            return "all"
        return "subscribe" if self._access.screens.opens(token) else "none"

    def _free_handshakes(self) -> asyncio.Semaphore:
        """Return what counts the connections without a token, unless there are too many."""
        if self._handshakes.locked():
            _rarely.warning("client refused", reason="too many connections without a token")
            raise web.HTTPServiceUnavailable(headers={"Connection": "close"})
        return self._handshakes

    def _authorize(self, request: web.Request) -> None:
        if not self._access.tokens.is_session(bearer(request.headers)):
            self._refuse(request)

    def _refuse(self, request: web.Request) -> NoReturn:
        _rarely.warning("request refused", reason="no session token", address=request.remote)
        raise UnauthorizedError(
            "the header Authorization",
            found="no valid session token",
            expected="Bearer and the session token of the greeting",
            fix="Reload the page.",
        )


class UnauthorizedError(ServiceError):
    """A request without a valid session token."""


async def _chunks(request: web.Request) -> AsyncIterator[bytes]:
    async for chunk in request.content.iter_chunked(CHUNK_BYTES):
        yield chunk


def _assets(page: Path) -> dict[str, Path]:
    """Return the files of the page by their paths in addresses, so that no address is turned into a path."""
    return {path.relative_to(page).as_posix(): path for path in page.rglob("*") if path.is_file()}


def _status(error: PuppetlineError) -> int:
    kinds: dict[type[PuppetlineError], int] = {UnauthorizedError: 401, UploadError: 413, OutputError: 507}
    return next((status for kind, status in kinds.items() if isinstance(error, kind)), 400)


def _error(status: int, error: PuppetlineError) -> web.Response:
    return web.Response(status=status, text=json.dumps({"error": error.parts}), content_type="application/json")


def _forbidden(refusal: str) -> ServiceError:
    return ServiceError(
        "the request",
        found=f"a {refusal}",
        expected="an address at which the studio is served",
        fix="Open the address that the terminal shows; give other addresses with --origin.",
    )
