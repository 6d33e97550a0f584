"""The paths of films, for screens and phones: the code of a film is all that it takes to see it."""

from functools import partial
from pathlib import Path
from urllib.parse import quote

from aiohttp import web

from engine_bridge.service.kiosk.clip import CODE
from engine_bridge.studio.screen.shared_films import Films

ENDINGS = ".mp4", ".jpg", ".gif"
"""Endings of the files of a film."""


def add_films(router: web.UrlDispatcher, films: Films) -> None:
    """Add ``/CODE.mp4``, ``/CODE.jpg`` and ``/CODE.gif``; with ``?save``, a browser saves the file."""
    for ending in ENDINGS:
        router.add_get(f"/{{code:{CODE}}}{ending}", partial(_film, films, ending))


def sent(path: Path | None) -> web.FileResponse:
    """Return an answer with a file.

    Raises
    ------
    aiohttp.web.HTTPNotFound
        There is none.
    """
    if path is None or not path.is_file():
        raise web.HTTPNotFound
    return web.FileResponse(path)


async def _film(films: Films, ending: str, request: web.Request) -> web.StreamResponse:
    response = sent(films.film_file(request.match_info["code"], ending))
    if "save" in request.query:
        name = f"film-{request.match_info['code']}{ending}"
        response.headers["Content-Disposition"] = f"attachment; filename={quote(name)}"
    return response
