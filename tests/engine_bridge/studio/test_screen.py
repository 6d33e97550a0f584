"""A kiosk in a browser: its screen leads a visitor, a phone opens a film by its QR code, and OBS has a source.

How long the process takes that makes a film, of low priority, is not asked here: `service/kiosk/test_kiosk.py` has the
recording that becomes a film, and the page's own tests have the screen on the way to it.
"""

import io
import json
import os
import signal
import time
from contextlib import closing, contextmanager
from importlib import import_module
from types import SimpleNamespace

import av
import numpy as np
import pytest
import segno
from click.testing import CliRunner
from PIL import Image

from engine_bridge.cli.main import main
from engine_bridge.service.kiosk.clip import Clip, visitors_folder
from engine_bridge.service.kiosk.kiosk_table import KioskTable

from ...conftest import ROOT
from ..service.conftest import free_port
from .page_driver import FEWER_IMAGES, TIMEOUT_SECONDS, Command, violations

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
source = "{source}"
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

COUNT_WAKING = """window.waking = 0;
Object.defineProperty(navigator, "wakeLock", { value: { request: async () => void window.waking++ } });"""
"""JavaScript: count how often the page asks that the display stays on."""

TURN = "['count', 'recording', 'making']"
"""JavaScript: the phases between a visitor's gesture and the film."""

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


def services(folder, source, puppet, free_port):
    """Start the service of a kiosk again and again; yield it with the address of its screen."""
    settings = SETTINGS.format(source=source, port=free_port(), phones=free_port(), puppet=puppet)
    (folder / "kiosk.toml").write_text(settings)
    arguments = "serve", "--config", "kiosk.toml", "--studio", free_port()
    while True:
        with closing(Command(*arguments, cwd=folder, environment={"XDG_STATE_HOME": str(folder)})) as service:
            yield service, service.printed(r"http://\S+/kiosk#key=\S+")[0]


@contextmanager
def kiosk(folder, source, puppet, free_port):
    """Run a kiosk; return the address of its screen."""
    with closing(services(folder, source, puppet, free_port)) as started:
        yield next(started)[1]


@pytest.fixture(scope="module")
def visited_screen(tmp_path_factory, blob_puppet, free_port):
    """The address of the screen of a kiosk, whose visitor records again and again."""
    folder = tmp_path_factory.mktemp("visited")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT)
        import_module("benchmarks.visitor").write_visitor(folder / "visitor.log", dance=1.0, away=1.0)
    with kiosk(folder, "replay:visitor.log?loop", blob_puppet, free_port) as address:
        yield address


@pytest.fixture(scope="module")
def film_screen(tmp_path_factory, take, blob_puppet, free_port):
    """The address of the screen of a kiosk where nobody is, and a visitor's film is offered."""
    folder = tmp_path_factory.mktemp("film")
    player = SimpleNamespace(character=SimpleNamespace(name="blob"), document=SimpleNamespace(path=blob_puppet), user=1)
    stage, table = SimpleNamespace(players=[player]), KioskTable(size=(160, 90))
    clip = Clip.begin(visitors_folder(folder / "takes"), stage, table, 0.0)
    clip.path.write_bytes(take.read_bytes())
    made = CliRunner().invoke(main, ["film", str(clip.scene), "-o", str(clip.film), "--share"])
    assert made.exit_code == 0, made.output
    with kiosk(folder, "osc:0", blob_puppet, free_port) as address:
        yield address


@pytest.fixture
def opened(browser):
    """Open pages in contexts of their own; fail if one has an error."""
    contexts, problems = [], []

    def open_page(address, width, height, script=PHASES):
        contexts.append(browser.new_context(viewport={"width": width, "height": height}))
        page = contexts[-1].new_page()
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.add_init_script(FEWER_IMAGES + script)
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


def test_a_visitor_is_led_from_the_count_to_the_making_of_a_film_without_controls(visited_screen, opened):
    screen = opened(visited_screen, 960, 540)
    until(screen, f"phases.filter((phase) => {TURN}.includes(phase)).join().includes({TURN}.join())")
    assert screen.locator("button, input, select, a").count() == 0
    assert screen.evaluate("getComputedStyle(document.querySelector('main')).cursor") == "none"


def test_a_phone_opens_the_film_of_a_screen_by_its_qr_code_and_saves_it(film_screen, opened):
    screen = opened(film_screen, 960, 540, "performance.now = () => 0;")  # the film leaves the screen after a time
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
    assert (violations(screen), violations(phone)) == ([], [])
    phone.goto(f"{address[:-6]}QQQQQQ")  # no film has this code
    assert violations(phone) == []


def test_a_screen_whose_drawing_surface_is_lost_draws_again_and_keeps_the_display_on(visited_screen, opened):
    screen = opened(visited_screen, 320, 180, COUNT_WAKING)
    drawn = "window.screenShows?.characters.images > 2"
    until(screen, drawn)
    assert screen.evaluate("waking") == 1
    screen.evaluate("document.dispatchEvent(new Event('visibilitychange'))")
    assert screen.evaluate("waking") == 2
    surface = "document.querySelector('canvas').getContext('webgl2')"
    screen.evaluate(f"window.surface = {surface}.getExtension('WEBGL_lose_context'); surface.loseContext()")
    until(screen, f"{surface}.isContextLost()")
    screen.evaluate("surface.restoreContext()")
    until(screen, f"!{surface}.isContextLost()")
    assert screen.evaluate("waking") == 2  # the same page
    with screen.expect_navigation(timeout=1000 * TIMEOUT_SECONDS):
        screen.evaluate("surface.loseContext()")
    until(screen, f"{drawn} && !{surface}.isContextLost()")


def test_a_screen_goes_on_with_its_characters_when_the_service_was_killed(
    tmp_path, take, blob_puppet, free_port, opened
):
    with closing(services(tmp_path, f"replay:{take}?loop", blob_puppet, free_port)) as started:
        service, address = next(started)
        screen = opened(address, 320, 180)
        until(screen, "window.screenShows?.characters.shown[0] > 30")
        screen.evaluate("window.keptPage = true")
        os.kill(service.pid, signal.SIGKILL)
        until(screen, "screenShows.state() === 'offline'")
        last = json.dumps(screen.evaluate("screenShows.characters.shown[0] ?? null"))  # null once its frames are over
        assert next(started)[1] == address
        until(screen, f"screenShows.state() === 'connected' && (screenShows.characters.shown[0] ?? {last}) !== {last}")
        moved = screen.evaluate("screenShows.characters.images")
        until(screen, f"screenShows.characters.images > {moved} + 2")
        assert screen.evaluate("keptPage")


def test_the_source_for_obs_draws_the_character_on_a_transparent_ground(visited_screen, opened):
    page = opened(visited_screen.replace("/kiosk", "/stage?transparent"), 320, 240)
    until(page, "screenShows.characters.images > 2")
    with Image.open(io.BytesIO(page.screenshot(omit_background=True))) as picture:
        alpha = np.asarray(picture.convert("RGBA"))[..., 3]
    assert (alpha[[0, 0, -1, -1], [0, -1, 0, -1]] == 0).all()
    assert 0.03 < (alpha == 255).mean() < 0.6
    rows = np.flatnonzero((alpha == 255).any(axis=1))
    assert np.ptp(rows) > 0.6 * len(alpha)  # large
    assert page.evaluate("document.body.innerText.trim()") == ""
