"""The page of `puppetline studio` in a browser: from an empty page to an exported file, and what goes wrong."""

import gzip
import re
import time

import numpy as np
import psutil
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.recording import Recorder
from capture.skeleton import SkeletonFrame
from engine_bridge.character.examples import prepare

from ...conftest import ROOT, missing
from .page_driver import TIMEOUT_SECONDS, Window, running

pytestmark = pytest.mark.slow

PAGE = ROOT / "engine_bridge" / "studio" / "page"

MAX_PAGE_BYTES = 400_000
"""Maximum size of the page as gzip sends it."""

MAX_CLICKS = 6
"""Maximum number of clicks from the empty page to the first motion of an own mesh."""

RECORDED_SECONDS = 3


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
        opened.button("Choose a mesh…").click()
    chooser.value.set_files(horse)
    opened.until("state.server.characters.length === 1 && studio.viewer.shown(state.character)?.moment")
    opened.idle()
    yield opened
    opened.close()


def test_an_own_mesh_moves_after_at_most_six_clicks(window):
    assert window.page.evaluate("window.clicks") <= MAX_CLICKS
    assert window.state("server.source.kind") == "example"
    before = window.page.evaluate("studio.viewer.shown('pegasus').positions[0]")
    first = window.page.locator(".viewer").screenshot()
    window.until(f"Math.abs(studio.viewer.shown('pegasus').positions[0] - ({before})) > 1e-4")
    assert window.page.locator(".viewer").screenshot() != first


def test_the_proposal_says_what_is_unclear(window):
    notes = window.state("server.characters")[0]["notes"]
    assert notes
    assert not window.page.get_by_text(notes[0]).is_visible()
    window.page.get_by_text("What Puppetline guessed").click()
    for note in notes:
        assert window.page.get_by_text(note).is_visible()
    window.page.get_by_text("What Puppetline guessed").click()


def test_record_export_and_download_what_convert_makes_of_the_take(studio, window, horse, commands, tmp_path, request):
    before = time.monotonic()
    record(window, RECORDED_SECONDS)
    window.until("state.recording?.kind === 'take'")
    (take,) = window.until("state.server.takes.length === 1 && state.server.takes")
    assert RECORDED_SECONDS - 1 < take["seconds"] < time.monotonic() - before

    window.button("Export").click()
    window.until("state.exported")
    assert "of a new skeleton" in window.page.locator(".exported pre").inner_text()
    offer = window.page.get_by_role("button", name=re.compile("^Download "))
    shown = offer.bounding_box()
    assert shown["y"] + shown["height"] <= window.page.viewport_size["height"]  # without scrolling
    with window.page.expect_download() as download:
        offer.click()
    exported = tmp_path / "exported.glb"
    download.value.save_as(exported)

    with window.page.expect_download() as download:
        window.button("Save the character").click()
    download.value.save_as(tmp_path / "pegasus.toml")
    mesh = re.search(r'mesh = "([^"]+)"', (tmp_path / "pegasus.toml").read_text())
    (tmp_path / mesh[1]).write_bytes(horse.read_bytes())
    (log,) = (studio.folder / "takes").glob(f"{take['name']}*")
    puppet, converted = tmp_path / "pegasus.toml", tmp_path / "converted.glb"
    result = commands.run("convert", log, "--puppet", puppet, "-o", converted)
    assert result.returncode == 0, result.stderr
    assert exported.read_bytes() == converted.read_bytes()
    request.getfixturevalue("assert_valid_gltf")(exported)


def test_a_take_is_played_trimmed_in_a_loop_and_deleted(window):
    window.tab("Takes")
    take = window.state("server.takes")[0]["name"]
    window.page.locator(".panel button.line", has_text="Take 1").first.click()
    window.page.locator(".panel summary").click()
    window.page.get_by_label("From second", exact=True).fill("0.5")
    window.page.get_by_label("To second", exact=True).fill("1.5")
    window.page.get_by_label("To second", exact=True).press("Tab")
    window.page.get_by_label("Loop").uncheck()
    window.page.get_by_label("Loop").check()
    window.button("Use as the performer").click()
    window.until("state.server.source.kind === 'take'")
    source = window.state("server.source")
    assert (source["name"], source["start"], source["stop"], source["loop"]) == (take, 0.5, 1.5, True)
    window.idle()
    window.page.locator(".panel").get_by_role("button", name="Trot and rear", exact=True).click()
    window.page.get_by_label("Format").select_option("morph")
    window.button("Use as the performer").click()
    window.until("state.server.source.name === 'rear'")
    window.idle()
    window.page.locator(".panel button.line", has_text="Take 1").first.click()
    window.button("Delete Take 1 for ever").click()
    window.until("state.server.takes.length === 0")


def walk_again(window):
    """Choose the example that walks as the performer."""
    window.button("Change…").click()
    window.page.locator(".sources").get_by_role("button", name="Walk", exact=True).click()
    window.until("state.server.source.name === 'walk'")
    window.idle()


def open_recording(window, path):
    """Choose a file as the performer."""
    window.button("Change…").click()
    with window.page.expect_file_chooser() as chooser:
        window.button("Open a recording…").click()
    chooser.value.set_files(path)


