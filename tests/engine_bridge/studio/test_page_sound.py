"""The page plays the sounds of takes in step with the images of their characters."""

import contextlib
import time

import numpy as np
import pytest
from puppetline.examples.performances import PERFORMANCES

from capture.events import Cue
from capture.recording import Recorder
from capture.skeleton import JOINTS, SkeletonFrame
from capture.sound import WavWriter

from .page_driver import TIMEOUT_SECONDS, Window, running

pytestmark = pytest.mark.slow

SECONDS = 6.0
"""Duration of the take, in seconds."""

QUIET_SECONDS = 3.0
"""Second of the take from which on the channel of the voice is 1."""

FULL_SECONDS = 10.0
"""The sound's value is its second, divided by these."""

EARLY_SECONDS = 0.25
"""Time by which the sound begins before the motion, in seconds."""

MAX_OFFSET_SECONDS = 0.02
"""Maximum difference of sound and image, in seconds."""

MEASURE = """
window.ask = (request) => new Promise((resolve) => {
  const socket = new WebSocket(`ws://${location.host}/api`);
  socket.onopen = () => socket.send(JSON.stringify({ token: sessionStorage.getItem("puppetline.session") }));
  socket.onmessage = ({ data }) => {
    const message = JSON.parse(data);
    if (message.hello) socket.send(JSON.stringify({ id: 1, ...request }));
    if (message.id !== 1) return;
    socket.close();
    resolve(message.result);
  };
});
const connect = AudioNode.prototype.connect;
AudioNode.prototype.connect = function (target) {
  window.analyser ??= new AnalyserNode(this.context, { fftSize: 256 });
  connect.call(this, window.analyser);
  return connect.call(this, target);
};
window.measure = (name, vertex) => {
  const figure = studio.viewer.figures.get(name);
  const samples = new Float32Array(256);
  figure.pose(false);
  window.analyser.getFloatTimeDomainData(samples);
  const { context } = window.analyser;
  const { contextTime, performanceTime } = context.getOutputTimestamp();
  const later = context.currentTime - contextTime - (performance.now() - performanceTime) / 1000;
  const isInTime = figure.buffer.later !== figure.buffer.earlier;
  return [...figure.positions().slice(3 * vertex, 3 * vertex + 2), samples[255], later, isInTime];
};
window.follow = async (name, vertex) => {
  const found = [];
  while (found.length < 12) {
    await new Promise((resolve) => setTimeout(resolve, 70));
    found.push(measure(name, vertex));
  }
  return found;
};
"""
"""JavaScript: `ask` sends a request; `measure` returns where a vertex is, the sample that is played, when it will be
heard, and whether the frames of this moment have arrived; `follow` returns the same of twelve moments."""


HINGE, CHIN = [0.0, 1.68, 0.12], [0.0, 1.66, 0.36]
"""Where the figure's jaw begins, and its tip."""

PROJECT = "([name, point]) => studio.viewer.stage.project(studio.viewer.figures.get(name), point)"


@pytest.fixture(scope="module")
def studio(limbed_puppet, tmp_path_factory):
    """A studio with a film of one take: an arm rises, and the sound rises with it."""
    folder = tmp_path_factory.mktemp("studio")
    (folder / "takes").mkdir()
    clip = PERFORMANCES["rear"]()
    arm = [JOINTS.index(f"{joint}_left") for joint in ("elbow", "wrist", "hand")]
    frame = next(iter(clip.frames()))
    with Recorder(folder / "takes" / "rise.log") as recorder:
        recorder.write(Cue(5.0, "sound", {"file": "rise.wav", "at": 5.0 - EARLY_SECONDS}))
        for number in range(round(30 * SECONDS) + 1):
            angle = np.pi * number / (30 * SECONDS)
            positions = frame.positions.copy()
            shoulder = positions[JOINTS.index("shoulder_left")]
            side = np.sign(shoulder[0] - positions[JOINTS.index("shoulder_right")][0])
            lengths = np.linalg.norm(positions[arm] - shoulder, axis=1)
            positions[arm] = shoulder + lengths[:, None] * [side * np.sin(angle), -np.cos(angle), 0.0]
            speaks = {"voice": float(number / 30 >= QUIET_SECONDS)}
            recorder.write(SkeletonFrame(5.0 + number / 30, 1, positions, frame.confidence, channels=speaks))
    with WavWriter(folder / "takes" / "rise.wav") as writer:
        writer.write((np.arange(48_000 * 8) / 48_000 / FULL_SECONDS).astype(np.float32))
    name = limbed_puppet.stem
    (folder / "film.toml").write_text(f'[[take]]\ncharacter = "{name}"\nfile = "takes/rise.log"\n')
    with running(folder, limbed_puppet, "--sound", folder / "takes" / "rise.wav") as running_studio:
        yield running_studio


