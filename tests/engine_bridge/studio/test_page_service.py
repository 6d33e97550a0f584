"""The page of a studio that has joined a service: a camera's picture, mapping and recording."""

import os
import subprocess
import sys

import pytest

from ..service.conftest import free_port
from .page_driver import CAMERA, running

__all__ = ["free_port"]

pytestmark = pytest.mark.slow


@pytest.fixture
def window(blob_puppet, free_port, tmp_path, browser):
    """A window of a studio that has joined a service with a camera."""
    port = free_port()
    command = [sys.executable, "-m", "puppetline", "serve", "--puppet", blob_puppet, "--source", "camera:0"]
    given = ["--port", port, "--no-announce", "--calibrate", "at_once", "--takes", tmp_path / "takes"]
    environment = os.environ | CAMERA | {"XDG_STATE_HOME": str(tmp_path)}
    service = subprocess.Popen([*map(str, [*command, *given])], env=environment, stderr=subprocess.DEVNULL)
    with running(None, "--service", f"127.0.0.1:{port}") as studio:
        opened = studio.open(browser)
        opened.until("state.server?.characters.length === 1 && studio.viewer.shown(state.character)?.moment")
        opened.until("state.puppets[state.character]")
        opened.idle()
        yield opened
        opened.close()
    service.terminate()
    service.wait(60)


def test_a_joined_service_shows_its_camera_is_mapped_and_records_on_its_machine(window, tmp_path):
    window.button("Show what the sensor sees").click()
    window.until("state.look?.picture && state.look.performers.length === 1")
    picture = window.page.locator(".sensor img")
    picture.wait_for()
    size = "each => Object.assign(new Image(), { src: each.src })"  # a copy: the page soon shows the next picture
    size += ".decode().then(() => [each.naturalWidth, each.naturalHeight])"
    assert picture.evaluate(size) == [640, 480]
    # A joint that leaves the picture is not drawn for that time.
    drawn = "['circle', 'line'].map((each) => document.querySelectorAll(`.sensor ${each}`).length)"
    window.until(f"String({drawn}) === '20,19'")
    frame = picture.bounding_box()
    head = window.page.locator(".sensor circle").nth(3).bounding_box()
    assert frame["x"] < head["x"] < frame["x"] + frame["width"]
    assert frame["y"] < head["y"] < frame["y"] + frame["height"] / 2
    first = window.state("look.picture")
    window.until(f"state.look?.picture && state.look.picture !== {first!r}")
    window.button("Hide what the sensor sees").click()

    window.page.locator(".panel button.line", has_text="left hand").click()
    before = window.puppet
    window.page.get_by_label("What moves it").select_option("head")
    window.edited(before)
    window.until("state.server.characters[0].saved === false")
    assert window.handle("left hand")["joint"] == "head"
    window.button("Undo").click()
    window.idle()
    assert window.puppet == before

    window.button("Record").click()
    take = window.until("!state.count && state.server.recording")
    window.button("Stop recording").click()
    window.until(f"state.server.takes.some(({{ name }}) => name === {take!r})")
    assert (tmp_path / "takes" / f"{take}.log").is_file()
