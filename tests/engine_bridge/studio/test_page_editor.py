"""The page's editor in a browser, with a performer whom another program sends: what the pointer and the keys do.

All other edits are in the page's own tests, see `test_page_modules`.
"""

import json
import shutil
import threading
from contextlib import closing

import numpy as np
import pytest

from capture.network.osc import encode

from ..service.conftest import Sender
from .page_driver import running

pytestmark = pytest.mark.slow

HINGE, CHIN = [0.0, 1.68, 0.12], [0.0, 1.66, 0.36]
"""Where the figure's jaw begins, and its tip."""

BOUNDS = "studio.viewer.bounds(studio.state().character)"
PROJECT = "(point) => studio.viewer.stage.project(studio.viewer.figures.get(studio.state().character), point)"


@pytest.fixture(scope="module")
def sent(standing, frames):
    """Send a performer who stands still: the source, and the values of channels, which a test changes."""
    (frame,), channels, stop = frames(standing[None]), {}, threading.Event()
    with closing(Sender()) as sender:

        def send():
            while not stop.wait(1 / 30):
                for each in list(channels.items()):
                    sender.raw(encode("/puppetline/channel", *each))
                sender.send(frame)

        thread = threading.Thread(target=send)
        thread.start()
        yield sender.uri, channels
        stop.set()
        thread.join()


@pytest.fixture(scope="module")
def window(sent, limbed_puppet, browser, tmp_path_factory):
    """A window with the small figure."""
    folder = tmp_path_factory.mktemp("studio")
    (folder / "session.json").write_text(json.dumps({"source": {"kind": "live", "name": sent[0]}}))
    for file in (limbed_puppet, limbed_puppet.with_name("blob.glb")):
        shutil.copy(file, folder)
    with running(folder, folder / limbed_puppet.name) as studio:
        opened = studio.open(browser)
        opened.until("state.puppets[state.character] && studio.viewer.shown(state.character)?.moment")
        opened.idle()
        yield opened
        opened.close()


@pytest.fixture(autouse=True)
def _list(window):
    """Begin with the list of limbs, at rest, as the file has them."""
    while window.button("Undo").is_enabled():
        window.button("Undo").click()
        window.idle()
    window.tab("Limbs")
    window.page.keyboard.press("Escape")
    window.button("Rest pose").click()
    window.button("Fit").click()
    window.idle()


def press(window, *keys):
    """Press keys; each changes the puppet."""
    for key in keys:
        before = window.puppet
        window.page.keyboard.press(key)
        window.edited(before)


def test_points_are_dragged_nudged_and_deleted_in_the_view_and_each_step_is_undone(window):
    before = window.puppet
    points, selected = window.limb("left arm")["points"], {"kind": "limb", "name": "left arm", "point": 1}
    x, y = window.place("left arm", 1)
    window.page.evaluate("window.reported = studio.state().server")
    with window.dragged((x, y), (x + 30, y - 20)):
        window.until("state.server !== reported")  # the drag is not lost by what the server reports meanwhile
    window.edited(before)
    dragged = window.limb("left arm")["points"]
    assert [dragged[0], dragged[2]] == [points[0], points[2]]
    assert window.place("left arm", 1) == pytest.approx((x + 30, y - 20), abs=2)
    assert window.state("selection") == selected

    press(window, "ArrowUp")
    assert window.limb("left arm")["points"][1][1] > dragged[1][1]
    press(window, "Delete")
    assert len(window.limb("left arm")["points"]) == 2
    press(window, "Control+z", "Control+z", "Control+z")
    assert window.puppet == before

    window.page.mouse.click(x, y)
    assert window.state("selection") == selected
    window.button("Surface").click()
    end = window.place("left arm", 2)
    window.drag((x, y), np.mean([(x, y), end], axis=0))
    window.edited(before)
    low, high = window.page.evaluate(BOUNDS)
    moved = window.limb("left arm")["points"][1]
    assert (np.less(low, moved) & np.less(moved, high)).all()
    assert points[1][0] < moved[0] < points[2][0]
    window.button("View plane").click()


