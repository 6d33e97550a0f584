import io
import json
import socket
from pathlib import Path

import pytest
from PIL import Image, ImageFont

from engine_bridge.film.typeface import FILES, typeface

from ...conftest import encoded


def test_the_page_and_its_files_are_sent_with_their_headers(studio):
    for path, content in (("/", b"<!doctype html>"), ("/assets/page.js", b"export")):
        status, headers, body = studio.http("GET", path)
        assert (status, body[: len(content)]) == (200, content)
        assert f"ws://127.0.0.1:{studio.served.port}" in headers["Content-Security-Policy"]
        assert (headers["X-Content-Type-Options"], headers["Cache-Control"]) == ("nosniff", "no-store")
        assert "Access-Control-Allow-Origin" not in headers


def test_the_page_gets_the_typefaces_in_which_the_film_is_written(studio):
    for name in FILES:
        status, _, body = studio.http("GET", f"/typefaces/{name}")
        assert status == 200
        assert ImageFont.truetype(io.BytesIO(body)).getname() == typeface(name, "a", 9, "", Path()).getname()
    assert studio.http("GET", "/typefaces/comic")[0] == 404


@pytest.mark.parametrize("path", ["/", "/api", "/stream", "/uploads?name=a", "/files/x", "/nowhere"])
def test_a_name_that_is_not_ours_and_a_page_of_another_site_are_refused(studio, path):
    method = "POST" if "uploads" in path else "GET"
    wrong = [("Host", each) for each in ("evil.example", "evil.example:7480", "127.0.0.1.evil.example", "192.168.1.5")]
    wrong += [("Origin", each) for each in ("http://evil.example", "null", "https://127.0.0.1.evil.example", "file://")]
    for name, value in wrong:
        status, _, body = studio.http(method, path, headers=studio.bearer | {name: value})
        assert (status, f"a wrong {name.lower()}".encode() in body) == (403, True), value
    assert studio.http(method, path, headers={"Host": ""})[0] in (400, 403)


def test_the_studios_own_page_is_accepted(studio):
    for name in ("127.0.0.1", "localhost"):
        origin = f"http://{name}:{studio.served.port}"
        headers = {"Origin": origin, "Host": f"{name}:{studio.served.port}"}
        assert studio.http("GET", "/", headers=headers)[0] == 200


def test_uploads_and_downloads_require_a_session_token(studio):
    one_time = studio.token()
    for value in ("", "Bearer", "Bearer wrong", f"Bearer {one_time}", f"Basic {studio.session}"):
        headers = {"Authorization": value}
        assert studio.http("POST", "/uploads?name=a.obj", data=b"v 0 0 0\n", headers=headers)[0] == 401
        assert studio.http("GET", "/files/x", headers=headers)[0] == 401
    assert studio.http("GET", "/files/x", headers=studio.bearer)[0] == 404
    assert studio.state["uploads"] == []


@pytest.mark.parametrize(
    "path",
    [
        "/../../../../etc/passwd",
        "/assets/..%2f..%2f..%2fetc%2fpasswd",
        "/assets//etc/passwd",
        "/files/..%2f..%2ftoken",
        "/files/%00",
        "/token",
    ],
)
def test_no_address_leads_to_another_file(studio, path):
    host = "127.0.0.1", studio.served.port
    lines = [f"GET {path} HTTP/1.1", f"Host: {host[0]}:{host[1]}", f"Authorization: Bearer {studio.session}"]
    with socket.create_connection(host) as connection:
        connection.sendall("\r\n".join([*lines, "Connection: close", "", ""]).encode())
        answer = b"".join(iter(lambda: connection.recv(65536), b""))
    assert answer.startswith((b"HTTP/1.1 404", b"HTTP/1.1 400"))
    assert b"root:" not in answer


@pytest.mark.parametrize(
    ("name", "data", "found"),
    [
        ("empty.obj", b"", "an empty file"),
        ("cow.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff", None),
        ("cow.png", b"\x89PNG\r\n", "a damaged picture"),
        ("cow.toml", b"[character", "a syntax error"),
        ("../../../etc/cow.obj", b"f 1 2 3\n", None),
        ("take.log", b'{"puppetline": "skeleton log", "version": 2, "joints": []}\n', None),
    ],
)
def test_a_broken_upload_is_refused_and_deleted(studio, name, data, found):
    status, reply = studio.upload(name, data)
    error = reply["error"]
    assert status == 400
    assert set(error) == {"where", "found", "expected", "fix"}
    assert str(studio.settings.folder) not in str(error)
    assert found is None or error["found"].startswith(found)
    assert studio.state["uploads"] == []
    assert list((studio.settings.folder / "uploads").iterdir()) == []


def test_sounds_and_pictures_become_files_of_the_film_under_names_of_their_own_and_videos_are_kept(studio):
    image = encoded(Image.new("RGB", (2, 2)))
    files = [("../my park.PNG", image, "picture"), ("song.mp3", b"x", "sound"), ("song.mp3", b"y", "sound")]
    replies = []
    for name, data, kind in files:
        status, reply = studio.upload(name, data)
        assert (status, reply["kind"], reply["upload"]) == (200, kind, "")
        assert (studio.settings.folder / reply["file"]).read_bytes() == data
        replies.append(reply["file"])
    assert replies == ["media/my_park.png", "media/song.mp3", "media/song-2.mp3"]
    scene = {"music": {"file": "media/song.mp3"}, "background": {"picture": "media/my_park.png"}}
    assert studio.result("edit_film", takes=[], scene=scene)["scene"]["music"]["file"] == "media/song.mp3"
    assert studio.error("edit_film", takes=[], scene={"music": {"file": "media/../token"}})["where"] == "the request"
    _, video = studio.upload("dance.MP4", b"x")
    assert [(each["upload"], each["kind"]) for each in studio.state["uploads"]] == [(video["upload"], "video")]
    for part in ({"start": 1.0}, {"stop": 2.0}):
        assert studio.error("source", upload=video["upload"], **part)["found"] == "start or stop with a video"
    studio.result("delete_upload", upload=video["upload"])


def test_an_upload_that_is_too_large_is_refused_before_it_is_sent(studio):
    large = {**studio.bearer, "Content-Length": "10000000000"}
    path = "/uploads?name=large.obj"
    status, _, body = studio.http("POST", path, data=b"", headers=large, skip_auto_headers=["Content-Length"])
    assert (status, json.loads(body)["error"]["found"]) == (413, "a larger file")


def test_a_page_that_was_not_built_says_so(start_studio, tmp_path):
    status, _, body = start_studio(tmp_path / "studio", page=tmp_path / "nothing").http("GET", "/")
    assert (status, b"make studio" in body) == (503, True)
