"""Meters of the performer's channels in a browser: they move, are mapped by clicks, and learn the performer's range."""

import json
import socket
import threading
import time

import numpy as np
import pytest

from capture.network.osc import bundle, encode
from capture.skeleton import JOINTS

from .page_driver import running

pytestmark = pytest.mark.slow

NAMES = {"shoulder_center": "Neck", "spine": "Torso", "hip_center": "Pelvis"}


@pytest.fixture
def sent(standing):
    """Send a performer who stands still: the port, and the values of channels, which a test changes."""
    places = (standing * [-1, 1, -1]).astype(np.float32)
    named = [NAMES.get(joint, "_".join(joint.title().split("_")[::-1])) for joint in JOINTS]
    body = bundle(*(encode(f"/{name}", place) for name, place in zip(named, places, strict=True)))
    channels, stop = {}, threading.Event()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free, socket.socket(type=socket.SOCK_DGRAM) as sender:
        free.bind(("127.0.0.1", 0))
        to = free.getsockname()
        free.close()

        def send():
            while not stop.wait(1 / 30):
                values = [encode("/puppetline/channel", *each) for each in list(channels.items())]
                sender.sendto(bundle(*values, body, encode("/NI_mate_sync", 1)), to)

        thread = threading.Thread(target=send, daemon=True)
        thread.start()
        yield to[1], channels
        stop.set()
        thread.join()


@pytest.fixture
def window(sent, talking, browser, tmp_path):
    """A window with a figure that has a morph target, and with the sender's performer."""
    source = {"kind": "live", "name": f"osc:{sent[0]}"}
    (tmp_path / "session.json").write_text(json.dumps({"source": source}))
    with running(tmp_path, talking(limbs=True)) as studio:
        opened = studio.open(browser)
        opened.until("state.puppets[state.character] && state.server.characters[0].state === 'performing'")
        opened.idle()
        yield opened
        opened.close()


def meter(window, name):
    return window.page.locator("button.meter", has_text=name).first


def filled(window, name):
    """Return the share of a meter that is filled."""
    return meter(window, name).evaluate("(m) => parseFloat(m.querySelector('.fill').style.width) / 100")


def wait_until(window, condition):
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        window.page.wait_for_timeout(50)


def test_meters_are_mapped_by_clicks_and_learn_how_far_the_performers_mouth_opens(window, sent):
    _, channels = sent
    channels |= {"mouth_open": 0.125, "blink_left": 0.5, "index_2_left": 0.25}
    wait_until(window, lambda: filled(window, "left blink") == pytest.approx(0.5, abs=0.01))
    assert filled(window, "mouth open") == pytest.approx(0.125, abs=0.01)
    assert filled(window, "smile") == 0
    window.page.get_by_text("Joints of fingers").click()
    wait_until(window, lambda: filled(window, "left index 2") == pytest.approx(0.25, abs=0.01))

    # a meter, then a morph target, and a target, then a meter
    meter(window, "mouth open").click()
    window.page.get_by_text("Click the limb, handle or morph target").wait_for()
    window.page.locator(".panel button.line", has_text="jaw").click()
    window.idle()
    assert [(each["target"], each["channel"]) for each in window.puppet["morph"]] == [
        ("jaw", "voice"),
        ("jaw", "mouth_open"),
    ]
    window.page.locator(".panel button.line", has_text="jaw").click()
    meter(window, "smile").click()
    window.idle()
    window.page.get_by_label("Gain of smile").fill("0.5")
    window.page.get_by_label("Gain of smile").press("Tab")
    window.button("Remove voice from jaw").click()
    window.idle()
    assert [(each["channel"], each["gain"]) for each in window.puppet["morph"]] == [("mouth_open", 1), ("smile", 0.5)]

    # a meter, then a limb
    meter(window, "left blink").click()
    window.page.locator(".panel button.line", has_text="head").first.click()
    window.idle()
    assert window.limb("head")["bend"] == {"channel": "blink_left", "degrees": 20.0, "axis": "x"}
    window.page.get_by_label("Bends about").select_option("-z")
    window.idle()
    assert window.limb("head")["bend"]["axis"] == "-z"
    window.page.get_by_label("Bent by").select_option("")
    window.idle()
    assert window.limb("head")["bend"] is None
    window.page.keyboard.press("Escape")

    # a meter, then a handle
    meter(window, "brow up").click()
    window.page.locator(".panel button.line", has_text="hump").click()
    window.idle()
    window.page.get_by_label("Way, x").fill("0.05")
    window.page.get_by_label("Way, x").press("Tab")
    window.idle()
    [hump] = window.puppet["handle"]
    assert (hump["channel"], hump["moves"]) == ("brow_up", [0.05, 0.1, 0.0])
    window.page.keyboard.press("Escape")

    # the range: closed for a second, then open for a second
    meter(window, "mouth open").click()
    window.button("Measure my range").click()
    window.page.get_by_text("Close your mouth, and hold it for a second.").wait_for()
    window.page.get_by_text("Open your mouth wide, and hold it for a second.").wait_for()
    channels["mouth_open"] = 0.625
    window.until("state.puppets[state.character].present.channel.length === 1")
    window.page.get_by_text("Your range of mouth open is measured").wait_for()
    (found,) = window.puppet["channel"]
    assert found == {"name": "mouth_open", "neutral": pytest.approx(0.125), "full": pytest.approx(0.625)}
    for value, share in ((0.625, 1.0), (0.375, 0.5), (0.0, 0.0)):
        channels["mouth_open"] = value
        wait_until(window, lambda share=share: filled(window, "mouth open") == pytest.approx(share, abs=0.01))
    character = window.state("character")
    frame = f"studio.viewer.moment({json.dumps(character)})?.earlier"
    window.until(f"{frame} > {window.page.evaluate(frame) + 15}")  # what the meter shows is drawn too
    rest = np.reshape(window.page.evaluate("(name) => [...studio.viewer.positions(name)]", character), (-1, 3))
    channels["mouth_open"] = 0.625

    def dropped():
        now = window.page.evaluate("(name) => [...studio.viewer.positions(name)]", character)
        return (rest - np.reshape(now, (-1, 3)))[rest[:, 1] > 1.7, 1].mean()

    wait_until(window, lambda: dropped() > 0.12)  # more than half of the way
    with window.page.expect_download() as download:
        window.button("Save the character").click()
    text = download.value.path().read_text()
    assert '[[channel]]\nname = "mouth_open"\n' in text
    assert 'channel = "smile"\ngain = 0.5\n' in text
    meter(window, "mouth open").click()
    window.button("Use the usual range").click()
    window.idle()
    assert window.puppet["channel"] == []
