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

SENDERS_NAMES = {"shoulder_center": "Neck", "spine": "Torso", "hip_center": "Pelvis"}

PERIOD_SECONDS = 1 / 30


class Sender:
    """A program that sends a performer who stands still, and channels."""

    def __init__(self, standing):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.channels = {}
        self._body = bundle(
            *(
                encode(f"/{_name(joint)}", place)
                for joint, place in zip(JOINTS, (standing * [-1, 1, -1]).astype(np.float32), strict=True)
            ),
            encode("/NI_mate_sync", 1),
        )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._send, daemon=True)
        self._thread.start()

    def _send(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not self._stop.wait(PERIOD_SECONDS):
                for name, value in list(self.channels.items()):
                    sender.sendto(encode("/puppetline/channel", name, value), ("127.0.0.1", self.port))
                sender.sendto(self._body, ("127.0.0.1", self.port))

    def close(self):
        self._stop.set()
        self._thread.join()


def _name(joint):
    side = next((side for side in ("left", "right") if joint.endswith(side)), "")
    return f"{side}_{joint.removesuffix(f'_{side}')}".title() if side else SENDERS_NAMES.get(joint, joint.title())


@pytest.fixture
def sender(standing):
    made = Sender(standing)
    yield made
    made.close()


@pytest.fixture
def window(sender, talking, browser, tmp_path):
    """A window with a figure that has a morph target, and with the sender's performer."""
    source = {"kind": "live", "name": f"osc:{sender.port}"}
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


def test_meters_are_mapped_by_clicks_and_learn_how_far_the_performers_mouth_opens(window, sender, tmp_path):
    sender.channels = {"mouth_open": 0.125, "blink_left": 0.5, "index_2_left": 0.25}
    wait_until(window, lambda: filled(window, "left blink") == pytest.approx(0.5, abs=0.01))
    assert filled(window, "mouth open") == pytest.approx(0.125, abs=0.01)
    assert filled(window, "smile") == 0
    window.page.get_by_text("Joints of fingers").click()
    wait_until(window, lambda: filled(window, "left index 2") == pytest.approx(0.25, abs=0.01))

    # a meter, then a morph target, and a target, then a meter
    meter(window, "mouth open").click()
    window.page.get_by_text("Click the limb or morph target").wait_for()
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
    window.page.locator(".panel button.line", has_text="head").click()
    window.idle()
    assert window.limb("head")["bend"] == {"channel": "blink_left", "degrees": 20.0, "axis": "x"}
    window.page.get_by_label("Bends about").select_option("-z")
    window.idle()
    assert window.limb("head")["bend"]["axis"] == "-z"
    window.page.get_by_label("Bent by").select_option("")
    window.idle()
    assert window.limb("head")["bend"] is None
    window.page.keyboard.press("Escape")

    # the range: closed for a second, then open for a second
    meter(window, "mouth open").click()
    window.button("Measure my range").click()
    window.page.get_by_text("Close your mouth, and hold it for a second.").wait_for()
    window.page.get_by_text("Open your mouth wide, and hold it for a second.").wait_for()
    window.page.screenshot(path=str(tmp_path / "meters.png"))
    sender.channels["mouth_open"] = 0.625
    window.until("state.puppets[state.character].present.channel.length === 1")
    window.page.get_by_text("Your range of mouth open is measured").wait_for()
    (found,) = window.puppet["channel"]
    assert (found["name"], found["neutral"], found["full"]) == (
        "mouth_open",
        pytest.approx(0.125),
        pytest.approx(0.625),
    )
    for value, share in ((0.625, 1.0), (0.375, 0.5), (0.0, 0.0)):
        sender.channels["mouth_open"] = value
        wait_until(window, lambda share=share: filled(window, "mouth open") == pytest.approx(share, abs=0.01))
    character = window.state("character")
    window.until(f"studio.viewer.shown({json.dumps(character)})")
    rest = np.reshape(window.page.evaluate("(name) => [...studio.viewer.positions(name)]", character), (-1, 3))
    sender.channels["mouth_open"] = 0.625

    def dropped():
        now = window.page.evaluate("(name) => [...studio.viewer.positions(name)]", character)
        return (rest - np.reshape(now, (-1, 3)))[rest[:, 1] > 1.7, 1].mean()

    wait_until(window, lambda: dropped() == pytest.approx(0.2, abs=0.03))  # the target's whole way
    with window.page.expect_download() as download:
        window.button("Save puppet file").click()
    text = download.value.path().read_text()
    assert '[[channel]]\nname = "mouth_open"\n' in text
    assert 'channel = "smile"\ngain = 0.5\n' in text
    meter(window, "mouth open").click()
    window.button("Use the usual range").click()
    window.idle()
    assert window.puppet["channel"] == []
