"""The paths of screens: the pages ``/kiosk`` and ``/stage``, and what they load (docs/kiosk.md)."""

import hashlib
from collections.abc import Callable
from pathlib import Path

from aiohttp import web

from engine_bridge.service.kiosk.clip import CODE
from engine_bridge.studio.messages.screen import KioskScreen, ScreenSettings
from engine_bridge.studio.screen.kiosk import VisitorsKiosk
from engine_bridge.studio.screen.shared_films import qr_code
from engine_bridge.studio.web.film_routes import add_films, sent


class ScreenRoutes:
    """The handlers of screens.

    Parameters
    ----------
    page : Path or None
        The page, if it is built.
    authorize : callable
        Raises an error for a request without the screen's key or a session.
    models : callable
        Returns the models of characters by their names.
    kiosk : VisitorsKiosk or None
    """

    def __init__(
        self,
        page: Path | None,
        authorize: Callable[[web.Request], None],
        models: Callable[[], dict[str, Path]],
        kiosk: VisitorsKiosk | None,
    ) -> None:
        self._page, self._authorize, self._models, self._kiosk = page, authorize, models, kiosk
        self._version = _version(page, kiosk)

    def add_to(self, router: web.UrlDispatcher) -> None:
        """Add the paths."""
        router.add_get("/stage", self.page)
        router.add_get("/screen", self.settings)
        router.add_get("/screen/models/{name}.glb", self.model)
        if self._kiosk is not None:
            router.add_get("/kiosk", self.page)
            router.add_get("/screen/files/{name}", self.file)
            router.add_get(f"/screen/codes/{{code:{CODE}}}.svg", self.qr_code)
            add_films(router, self._kiosk)

    async def page(self, _: web.Request) -> web.StreamResponse:
        """Send the page, which has no secret."""
        return sent(self._page)

    async def settings(self, request: web.Request) -> web.StreamResponse:
        """Send `ScreenSettings`."""
        self._authorize(request)
        settings = ScreenSettings(version=self._version, models=list(self._models()), kiosk=_shown(self._kiosk))
        return web.json_response(settings.model_dump(mode="json"))

    async def model(self, request: web.Request) -> web.StreamResponse:
        """Send the file of a character's materials."""
        self._authorize(request)
        return sent(self._models().get(request.match_info["name"]))

    async def file(self, request: web.Request) -> web.StreamResponse:
        """Send the logo or the film, which requires no key."""
        return sent(_of(self._kiosk).branding.get(request.match_info["name"]))

    async def qr_code(self, request: web.Request) -> web.StreamResponse:
        """Send the QR code of a film's address."""
        phones = _of(self._kiosk).phone_address
        if phones is None:
            raise web.HTTPNotFound
        return web.Response(body=qr_code(f"{phones}/{request.match_info['code']}"), content_type="image/svg+xml")


def _version(page: Path | None, kiosk: VisitorsKiosk | None) -> str:
    """Return a digest of what a screen looks like.

    It does not change when only the server restarts, so that screens keep their page.
    """
    files = [] if page is None else sorted(page.parent.rglob("screen.*"))
    files += [] if kiosk is None else kiosk.files
    found = [path.stat() for path in files if path.is_file()]
    seen = [(each.st_ino, each.st_mtime_ns, each.st_size) for each in found]
    return hashlib.sha256(repr((seen, kiosk and kiosk.table)).encode()).hexdigest()


def _of(kiosk: VisitorsKiosk | None) -> VisitorsKiosk:
    assert kiosk is not None  # noqa: S101 - these paths exist with a kiosk only
    return kiosk


def _shown(kiosk: VisitorsKiosk | None) -> KioskScreen | None:
    if kiosk is None:
        return None
    table, screen = kiosk.table, kiosk.table.screen
    return KioskScreen(
        title=screen.title or "",
        files=[kind for kind, path in kiosk.branding.items() if path.is_file()],
        languages=list(screen.languages),
        texts={language: each.model_dump(exclude_none=True) for language, each in screen.texts.items()},
        phones=kiosk.phone_address,
        **screen.model_dump(include={"background", "color", "accent"}),
        **table.model_dump(include={"minutes", "longest"}),
    )
