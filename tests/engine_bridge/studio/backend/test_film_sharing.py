"""Films of the studio on phones: made once, opened by a code, and no other file."""

import asyncio
import base64
from urllib.parse import urlsplit

import aiohttp
import pytest

from engine_bridge.studio.backend import film_sharing
from engine_bridge.studio.backend.film_sharing import MAX_SHARED, FilmSharing
from engine_bridge.studio.project.workspace import Workspace
from engine_bridge.studio.screen.shared_films import qr_code
from engine_bridge.studio.web.phone_app import serve_films
from puppetline.errors import ServiceError


class Posters:
    """A worker that writes what goes with a film."""

    async def run(self, task, video):
        assert task == "share_film"
        for ending in (".jpg", ".gif"):
            video.with_suffix(ending).write_bytes(ending.encode())


@pytest.fixture
def film(tmp_path):
    path = tmp_path / "film.mp4"
    path.write_bytes(b"a film")
    return path


async def fetched(*addresses):
    async with aiohttp.ClientSession() as http:
        replies = [await http.get(address) for address in addresses]
        return [(reply.status, await reply.read()) for reply in replies]


def test_a_phone_opens_the_film_at_the_address_of_the_qr_code_until_the_studio_ends(tmp_path, film, monkeypatch):
    monkeypatch.setattr(film_sharing, "phone_address", lambda _, port: f"http://127.0.0.1:{port}")

    async def story():
        workspace = Workspace(tmp_path / "studio")
        sharing = FilmSharing(workspace, Posters(), serve_films)
        shared = [await sharing.share(film) for _ in range(MAX_SHARED + 1)]
        last = shared[-1]
        assert base64.b64decode(last.code) == qr_code(last.address)
        assert workspace.downloads[last.poster].path.read_bytes() == b".jpg"
        page, video, gif, first = await fetched(
            last.address, f"{last.address}.mp4", f"{last.address}.gif", shared[0].address
        )
        assert (video, gif, page[0], first[0]) == ((200, b"a film"), (200, b".gif"), 200, 404)
        assert film_sharing.NOTE.encode() in page[1]
        assert len({urlsplit(each.address).port for each in shared}) == 1
        assert len(list((workspace.folder / "shared").iterdir())) == 3 * MAX_SHARED
        await sharing.close()
        with pytest.raises(aiohttp.ClientConnectionError):
            await fetched(last.address)

    asyncio.run(story())


def test_without_a_network_nothing_is_shared(tmp_path, film, monkeypatch):
    monkeypatch.setattr(film_sharing, "phone_address", lambda *_: None)
    workspace = Workspace(tmp_path / "studio")
    with pytest.raises(ServiceError, match="no address that a phone reaches"):
        asyncio.run(FilmSharing(workspace, Posters(), serve_films).share(film))
    assert not (workspace.folder / "shared").exists()
