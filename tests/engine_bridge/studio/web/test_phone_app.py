"""The page with a visitor's film."""

import asyncio
import socket

import pytest
from aiohttp import web
from aiohttp.test_utils import TestClient, TestServer

from engine_bridge.service.kiosk.kiosk_table import KioskTable
from engine_bridge.studio.screen.kiosk import VisitorsKiosk
from engine_bridge.studio.screen.shared_films import qr_code
from engine_bridge.studio.web.phone_app import make_phone_app, serve_phones
from engine_bridge.studio.web.screen_routes import ScreenRoutes

from ...service.conftest import free_port

__all__ = ["free_port"]

CODE = "K7M2QX"


@pytest.fixture
def kiosk(tmp_path):
    """A kiosk with one film, and the take and a part of the film of another visitor."""
    for name in (f"{CODE}.mp4", f"{CODE}.jpg", f"{CODE}.gif", f"{CODE}.log", "ABCDEF.log", "ABCDEF.gif"):
        (tmp_path / name).write_bytes(name.encode())
    return VisitorsKiosk(KioskTable(phone_address="https://films.example"), tmp_path, tmp_path, {})


def replies(app, *paths):
    """Return status, headers and text of each reply, without following redirections."""

    async def fetch():
        async with TestClient(TestServer(app)) as client:
            got = []
            for path in paths:
                async with client.get(path, allow_redirects=False) as reply:
                    got.append((reply.status, reply.headers, await reply.text()))
            return got

    return asyncio.run(fetch())


def test_the_page_of_a_code_plays_and_saves_its_film_and_nothing_else_can_be_reached(kiosk):
    known, unknown, form, typed, wrong, film, saved, *others = replies(
        make_phone_app(kiosk),
        *(f"/{CODE}", "/ABCDEF", "/", "/?code=k7m%202qx", "/?code=%22%3E%3Cb%3E", f"/{CODE}.mp4", f"/{CODE}.gif?save"),
        *(f"/{CODE}.log", f"/{CODE.lower()}.gif", "/ABCDEF.gif", f"/..%2f{CODE}.mp4"),
        *("/kiosk", "/screen", "/api", "/files/x", "/..%2fkiosk.toml"),
    )
    assert (known[0], unknown[0], form[0], typed[0], wrong[0]) == (200, 404, 200, 303, 200)
    video = f'<video src="/{CODE}.mp4" poster="/{CODE}.jpg"'
    assert all(part in known[2] for part in (video, f'href="/{CODE}.mp4?save"', f'href="/{CODE}.gif?save"'))
    assert typed[1]["Location"] == f"/{CODE}"
    assert "<input" in form[2]
    assert "alert" not in form[2]
    assert "<input" in unknown[2]
    assert all("alert" in each[2] for each in (unknown, wrong))
    assert "<b>" not in wrong[2]
    assert (film[0], film[2], film[1]["Content-Type"]) == (200, f"{CODE}.mp4", "video/mp4")
    assert "Content-Disposition" not in film[1]
    assert saved[2] == f"{CODE}.gif"
    assert saved[1]["Content-Disposition"] == f"attachment; filename=film-{CODE}.gif"
    assert {status for status, _, _ in others} == {404}
    assert "img-src 'self' data:" in known[1]["Content-Security-Policy"]
    policies = [headers["Content-Security-Policy"] for _, headers, _ in (known, *others)]
    assert all(policy.startswith("default-src 'self'") for policy in policies)


def test_the_qr_code_is_that_of_the_page_s_address(kiosk):
    app = web.Application()
    ScreenRoutes(None, lambda _: None, dict, kiosk).add_to(app.router)
    ((status, headers, svg),) = replies(app, f"/screen/codes/{CODE}.svg")
    assert (status, headers["Content-Type"]) == (200, "image/svg+xml")
    assert svg.encode() == qr_code(f"https://films.example/{CODE}")  # test_screen.py reads one


def test_a_port_that_is_in_use_is_tried_again(kiosk, free_port, monkeypatch, caplog):
    monkeypatch.setattr("engine_bridge.studio.web.phone_app.RETRY_SECONDS", 0.01)
    port = free_port()
    own = VisitorsKiosk(KioskTable(phone_port=port), kiosk.folder, kiosk.visitors, {})

    async def run():
        with socket.create_server(("", port)):
            serving = asyncio.create_task(serve_phones(own))
            while "phones cannot get films" not in caplog.text:
                await asyncio.sleep(0.01)
        while True:
            try:
                _, writer = await asyncio.open_connection("127.0.0.1", port)
                break
            except OSError:
                await asyncio.sleep(0.01)
        assert writer.get_extra_info("peername")[1] == port
        writer.close()
        serving.cancel()

    asyncio.run(run())