def test_a_handle_and_a_mouth_are_added_by_clicks_on_the_body(window):
    before = window.puppet
    window.button("+ Handle").click()
    window.page.mouse.click(*window.place("trunk", 1))
    window.edited(before)
    low, high = window.page.evaluate(BOUNDS)
    place = window.handle("handle")["position"]
    assert window.state("selection") == {"kind": "handle", "name": "handle"}
    assert (np.less_equal(low, place) & np.less_equal(place, high)).all()
    assert place[2] > 0.1  # on the side that is seen

    before = window.puppet
    window.button("+ Mouth").click()
    box = window.page.locator(".overlay").bounding_box()
    x, y = box["x"] + 40, box["y"] + box["height"] - 40
    window.drag((x, y), (x + box["height"] / 8, y))  # an eighth of a turn, so that the arms do not hide the head
    window.place("head", 0)
    for point in (HINGE, CHIN):
        there = window.page.evaluate(PROJECT, point)
        window.page.mouse.click(box["x"] + there[0], box["y"] + there[1])
    window.edited(before)
    assert window.limb("jaw")["bend"]["channel"] == "voice"
    np.testing.assert_allclose(window.limb("jaw")["points"], [HINGE, CHIN], atol=0.02)


def test_the_view_hides_bones_zooms_fits_shows_the_motion_and_stands_the_mesh_up(window):
    window.page.get_by_label("Bones").uncheck()
    window.until("studio.viewer.places().limbs.length === 0")
    window.page.get_by_label("Bones").check()
    before = window.place("head", 1)
    box = window.page.locator(".overlay").bounding_box()
    window.page.mouse.move(box["x"] + 40, box["y"] + 40)
    window.page.mouse.wheel(0, 600)
    moved = "studio.viewer.places().limbs.find(({ name }) => name === 'head').points[1][1]"
    window.until(f"Math.abs({moved} - {before[1] - box['y']}) > 5")
    window.button("Fit").click()
    assert window.place("head", 1) == pytest.approx(before, abs=1)

    window.until("studio.viewer.moment(state.character) === null")
    window.button("Live").click()
    window.frames(2)
    window.button("Rest pose").click()
    window.until("studio.viewer.moment(state.character) === null")

    window.tab("Motion")
    height = "(([low, high]) => high.y - low.y)(Object.values(studio.viewer.boxes())[0])"
    upright = window.page.evaluate(height)
    window.page.get_by_label("Which way is up?").select_option("z")
    window.until(f"Math.abs({height} - {upright}) > 0.1")
    window.idle()
    window.button("Undo").click()
    window.until(f"Math.abs({height} - {upright}) < 1e-6")


def test_a_meter_moves_with_the_performers_mouth_and_what_is_mapped_to_it_by_clicks_is_drawn(window, sent):
    _, channels = sent
    channels |= {"mouth_open": 0.125}

    def meter_is(share):
        filled = "document.querySelector('button.meter[aria-label^=\"mouth open\"] .fill').style.width"
        window.until(f"Math.abs(parseFloat({filled}) - {100 * share}) < 1")

    meter = window.page.locator("button.meter", has_text="mouth open")
    meter_is(0.125)
    meter.click()
    window.page.locator(".panel button.line", has_text="head").first.click()
    window.idle()
    assert window.limb("head")["bend"]["channel"] == "mouth_open"
    window.page.get_by_label("degrees").fill("60")
    window.page.get_by_label("degrees").press("Tab")
    window.idle()
    window.button("Live").click()
    shown = []
    for share in (0.0, 1.0):
        channels["mouth_open"] = share
        meter_is(share)
        window.frames(30)  # what the meter shows is drawn too
        shown.append(window.positions())
    closed, opened = shown
    moved = np.linalg.norm(opened - closed, axis=1)
    assert moved[closed[:, 1] > 1.8].min() > 0.2
    assert moved[closed[:, 1] < 0].max() < 0.02
