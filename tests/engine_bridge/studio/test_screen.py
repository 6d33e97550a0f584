"""A kiosk in a browser: its screen leads a visitor to a film, a phone opens it by the QR code, and OBS has a source."""

import io
import time
from contextlib import closing
from importlib import import_module

import av
import numpy as np
import pytest
import segno
from PIL import Image

from ...conftest import ROOT
from ..service.conftest import free_port
from .page_driver import TIMEOUT_SECONDS, Command

__all__ = ["free_port"]

pytestmark = pytest.mark.slow

SETTINGS = """
announce = false
[network]
port = {port}
[kiosk]
count_in = 3
size = [160, 90]
phone_port = {phones}
phone_address = "http://127.0.0.1:{phones}"
[[stage]]
source = "replay:visitor.log?loop"
calibrate = "at_once"
[[stage.character]]
puppet = "{puppet}"
"""

PHASES = """window.phases = [];
new MutationObserver(() => {
  const phase = document.body?.dataset.phase;
  if (phase && phase !== phases.at(-1)) phases.push(phase);
}).observe(document, { subtree: true, childList: true, attributeFilter: ["data-phase"] });"""
"""JavaScript: keep all phases of the screen in their order."""

SHOWN = """(async () => {
  const [image, place] = [document.querySelector("main .code"), document.querySelector(".address")];
  if (!image || !place) return null;
  const address = "http://" + [...place.childNodes].map((part) => part.textContent).join("/");
  await image.decode();
  const count = image.naturalWidth; // a pixel for each module
  const canvas = Object.assign(document.createElement("canvas"), { width: 10 * count, height: 10 * count });
  const context = canvas.getContext("2d");
  context.drawImage(image, 0, 0, canvas.width, canvas.height);
  const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
  const dark = (row, column) => data[4 * ((10 * row + 5) * canvas.width + 10 * column + 5)] < 128;
  const numbers = [...Array(count).keys()];
  return [address, numbers.map((row) => numbers.map((column) => dark(row, column)))];
})()"""
"""JavaScript: the address that the screen shows, and which modules of its QR code are dark."""


@pytest.fixture(scope="module")
def screen_address(blob_puppet, tmp_path_factory, free_port):
    """The address of the screen of a kiosk, whose visitor records again and again."""
    folder = tmp_path_factory.mktemp("kiosk")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        import_module("benchmarks.visitor").write_visitor(folder / "visitor.log", dance=1.0, away=1.0)
    (folder / "kiosk.toml").write_text(SETTINGS.format(port=free_port(), phones=free_port(), puppet=blob_puppet))
    arguments = "serve", "--config", "kiosk.toml", "--studio", free_port()
    with closing(Command(*arguments, cwd=folder, environment={"XDG_STATE_HOME": str(folder)})) as service:
        yield service.printed(r"http://\S+/kiosk#key=\S+")[0]


@pytest.fixture
def opened(browser):
    """Open pages in contexts of their own; fail if one has an error."""
    contexts, problems = [], []

    def open_page(address, width, height):
        contexts.append(browser.new_context(viewport={"width": width, "height": height}))
        page = contexts[-1].new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.add_init_script(PHASES)
        page.goto(address)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert problems == []


def until(page, expression):
    """Wait until a JavaScript expression is true; return its value."""
    end = time.monotonic() + TIMEOUT_SECONDS
    while not (value := page.evaluate(expression)):
        assert time.monotonic() < end, f"never: {expression}"
        page.wait_for_timeout(50)
    return value


def test_a_visitor_is_led_to_a_film_that_a_phone_opens_by_the_qr_code(screen_address, opened, opengl):
    screen = opened(screen_address, 960, 540)
    until(screen, "phases.includes('film')")
    phases = screen.evaluate("phases")
    assert {"count", "recording", "making", "film"} <= set(phases), phases
    assert screen.locator("button, input, select, a").count() == 0
    assert screen.evaluate("getComputedStyle(document.querySelector('main')).cursor") == "none"
    address, modules = until(screen, SHOWN)
    code = segno.make(address, error="m", micro=False)
    np.testing.assert_array_equal(np.array(modules)[4:-4, 4:-4], np.array(code.matrix, bool))

    phone = opened(address, 390, 844)
    assert phone.evaluate("document.documentElement.scrollWidth") == 390
    assert until(phone, "document.querySelector('video').videoWidth") == 160
    with phone.expect_download() as download:
        phone.get_by_text("Save my film").click()
    film = download.value.path().read_bytes()
    assert film.index(b"moov") < film.index(b"mdat")  # plays before it is loaded
    with av.open(io.BytesIO(film)) as video:
        assert [each.codec_context.name for each in video.streams.video] == ["h264"]
        assert video.streams.video[0].pix_fmt == "yuv420p"
    with phone.expect_download() as download:
        phone.get_by_text(".gif").click()
    with Image.open(download.value.path()) as gif:
        assert (gif.format, gif.n_frames > 5) == ("GIF", True)
    assert until(phone, "fetch(document.querySelector('video').poster).then(reply => reply.status)") == 200


def test_the_source_for_obs_draws_the_character_on_a_transparent_ground(screen_address, opened):
    page = opened(screen_address.replace("/kiosk", "/stage?transparent"), 320, 240)
    until(page, "screenShows.characters.complete && screenShows.characters.images > 2")
    with Image.open(io.BytesIO(page.screenshot(omit_background=True))) as picture:
        alpha = np.asarray(picture.convert("RGBA"))[..., 3]
    assert (alpha[[0, 0, -1, -1], [0, -1, 0, -1]] == 0).all()
    assert 0.03 < (alpha == 255).mean() < 0.6
    rows = np.flatnonzero((alpha == 255).any(axis=1))
    assert np.ptp(rows) > 0.6 * len(alpha)  # large
    assert page.evaluate("document.body.innerText.trim()") == ""
