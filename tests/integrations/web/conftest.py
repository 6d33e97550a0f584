"""A real browser, and the pages that tests open in it."""

import base64
import http.server
import subprocess
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from ...conftest import missing

HERE = Path(__file__).parent
PEERS = HERE.parents[1] / "peers"
WEB = HERE.parents[2] / "integrations" / "web"
TIMEOUT_SECONDS = 120.0
"""Time after which a test fails, in seconds."""


@pytest.fixture
def node_program(node):
    """Run a program of tests/peers with node; fail with what it prints."""

    def run(program, *arguments):
        done = subprocess.run(
            ["node", PEERS / program, *map(str, arguments)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr

    return run


class Site(http.server.ThreadingHTTPServer):
    """Serves the modules, three.js, the pages of the tests, and the files that a test adds."""

    daemon_threads = True

    def __init__(self):
        self.files = {}
        super().__init__(("127.0.0.1", 0), Handler)
        self.origin = f"http://127.0.0.1:{self.server_address[1]}"
        threading.Thread(target=self.serve_forever, args=(0.05,), daemon=True).start()

    def add(self, path, name=None):
        """Serve a file; return its address."""
        self.files[f"/files/{name or path.name}"] = path
        return f"/files/{name or path.name}"


class Handler(http.server.SimpleHTTPRequestHandler):
    def translate_path(self, path):
        path = path.partition("?")[0]
        if path in self.server.files:
            return str(self.server.files[path])
        for prefix, folder in (("/node_modules/", PEERS), ("/tests/", HERE.parent)):
            if path.startswith(prefix):
                return str(folder) + path.removeprefix("/tests")
        return str(WEB) + path

    def log_message(self, *_):
        pass


@pytest.fixture(scope="module")
def site():
    if not (PEERS / "node_modules" / "three").is_dir():
        missing("node", "tests/peers/node_modules is not installed (make peers)")
    serving = Site()
    yield serving
    serving.shutdown()
    serving.server_close()


class Page:
    """A page with the functions of page.js, and what went wrong there."""

    def __init__(self, browser, address):
        self.wrong = []
        self.page = browser.new_page(viewport={"width": 640, "height": 480})
        self.page.set_default_timeout(1000 * TIMEOUT_SECONDS)
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.goto(address)

    def run(self, function, argument=None):
        """Call an asynchronous function of JavaScript, and return its result; typed arrays become NumPy's."""
        return arrays(self.page.evaluate(f"async (argument) => pack(await ({function})(argument))", argument))

    def until(self, function, argument=None):
        """Call a function of JavaScript until its result is true, and return that."""
        give_up = time.monotonic() + TIMEOUT_SECONDS
        while not (found := self.run(function, argument)):
            assert time.monotonic() < give_up, f"{function} is not true"
            assert not self.wrong, self.wrong
            self.page.wait_for_timeout(20)
        return found

    def picture(self):
        """Return the page as (height, width, 3) uint8."""
        from io import BytesIO

        from PIL import Image

        return np.array(Image.open(BytesIO(self.page.screenshot())).convert("RGB"))


def arrays(value):
    if isinstance(value, dict):
        if value.keys() == {"type", "base64"}:
            return np.frombuffer(base64.b64decode(value["base64"]), {"Float32Array": "<f4"}[value["type"]])
        return {key: arrays(each) for key, each in value.items()}
    return [arrays(each) for each in value] if isinstance(value, list) else value


@pytest.fixture
def open_page(browser, site):
    """Open page.html of this folder, or another page of the site; fail if something went wrong in it."""
    opened = []

    def make(address="/tests/web/page.html"):
        opened.append(Page(browser, site.origin + address))
        return opened[-1]

    yield make
    for each in opened:
        each.page.close()
        assert not each.wrong


@pytest.fixture
def serve_page(serve, site):
    """Start a service that pages of the site may follow; return it, and the address of its WebSocket."""

    def start(*arguments, port=0, **more):
        service = serve(*arguments, "--websocket", port, "--origin", site.origin, **more)
        [address] = [each for each in service.logged("serving")["fields"]["stream"] if each.startswith("ws://")]
        return service, address

    return start
