"""What a screen gets with its key, and what everybody gets."""

import json

import pytest

from engine_bridge.service.kiosk.kiosk_table import KioskTable, ScreenTable
from engine_bridge.studio.screen.kiosk import VisitorsKiosk
from engine_bridge.studio.web.screen_routes import ScreenRoutes


@pytest.fixture
def key(studio):
    """Return the header with the key of the studio's screen."""
    return {"Authorization": f"Bearer {studio.served.screen.partition('#key=')[2]}"}


def settings(studio, headers):
    status, _, body = studio.http("GET", "/screen", headers=headers)
    return status, json.loads(body)


def test_a_screen_gets_its_settings_with_its_key_or_a_session(studio, key):
    assert "/kiosk#key=" in studio.served.screen
    for headers in (key, studio.bearer):
        status, got = settings(studio, headers)
        assert (status, got["models"]) == (200, [])
        assert got["kiosk"] == got["kiosk"] | {
            "title": "Museum",
            "files": ["logo"],
            "languages": ["de", "en"],
            "texts": {"de": {"film": "Dein Film!"}},
            "minutes": 5.0,
            "phones": None,
        }
    for path in ("/kiosk", "/stage"):
        assert studio.http("GET", path)[::2] == (200, b"<!doctype html><title>Screen</title>")
    assert studio.http("GET", "/screen/files/logo")[::2] == (200, b"<svg/>")
    for path in ("film", "kiosk.toml", "..%2fkiosk.toml"):
        assert studio.http("GET", f"/screen/files/{path}")[0] == 404
    film = studio.settings.kiosk.parent / "takes" / "visitors" / "K7M2QX.mp4"
    film.parent.mkdir(parents=True)
    film.write_bytes(b"a film")
    assert studio.http("GET", f"/{film.name}")[::2] == (200, b"a film")  # for whoever knows its code


def test_a_screen_loads_its_page_again_only_if_it_would_look_different(tmp_path):
    (tmp_path / "page").mkdir()
    page, logo = tmp_path / "page" / "screen.html", tmp_path / "logo.svg"

    def version(**table):
        screen = ScreenTable(logo=logo.name, **table)
        kiosk = VisitorsKiosk(KioskTable(screen=screen), tmp_path, tmp_path, {"a": tmp_path / "missing.toml"})
        return ScreenRoutes(page, lambda _: None, dict, kiosk)._version

    page.write_text("one")
    logo.write_text("one")
    first = version()
    assert version() == first  # of another start
    versions = [first, version(title="Museum")]
    for changed in (page, logo):
        changed.write_text("another")
        versions.append(version())
    assert len({*versions}) == 4


def test_the_key_opens_nothing_else_and_ends_when_its_file_is_gone(studio, key):
    token = key["Authorization"].removeprefix("Bearer ")
    for method, path in (("POST", "/uploads?name=a"), ("GET", "/files/x")):
        assert studio.http(method, path, headers=key)[0] == 401

    def closed_with(path, token):
        return studio.closed_with(path, json.dumps({"token": token}))

    assert closed_with("/api", token) == 4401
    assert closed_with("/stream", token) == 4503  # the service does not run
    assert closed_with("/stream", "another") == 4401
    file = studio.settings.screen_key
    kept = file.rename(file.with_name("kept"))
    try:
        assert settings(studio, key)[0] == 401
        assert closed_with("/stream", token) == 4401
    finally:
        kept.rename(file)
    assert settings(studio, key)[0] == 200
