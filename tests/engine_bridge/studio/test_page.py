"""The page of `puppetline studio` in a browser: from an empty page to an exported file, and what goes wrong."""

import psutil
import pytest

from engine_bridge.character.examples import prepare

from .page_driver import RULES, TIMEOUT_SECONDS, running, violations

pytestmark = pytest.mark.slow

MAX_CLICKS = 6
"""Maximum number of clicks from the empty page to the first motion of an own mesh."""

MOVES = "state.server?.characters.length === 1 && studio.viewer.shown(state.character)?.moment"


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    with running(tmp_path_factory.mktemp("studio")) as running_studio:
        yield running_studio


@pytest.fixture(scope="module")
def horse(tmp_path_factory):
    """The winged horse as .glb."""
    folder = tmp_path_factory.mktemp("horse")
    prepare("pegasus", folder)
    return folder / "pegasus.glb"


@pytest.fixture(scope="module")
def window(studio, browser, horse):
    """A window whose empty page was given the winged horse, which then moves."""
    opened = studio.open(browser)
    opened.until("state.connected === 'open' && state.server")
    with opened.page.expect_file_chooser() as chooser:
        opened.button("Choose a 3D file…").click()
    chooser.value.set_files(horse)
    opened.until(MOVES)
    opened.idle()
    yield opened
    opened.close()


def test_an_own_mesh_moves_after_at_most_six_clicks_and_the_page_says_what_is_unclear(window):
    assert window.page.evaluate("window.clicks") <= MAX_CLICKS
    first = window.page.locator(".viewer").screenshot()
    before = window.positions()
    window.until(f"Math.abs(studio.viewer.shown('pegasus').positions[0] - {before[0, 0]}) > 1e-4")
    assert window.page.locator(".viewer").screenshot() != first
    note = window.page.get_by_text(window.state("server.characters")[0]["notes"][0])
    assert not note.is_visible()
    window.page.get_by_text("What Puppetline guessed").click()
    assert note.is_visible()
    window.page.get_by_text("What Puppetline guessed").click()


OVERLAPS = """() => {
  const shown = [...document.querySelectorAll("header button, header select, .strip button, .drawers button")].filter(
    (each) => each.checkVisibility() && !each.closest(".dialog"));
  const boxes = shown.map((each) => [each.innerText || each.ariaLabel, each.getBoundingClientRect()]);
  const before = (low, high) => low <= high + 1;
  const apart = (a, b) => before(a.right, b.left) || before(b.right, a.left) ||
    before(a.bottom, b.top) || before(b.bottom, a.top);
  return boxes.flatMap(([name, a], index) => [
    ...(a.left < 0 || a.right > innerWidth || a.bottom > innerHeight ? [name + " is outside"] : []),
    ...boxes.slice(index + 1).filter(([, b]) => !apart(a, b)).map(([other]) => name + " is over " + other),
  ]);
}"""
"""JavaScript: the controls that overlap each other or the edge of the window."""


def test_the_film_fits_each_window_and_a_dragged_character_stays_where_it_is_put(studio, browser, window):
    film = studio.open(browser, face="film", viewport={"width": 1920, "height": 1080})
    film.until(f"{MOVES} && state.portraits.pegasus")
    for width, height in ((1920, 1080), (820, 1180), (390, 844)):
        film.page.set_viewport_size({"width": width, "height": height})
        assert film.page.evaluate(OVERLAPS) == []
        assert film.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    film.page.set_viewport_size({"width": 1280, "height": 720})
    place = "state.server.film.scene.character[0].position"
    before = film.until(place)
    box = film.page.locator(".overlay").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    film.drag((x, y), (x + 80, y))
    moved = film.until(f"{place}[0] > {before[0]} + 0.1 && {place}")
    film.until(f"Math.abs(studio.viewer.figures.get('pegasus').group.position.x - {moved[0]}) < 1e-6")
    film.page.keyboard.press("Control+z")
    film.until(f"{place}[0] === {before[0]}")
    film.close()