def test_sources_are_listed_and_chosen(window, standing_log):
    window.button("Change…").click()
    window.until("state.sources")
    assert window.page.get_by_text("OSC").count() > 0
    window.button("Look again").click()
    window.until("state.sources")
    window.button("Use my webcam").click()
    window.until("state.server.source.uri === 'camera:0' && state.server.performers.length === 1")
    window.idle()
    open_recording(window, standing_log)
    window.until("state.server.source.kind === 'upload'")
    window.idle()
    walk_again(window)
    window.button("Change…").click()
    window.button("‹ Back to the figure").click()
    assert window.page.locator(".figure .joint").count() == 20


def test_a_recording_that_is_dropped_on_the_page_performs(window, standing_log):
    held = window.page.evaluate_handle(
        "([name, text]) => { const held = new DataTransfer(); held.items.add(new File([text], name)); return held; }",
        [standing_log.name, standing_log.read_text()],
    )
    window.page.dispatch_event("body", "dragover", {"dataTransfer": held})
    hint = window.page.get_by_text("Drop the file to open it")
    hint.wait_for()
    window.page.dispatch_event("body", "drop", {"dataTransfer": held})
    hint.wait_for(state="detached")
    window.until("state.server.source.kind === 'upload' && state.server.source.name === 'rear.txt'")
    window.idle()
    walk_again(window)


@pytest.fixture
def standing_log(tmp_path):
    """A recording in the format of UTKinect-Action3D: a performer who raises a hand."""
    clip = PERFORMANCES["rear"]()
    rows = [
        " ".join([str(frame + 1), *(f"{x:.5f}" for x in np.nan_to_num(positions).ravel())])
        for frame, positions in enumerate(clip.positions)
    ]
    path = tmp_path / "rear.txt"
    path.write_text("\n".join(rows) + "\n")
    return path


def test_a_source_without_pictures_says_so_and_the_performer_is_calibrated(window):
    window.button("Show what the sensor sees").click()
    window.until("state.look?.performers.length === 1")
    window.page.get_by_text("This source has no images.").wait_for()
    assert window.page.locator(".look").get_by_text(re.compile(r"^user \d+: \d+ of 20 joints tracked")).count() == 1
    window.button("Hide what the sensor sees").click()
    window.until("state.look === null && !state.looking")
    window.button("Start from this pose").click()
    window.idle()


@pytest.fixture
def two_performers(tmp_path):
    """A recording of two performers who walk beside each other and stay in view, which keeps a choice between them."""
    path = tmp_path / "two.log"
    frames = [frame for frame in PERFORMANCES["walk"]().frames() if frame.time < 5.5]  # later, tracking fails
    with Recorder(path) as recorder:
        for turn in range(60):  # at the end of a recording, performers are assigned anew
            for frame in frames:
                moment = turn * (frames[-1].time + 1 / 30) + frame.time
                for user in (1, 2):
                    moved = frame.positions + np.array([user - 1.5, 0.0, 0.0])
                    recorder.write(SkeletonFrame(moment, user, moved, frame.confidence))
    return path


def test_a_performer_in_view_is_chosen_for_the_character_and_the_recording_deleted(window, two_performers):
    open_recording(window, two_performers)
    playing = "state.server.performers.find(({ character }) => character === 'pegasus')?.user"
    first = window.until(f"state.server.source.name === 'two.log' && state.server.performers.length === 2 && {playing}")
    window.idle()
    window.button(f"Choose performer {3 - first}").click()
    window.until(f"{playing} === {3 - first}")
    window.button("Choose the performer automatically").click()
    window.idle()
    window.button("Change…").click()
    window.until("state.sources")
    for port in ("osc:7110", "vmc:39539"):
        window.page.locator(".sources").get_by_text("Details").click()
        window.button(f"Use {port}").click()
        window.until(f"state.server.source.uri === '{port}'")
        window.page.get_by_text(f"No performer is in view of {port}.").wait_for()
        window.idle()
        window.button("Change…").click()
        window.until("state.sources")
    window.page.locator(".sources").get_by_role("button", name="two.log").click()
    window.until("state.server.source.name === 'two.log'")
    window.idle()
    window.tab("Takes")
    window.page.locator(".panel button.line", has_text="two.log").click()
    window.button("Delete recording two.log").click()
    assert "found a recording that is playing now" in window.until("state.notice?.text")
    window.button("Dismiss").click()
    walk_again(window)
    window.page.locator(".panel button.line", has_text="two.log").click()
    window.button("Delete recording two.log").click()
    window.until("!state.server.uploads.some(({ name }) => name === 'two.log')")
    window.idle()


def test_an_export_that_is_cancelled_leaves_no_file(window):
    window.tab("Takes")
    window.page.locator(".panel").get_by_role("button", name="Kung fu", exact=True).click()
    files = len(window.state("server.files"))
    window.page.get_by_label("Format").select_option("frames")  # takes longest
    window.button("Export").click()
    window.page.get_by_role("button", name="Cancel: Export of kung_fu for pegasus").click()
    assert "found a job that was cancelled" in window.until("state.notice?.text")
    window.button("Dismiss").click()
    assert window.state("server.jobs").pop()["state"] == "cancelled"
    assert len(window.state("server.files")) == files


