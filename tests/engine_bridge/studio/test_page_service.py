"""The page of a studio that has joined a service: a camera's picture, mapping and recording."""

import json
import os
import re
import subprocess
import sys

import pytest

from ..service.conftest import free_port
from .page_driver import CAMERA, Window, running

__all__ = ["free_port"]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def studio(blob_puppet, free_port, tmp_path_factory):
    """A studio that has joined a service with a camera."""
    port = free_port()
    command = [sys.executable, "-m", "puppetline", "serve", "--puppet", blob_puppet, "--source", "camera:0"]
    environment = os.environ | CAMERA | {"XDG_STATE_HOME": str(tmp_path_factory.mktemp("state"))}
    given = ["--port", port, "--no-announce", "--calibrate", "at_once", "--takes", tmp_path_factory.mktemp("takes")]
    service = subprocess.Popen([*map(str, [*command, *given])], env=environment, stderr=subprocess.DEVNULL)
    with running(None, "--service", f"127.0.0.1:{port}") as running_studio:
        yield running_studio
    service.terminate()
    service.wait(60)


@pytest.fixture(scope="module")
def window(studio, browser):
    opened = studio.open(browser)
    opened.until("state.server?.characters.length === 1 && studio.viewer.shown(state.character)?.moment")
    opened.until("state.puppets[state.character]")
    opened.idle()
    yield opened
    opened.close()


def test_the_cameras_picture_is_shown_with_the_joints_over_it(window):
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
    window.until("!state.looking")
    assert window.page.locator(".sensor").count() == 0


def test_a_handle_of_the_service_is_mapped_and_what_its_files_decide_is_locked(window):
    window.page.locator(".panel button.line", has_text="left hand").click()
    assert window.page.get_by_label("Name").is_disabled()
    assert window.page.get_by_label("Place, x").is_disabled()
    window.page.get_by_label("What moves it").select_option("head")
    window.idle()
    window.until("state.server.characters[0].saved === false")
    assert window.handle("left hand")["joint"] == "head"
    window.button("Undo").click()
    window.idle()
    assert window.handle("left hand")["joint"] == "hand_left"
    for name in ("Open another…", "Change…", "+ Limb", "+ Handle", "Export"):
        assert window.button(name).count() == 0
    window.tab("Motion")
    assert window.page.get_by_label("How smooth?").is_disabled()
    window.page.get_by_label("Like a mirror").check()
    window.idle()
    window.until("state.server.characters[0].mirror")
    window.page.get_by_label("Like a mirror").uncheck()
    window.idle()


def test_a_take_is_recorded_in_the_services_folder(window):
    window.button("Record").click()
    take = window.until("!state.count && state.server.recording")
    window.button("Stop recording").click()
    window.until(f"state.server.takes.some(({{ name }}) => name === {take!r})")
    window.tab("Takes")
    window.page.get_by_text("Takes are in the folder of the service").wait_for()


def test_a_kiosk_s_visitor_sees_the_code_of_the_video(studio, browser):
    clips = []

    def connect(socket):
        server = socket.connect_to_server()

        def pass_on(text):
            message = json.loads(text)
            if "state" in message:
                message["state"]["clips"] = clips
            socket.send(json.dumps(message))

        server.on_message(pass_on)

    context = browser.new_context(viewport={"width": 1280, "height": 720})
    context.route_web_socket(re.compile("/api$"), connect)
    opened = Window(context, studio.address())
    opened.until("state.server?.characters.length === 1")
    assert opened.page.locator(".offer").count() == 0
    clips[:] = [{"code": "K7M2QX", "minutes": None}]
    opened.page.get_by_text("Your film is being made").wait_for()
    clips[:] = [{"code": "K7M2QX", "minutes": 10}]
    opened.page.get_by_text("K7M2QX", exact=True).wait_for()
    assert opened.page.locator(".offer video").get_attribute("src") == "/clips/K7M2QX"
    assert f"{opened.page.evaluate('location.host')}/clips" in opened.page.locator(".offer").inner_text()
    opened.context.close()