PLAYED = """() => {
  const look = () => {
    window.played = (studio.state().server.timeline?.takes.length ?? 0) > 0;
    if (!window.played) setTimeout(look);
  };
  look();
}"""
"""Remember that a take has played, which on a busy machine may be over before it is asked for."""


def test_a_narrow_page_opens_its_side_panels_records_and_plays(studio, browser, window):
    narrow = studio.open(browser, viewport={"width": 820, "height": 1180}, has_touch=True)
    narrow.until(MOVES)
    assert narrow.page.evaluate(OVERLAPS) == []
    narrow.page.set_viewport_size({"width": 390, "height": 844})
    assert narrow.page.evaluate(OVERLAPS) == []
    for shown in (True, False):
        narrow.button("Performer").click()
        assert narrow.button("Start from this pose").is_visible() == shown
    narrow.button("Record").click()
    narrow.until("state.server.recording && !state.count")
    narrow.frames(60)
    narrow.button("Stop recording").click()
    narrow.until("state.server.takes.length === 1 && !state.server.recording")
    narrow.page.evaluate(PLAYED)
    narrow.button("Play").click()
    narrow.until("window.played")
    assert narrow.page.evaluate(OVERLAPS) == []
    assert narrow.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    narrow.close()


def test_a_service_that_is_killed_starts_again_and_nothing_is_lost(studio, window):
    before = window.puppet
    restarts = window.state("server.service.restarts")
    (service,) = [child for child in psutil.Process(studio.pid).children(recursive=True) if "serve" in child.cmdline()]
    service.kill()
    window.until(f"state.server.service.restarts > {restarts} && state.server.service.running")
    window.until(f"{MOVES} && state.server.characters[0].state === 'performing'")
    frame = window.until("studio.viewer.moment(state.character).later")
    window.until(f"studio.viewer.moment(state.character).later !== {frame}")
    assert window.puppet == before


def test_axe_finds_no_serious_violation(studio, browser, window):
    other = studio.open(browser)
    other.until("studio.viewer.has(state.character) && state.puppets[state.character]")
    checked = {}

    def check(state):
        for scheme, rules in (("light", RULES), ("dark", ["color-contrast"])):
            other.page.emulate_media(color_scheme=scheme)
            checked[state, scheme] = violations(other.page, rules)

    other.button("Film").click()
    for tab in ("Scene", "Character"):
        other.tab(tab)
        check(tab)
    other.button("Keys").click()
    check("keys")
    other.page.keyboard.press("Escape")
    other.button("Workshop").click()
    check("list")
    other.page.locator(".panel button.line").first.click()
    check("part")
    other.tab("Motion")
    other.until("state.preview")
    check("motion")
    other.tab("Takes")
    other.page.locator(".panel").get_by_role("button", name="Trot and rear", exact=True).click()
    check("takes")
    other.button("Change…").click()
    other.until("state.sources")
    check("sources")
    other.page.get_by_label("Character", exact=True).select_option(label="Open another…")
    check("empty")
    assert checked == {key: [] for key in checked}
    other.close()


def test_a_browser_without_3d_is_told_what_it_needs(studio, browser, window):
    context = browser.new_context()
    context.set_default_timeout(1000 * TIMEOUT_SECONDS)
    context.add_init_script("HTMLCanvasElement.prototype.getContext = () => null;")
    page = context.new_page()
    page.goto(studio.last_address)
    page.get_by_role("alert").get_by_text("The studio needs WebGL 2.").wait_for()
    context.close()


def test_a_recording_that_is_dropped_on_the_page_performs(window, take):
    """This is the last test: the recording ends."""
    held = window.page.evaluate_handle(
        "(text) => { const held = new DataTransfer(); held.items.add(new File([text], 'take.log')); return held; }",
        take.read_text(),
    )
    hint = window.page.get_by_text("Drop the file to open it")
    for event, state in (("dragover", "visible"), ("drop", "detached")):
        window.page.dispatch_event("body", event, {"dataTransfer": held})
        hint.wait_for(state=state)
    window.until("state.server.source.kind === 'upload' && state.server.source.name === 'take.log'")