OVERLAPS = """() => {
  const shown = [...document.querySelectorAll("header button, header select, .strip button, .drawers button")].filter(
    (each) => each.checkVisibility() && !each.closest("dialog"));
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


@pytest.mark.parametrize("size", [(820, 1180), (390, 844)], ids=["tablet in portrait", "phone"])
def test_a_narrow_page_calibrates_records_and_plays(studio, browser, window, size):
    narrow = studio.open(browser, viewport={"width": size[0], "height": size[1]}, has_touch=True)
    narrow.until("state.server?.characters.length === 1 && studio.viewer.shown(state.character)?.moment")
    assert narrow.page.evaluate(OVERLAPS) == []
    narrow.button("Performer").click()
    narrow.button("Start from this pose").click()
    narrow.idle()
    narrow.button("Performer").click()
    record(narrow, 1)
    narrow.button("Play").click()
    narrow.until("state.server.timeline?.takes.length")
    assert narrow.page.evaluate(OVERLAPS) == []
    assert narrow.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    narrow.close()


def test_a_reload_keeps_everything(window):
    before = window.puppet
    window.page.reload()
    window.until("state.server?.characters.length === 1 && studio.viewer.shown(state.character)?.moment")
    assert window.puppet == before


def test_two_windows_see_the_same(studio, browser, window):
    other = studio.open(browser)
    other.until("studio.viewer.shown(state.character)?.moment && state.puppets[state.character]")
    assert other.puppet == window.puppet
    window.tab("Motion")
    window.page.get_by_label("Hands meet").click()
    window.idle()
    changed = window.puppet["retarget"]["hands_meet"]
    other.until(f"state.puppets[state.character].present.retarget.hands_meet === {str(changed).lower()}")
    other.close()


def test_a_service_that_is_killed_starts_again_and_nothing_is_lost(studio, window):
    before = window.puppet
    restarts = window.state("server.service.restarts")
    (service,) = [child for child in psutil.Process(studio.pid).children(recursive=True) if "serve" in child.cmdline()]
    service.kill()
    window.until(f"state.server.service.restarts > {restarts}")
    window.until("state.server.service.running")
    frame = window.until("studio.viewer.shown(state.character)?.moment?.later")
    window.until(f"studio.viewer.shown(state.character)?.moment?.later !== {frame}")
    assert window.puppet == before


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_no_serious_violation(studio, browser, window, scheme):
    axe = PAGE / "node_modules" / "axe-core" / "axe.min.js"
    if not axe.is_file():
        missing("browser", "axe-core is not installed (make lint)")
    other = studio.open(browser, color_scheme=scheme)
    other.until("studio.viewer.has(state.character) && state.puppets[state.character]")
    other.page.evaluate(axe.read_text(encoding="utf-8") + "; null")
    checked = {}

    def check(state):
        report = other.page.evaluate("axe.run({ runOnly: ['wcag2a', 'wcag2aa', 'wcag21aa', 'wcag22aa'] })")
        serious = [each for each in report["violations"] if each["impact"] in ("serious", "critical")]
        checked[state] = [(each["id"], [node["target"] for node in each["nodes"]]) for each in serious]

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


def record(window, seconds):
    """Record a take with the button, and return its name."""
    before = [each["name"] for each in window.state("server.takes")]
    window.button("Record").click()
    window.until("state.server.recording && !state.count")
    window.page.wait_for_timeout(1000 * seconds)
    window.button("Stop recording").click()
    takes = window.until(f"state.server.takes.length > {len(before)} && !state.server.recording && state.server.takes")
    (name,) = {each["name"] for each in takes} - set(before)
    return name


def test_the_page_is_small():
    files = [path for path in (PAGE / "dist").rglob("*") if path.is_file()]
    assert sum(len(gzip.compress(path.read_bytes())) for path in files) <= MAX_PAGE_BYTES


def test_a_window_makes_an_address_for_another(browser, window):
    window.button("Another window…").click()
    text = window.until("state.notice?.level === 'info' && state.notice.text")
    window.button("Dismiss").click()
    other = Window(browser.new_context(), re.search(r"http://\S+", text)[0])
    other.until("state.connected === 'open' && state.server")
    other.close()


def test_a_window_without_a_valid_token_is_told_what_to_do(studio, browser):
    context = browser.new_context()
    context.set_default_timeout(1000 * TIMEOUT_SECONDS)
    page = context.new_page()
    page.goto(re.sub("token=.*", "token=wrong", studio.last_address))
    page.get_by_role("alert").get_by_text("Open the address").wait_for()
    context.close()


def test_a_browser_without_3d_is_told_what_it_needs(studio, browser):
    context = browser.new_context()
    context.set_default_timeout(1000 * TIMEOUT_SECONDS)
    context.add_init_script("HTMLCanvasElement.prototype.getContext = () => null;")
    page = context.new_page()
    page.goto(studio.last_address)
    page.get_by_role("alert").get_by_text("The studio needs WebGL 2.").wait_for()
    context.close()