@pytest.fixture
def window(studio, browser):
    """A window that shows the take's character."""
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    context.add_init_script(MEASURE)
    opened = Window(context, studio.address())
    opened.until("state.film.present.length === 1 && studio.viewer.shown(state.character)?.moment")
    yield opened
    opened.close()


def ask(window, do, **arguments):
    return window.page.evaluate("window.ask", {"do": do, **arguments})


def play_and_pause(window):
    """Play the take and pause it, again if a busy machine was too late and the take has ended."""
    for _ in range(10):
        window.button("Play").click()
        with contextlib.suppress(AssertionError):  # a page that draws for seconds may not have seen the take at all
            window.until("state.server.timeline?.paused === false", seconds=20)
        ask(window, "pause")
        became = "state.server.timeline === null ? 'ended' : state.server.timeline.paused && 'paused'"
        if window.until(became) == "paused":
            return
    raise AssertionError("never: paused before its end")


def places(window, name, second):
    """Return the places of all vertices when the take stands at a second."""
    ask(window, "seek", seconds=second)
    before = None
    for _ in range(100):
        window.page.wait_for_timeout(600)
        now = window.page.evaluate("(name) => [...studio.viewer.positions(name)]", name)
        if now == before:
            return np.reshape(now, (-1, 3))
        before = now
    raise AssertionError(f"never: {name} stands still")


def test_the_sound_of_a_take_is_in_step_with_its_image_after_a_jump_and_a_pause_silences_it(window):
    name = window.state("character")
    play_and_pause(window)
    seconds = [1.5, 2.5, 3.5, 4.5]
    shown = np.array([places(window, name, second) for second in seconds])
    vertex = int(np.ptp(shown, axis=0).sum(axis=1).argmax())
    way = shown[:, vertex, :2]
    circle = np.linalg.lstsq(np.c_[2 * way, np.ones(len(way))], (way**2).sum(axis=1))[0]  # around the shoulder

    def angle(points):
        return np.arctan2(*(points - circle[:2]).T[::-1])

    second_of = np.poly1d(np.polyfit(angle(way), seconds, 1))
    assert second_of(angle(way)) == pytest.approx(seconds, abs=0.002)
    end, off = time.monotonic() + TIMEOUT_SECONDS, np.inf
    while off > MAX_OFFSET_SECONDS:  # a machine that is busy for some seconds draws late
        assert time.monotonic() < end, off
        if window.state("server.timeline") is None:
            play_and_pause(window)
        ask(window, "seek", seconds=0.5)
        ask(window, "pause", on=False)
        window.page.wait_for_timeout(1900)  # after the easing
        found = window.page.evaluate("([name, vertex]) => follow(name, vertex)", [name, vertex])
        ask(window, "pause")
        in_time = [each for *each, is_in_time in found if is_in_time and each[2] > 0]  # before the sound's end
        if not in_time:
            continue
        x, y, sample, later = np.transpose(in_time)
        offsets = FULL_SECONDS * sample - later - EARLY_SECONDS - second_of(angle(np.c_[x, y]))
        # an image stays until the next frame, so many are late, none early
        off = abs(np.quantile(offsets, 0.25))
    window.until("!measure(state.character, 0)[2]")


