"""The web server for phones: a page with a film, to play, save and share. It has nothing else to reach."""

import asyncio
import logging
import re
import socket

from aiohttp import web

from engine_bridge.service.kiosk.clip import CODE
from engine_bridge.studio.screen.kiosk import VisitorsKiosk
from engine_bridge.studio.screen.shared_films import Films
from engine_bridge.studio.web.film_routes import add_films
from engine_bridge.studio.web.phone_connections import REQUEST_SECONDS, limited

RETRY_SECONDS = 1.0
"""Time until the port is tried again, in seconds; a service that has just been killed may still have it."""

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'self'; img-src 'self' data:; object-src 'none'; base-uri 'none'; frame-ancestors 'none'"
    ),
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
"""Headers of every answer."""

PAGE = """<!doctype html>
<html lang="en">
  <meta charset="utf-8">
  <meta name="viewport" content="width=device-width, initial-scale=1">
  <title>Your film</title>
  <link rel="icon" href="data:,">
  <link rel="stylesheet" href="/style.css">
  <main>
    <h1>Your film</h1>
    {body}
  </main>
</html>
"""

FILM = """<video src="/{code}.mp4" poster="/{code}.jpg" controls autoplay muted loop playsinline></video>
    <a class="first" href="/{code}.mp4?save" download="film-{code}.mp4">Save my film</a>
    <a href="/{code}.gif?save" download="film-{code}.gif">Save as a moving picture (.gif)</a>
    <p>{note}</p>"""

VISITORS_NOTE = "This page is deleted in a few minutes. Save your film now."

FORM = """{problem}<form action="/">
      <label for="code">Type your code</label>
      <input id="code" name="code" maxlength="12" autocomplete="off" autocapitalize="characters" required>
      <button class="first">Show my film</button>
    </form>"""

NO_FILM = """<p role="alert">No film has this code. Check the letters. A film is kept for some minutes only.</p>
    """

STYLE = """:root { color-scheme: dark; font: 1.125rem/1.45 system-ui, sans-serif; background: #131a2b; color: #fff; }
body { margin: 0; }
main { display: grid; gap: 1rem; margin: 0 auto; padding: 1.25rem; max-width: 40rem; }
h1 { margin: 0; font-size: 1.75rem; }
p { margin: 0; color: #c3cad9; }
video { width: 100%; border-radius: 1rem; background: #000; }
form { display: grid; gap: 1rem; }
input, button, a {
  box-sizing: border-box; width: 100%; padding: 0.875rem; border: 2px solid #8894ad; border-radius: 1rem;
  background: none; color: inherit; font: inherit; font-weight: 600; text-align: center; text-decoration: none;
}
input { font-size: 1.5rem; letter-spacing: 0.3em; text-transform: uppercase; }
.first { border-color: #ffb020; background: #ffb020; color: #131a2b; }
:focus-visible { outline: 3px solid #fff; outline-offset: 3px; }
"""

log = logging.getLogger(__name__)


def make_phone_app(films: Films, note: str = VISITORS_NOTE) -> web.Application:
    """Return the application; the page of a film ends with a note."""
    app = web.Application(middlewares=[_headed])
    add_films(app.router, films)

    async def film(request: web.Request) -> web.StreamResponse:
        code = request.match_info["code"]
        found = films.film_file(code, ".mp4") is not None
        return _page(
            FILM.format(code=code, note=note) if found else FORM.format(problem=NO_FILM), 200 if found else 404
        )

    app.router.add_get(f"/{{code:{CODE}}}", film)
    app.router.add_get("/", _form)
    app.router.add_get("/style.css", _style)
    return app


async def serve_phones(kiosk: VisitorsKiosk) -> None:
    """Serve visitors' films on all addresses of this machine, until cancelled."""
    await serve_films(kiosk, await _bound(kiosk.table.phone_port))


async def serve_films(films: Films, listener: socket.socket, note: str = VISITORS_NOTE) -> None:
    """Serve films until cancelled; `listener` is then closed."""
    app = make_phone_app(films, note)
    runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0, keepalive_timeout=REQUEST_SECONDS)
    await runner.setup()
    assert runner.server is not None  # noqa: S101 - it is set up
    try:
        async with await asyncio.get_running_loop().create_server(limited(runner.server), sock=listener) as server:
            await server.serve_forever()
    finally:
        await runner.cleanup()


async def _bound(port: int) -> socket.socket:
    logged = False
    while True:
        try:
            return socket.create_server(("", port))
        except OSError as error:
            if not logged:
                log.warning("phones cannot get films at port %d: %s", port, error.strerror)
                logged = True
        await asyncio.sleep(RETRY_SECONDS)


@web.middleware
async def _headed(request: web.Request, handler: object) -> web.StreamResponse:
    try:
        response: web.StreamResponse = await handler(request)  # type: ignore[operator]
    except web.HTTPException as error:
        error.headers.update(HEADERS)
        raise
    response.headers.update(HEADERS)
    return response


async def _form(request: web.Request) -> web.StreamResponse:
    code = re.sub(r"\W", "", request.query.get("code", "")).upper()
    if re.fullmatch(CODE, code):
        raise web.HTTPSeeOther(f"/{code}")
    return _page(FORM.format(problem=NO_FILM if code else ""))


async def _style(_: web.Request) -> web.StreamResponse:
    return web.Response(text=STYLE, content_type="text/css")


def _page(body: str, status: int = 200) -> web.StreamResponse:
    return web.Response(text=PAGE.format(body=body), status=status, content_type="text/html")
