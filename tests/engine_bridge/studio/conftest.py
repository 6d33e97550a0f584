"""Studios that run beside the tests, and pages that speak to them."""

import asyncio
import contextlib
import json
import threading
from concurrent.futures import Future

import aiohttp
import pytest

from engine_bridge.studio.server import StudioSettings, served
from puppetline.errors import PuppetlineError

TIMEOUT_SECONDS = 400.0
"""Time after which a test fails, in seconds; the first start of a service compiles."""


KIOSK = """
[kiosk]
phone_port = 0
minutes = 5.0

[kiosk.screen]
title = "Museum"
logo = "logo.svg"
film = "missing.mp4"
languages = ["de", "en"]
texts.de.film = "Dein Film!"

[[stage]]
source = "osc:0"
character = [{ puppet = "dog.toml" }]
"""


class RunningStudio:
    """A studio in a thread with its own event loop."""

    def __init__(self, settings):
        self.settings = settings
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._started = Future()
        self._thread = threading.Thread(target=self._loop.run_until_complete, args=(self._serve(),), daemon=True)
        self._thread.start()
        self.served = self._started.result(TIMEOUT_SECONDS)
        self.address = f"http://127.0.0.1:{self.served.port}"
        self.greeting = self.run(self.enter(self.token()))
        self.session = self.greeting["session"]
        self.bearer = {"Authorization": f"Bearer {self.session}"}

    async def _serve(self):
        try:
            async with served(self.settings) as studio:
                self._started.set_result(studio)
                await self._stop.wait()
        except BaseException as error:
            if not self._started.done():
                self._started.set_exception(error)
            raise

    def run(self, coroutine):
        """Run a coroutine in the studio's loop."""
        return asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(TIMEOUT_SECONDS)

    def token(self):
        """Return a new one-time token."""
        return self.served.link().partition("#token=")[2]

    async def enter(self, token):
        """Connect a page, and return its greeting."""
        async with connected(self.address, token) as socket:
            return (await socket.receive_json())["hello"]

    def result(self, do, **arguments):
        """Return the result of a request that must succeed."""
        return json.loads(json.dumps(self.run(self.served.studio.answer({"id": 0, "do": do, **arguments}))))

    def error(self, do, **arguments):
        """Return the error of a request that must fail."""
        with pytest.raises(PuppetlineError) as caught:
            self.result(do, **arguments)
        return self.served.studio.workspace.told(caught.value)

    @property
    def state(self):
        """The present state."""
        return self.result("state")

    def until(self, is_true):
        """Return the first state for which a function is true."""

        async def wait():
            studio, changed = self.served.studio, asyncio.Event()
            unwatch = studio.watch(lambda _: changed.set())
            while not is_true(state := studio.state.model_dump(mode="json")):
                await changed.wait()
                changed.clear()
            unwatch()
            return state

        return self.run(asyncio.wait_for(wait(), TIMEOUT_SECONDS))

    def http(self, method, path, **more):
        """Send a request without a session token; return status, headers and body."""

        async def send():
            async with aiohttp.ClientSession() as http, http.request(method, self.address + path, **more) as response:
                return response.status, response.headers, await response.read()

        return self.run(send())

    def closed_with(self, path, *frames):
        """Return the code with which a WebSocket is closed after some frames."""

        async def send():
            async with aiohttp.ClientSession() as http, http.ws_connect(self.address + path) as socket:
                for frame in frames:
                    await (socket.send_bytes if isinstance(frame, bytes) else socket.send_str)(frame)
                while not socket.closed:
                    await socket.receive()
                return socket.close_code

        return self.run(send())

    def upload(self, name, data):
        """Upload a file; return the status and the reply."""
        status, _, body = self.http("POST", "/uploads", params={"name": name}, data=data, headers=self.bearer)
        return status, json.loads(body)

    def download(self, file):
        """Return the content of a file of the studio."""
        status, _, body = self.http("GET", f"/files/{file}", headers=self.bearer)
        assert status == 200
        return body

    def close(self):
        """End the studio."""
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join(TIMEOUT_SECONDS)
        assert not self._thread.is_alive()


@contextlib.asynccontextmanager
async def connected(address, token):
    """Connect a page to a studio at an address; its greeting comes next."""
    async with aiohttp.ClientSession() as http, http.ws_connect(f"{address}/api", max_msg_size=0) as socket:
        await socket.send_json({"token": token})
        yield socket


async def received(socket, is_wanted):
    """Return the next frame for which a function is true."""
    while not is_wanted(frame := await socket.receive_json(timeout=TIMEOUT_SECONDS)):
        pass
    return frame


@pytest.fixture(scope="session")
def start_studio(own_cache):
    """Start studios, each in a folder."""
    started = []

    def start(folder, **settings):
        started.append(RunningStudio(StudioSettings(folder, port=0, **settings)))
        return started[-1]

    yield start
    for studio in started:
        if studio._thread.is_alive():
            studio.close()


@pytest.fixture(scope="module")
def studio(start_studio, tmp_path_factory):
    """A studio for a file of tests, without a character at first."""
    page = tmp_path_factory.mktemp("page")
    (page / "index.html").write_text("<!doctype html><title>Studio</title>")
    (page / "assets").mkdir()
    (page / "assets" / "page.js").write_text("export {};")
    (page / "screen.html").write_text("<!doctype html><title>Screen</title>")
    kiosk = tmp_path_factory.mktemp("kiosk") / "kiosk.toml"
    kiosk.write_text(KIOSK)
    (kiosk.parent / "logo.svg").write_text("<svg/>")
    running = start_studio(tmp_path_factory.mktemp("studio"), page=page, kiosk=kiosk)
    yield running
    running.close()