def test_a_take_is_moved_in_time_by_dragging_and_by_keys_and_is_muted(window):
    def take():
        window.idle()
        ((shown,), (stored,)) = window.state("film")["present"], window.state("server")["film"]["takes"]
        assert (shown["at"], shown["mute"]) == (stored["at"], stored["mute"])
        return stored

    clip = window.page.locator(".clip-button")
    box, track = clip.bounding_box(), window.page.locator(".track").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    second = box["width"] / (take()["stop"] - take()["start"])
    window.page.mouse.move(x, y)
    window.page.mouse.down()
    window.page.mouse.move(x + 2 * second, y, steps=4)
    assert clip.bounding_box()["x"] == pytest.approx(box["x"] + 2 * second, abs=2)
    window.page.mouse.up()
    window.until("state.server.film.takes[0].at > 1")
    assert take()["at"] == pytest.approx(2.0, abs=0.1)
    assert box["x"] + 2 * second < track["x"] + track["width"]
    clip.press("ArrowLeft")
    window.until("state.server.film.takes[0].at < 1.95")
    window.button("Mute").click()
    window.until("state.server.film.takes[0].mute")
    assert take()["mute"]
    assert window.button("Make the film").is_disabled()
    for _ in range(3):
        window.button("Undo").click()
        window.idle()
    window.until("state.server.film.takes[0].at === 0")
    assert not take()["mute"]


def test_the_microphone_is_switched_off_on_the_page(window):
    assert window.button("Microphone").get_attribute("aria-pressed") == "true"
    window.button("Microphone").click()
    window.until("!state.server.microphone")
    window.idle()


def test_two_clicks_make_a_mouth_that_opens_with_the_voice(window):
    name = window.state("character")
    window.button("+ Mouth").click()
    box = window.page.locator(".overlay").bounding_box()
    x, y = box["x"] + 40, box["y"] + box["height"] - 40
    window.page.mouse.move(x, y)
    window.page.mouse.down()
    window.page.mouse.move(x + box["height"] / 8, y, steps=4)
    window.page.mouse.up()  # an eighth of a turn, so that the arms do not hide the head
    window.place("head", 0)
    for point in (HINGE, CHIN):
        there = window.page.evaluate(PROJECT, [name, point])
        window.page.mouse.click(box["x"] + there[0], box["y"] + there[1])
        window.page.get_by_text("Click the tip of the chin").wait_for(state="visible" if point == HINGE else "hidden")
    window.until("state.puppets[state.character].present.limb.some(({ name }) => name === 'jaw')")
    window.idle()
    jaw = window.limb("jaw")
    assert (jaw["parent"], jaw["gain"], jaw["follow"]) == ("head", 0.0, "turn")
    assert jaw["bend"] == {"channel": "voice", "degrees": 20.0, "axis": "x"}
    np.testing.assert_allclose(jaw["points"], [HINGE, CHIN], atol=0.02)
    window.page.get_by_label("Opens with the voice, degrees").fill("35")
    window.page.get_by_label("Opens with the voice, degrees").press("Tab")
    window.idle()
    assert window.limb("jaw")["bend"]["degrees"] == 35
    rest = window.page.evaluate("(name) => [...studio.viewer.positions(name)]", name)
    window.button("Live").click()
    play_and_pause(window)
    quiet, loud = (places(window, name, second) for second in (QUIET_SECONDS - 0.5, QUIET_SECONDS + 0.5))
    rest = np.reshape(rest, (-1, 3))
    chin, crown = np.linalg.norm(rest - CHIN, axis=1) < 0.15, rest[:, 1] > 2
    drop = -(loud - quiet)[chin, 1].mean()
    assert drop > 0.05
    assert np.abs(loud - quiet)[crown].mean() < 0.5 * drop
