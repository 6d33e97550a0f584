"""The page plays the sounds of takes in step with the images of their characters."""

import numpy as np
import pytest

from capture.events import Cue
from capture.skeleton import JOINT_INDEX
from capture.sound import WavWriter

from .page_driver import Window, running

pytestmark = pytest.mark.slow

SECONDS = 6.0
"""Duration of the take, in seconds."""

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
  const second = () => Number.parseFloat(document.querySelector(".time").textContent);
  for (let before = null; studio.state().server.timeline !== null && second() < 5; ) {
    await new Promise(requestAnimationFrame);
    if (second() === before || second() < 2.4) continue;  // after the easing
    before = second();
    found.push(measure(name, vertex));
  }
  return found;
};
"""
"""JavaScript: `ask` sends a request; `measure` returns where a vertex is, the sample that is played, when it will be
heard, and whether the frames of this moment have arrived; `follow` returns the same of each tenth of a second that the
page shows from 2.4 to 5 seconds."""


@pytest.fixture(scope="module")
def studio(limbed_puppet, standing, frames, record_events, tmp_path_factory):
    """A studio with a film of one take: an arm rises, and the sound rises with it."""
    folder = tmp_path_factory.mktemp("studio")
    (folder / "takes").mkdir()
    shoulder, *arm = (JOINT_INDEX[f"{joint}_left"] for joint in ("shoulder", "elbow", "wrist", "hand"))
    lengths = np.linalg.norm(standing[arm] - standing[shoulder], axis=1)
    angles = np.linspace(0, np.pi, round(30 * SECONDS) + 1)[:, None, None]
    positions = np.tile(standing, (len(angles), 1, 1))
    way = np.concatenate([-np.sin(angles), -np.cos(angles), 0 * angles], axis=2)
    positions[:, arm] = standing[shoulder] + lengths[:, None] * way
    cue = Cue(5.0, "sound", {"file": "rise.wav", "at": 5.0 - EARLY_SECONDS})
    record_events(folder / "takes" / "rise.log", [cue, *frames(positions, 5.0)])
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
    opened.until("state.film.present.takes.length === 1 && studio.viewer.shown(state.character)?.moment")
    yield opened
    opened.close()


def ask(window, do, **arguments):
    return window.page.evaluate("window.ask", {"do": do, **arguments})


def places(window, second):
    """Return the places of all vertices when the paused take stands at a second: they are the same 15 frames later."""
    ask(window, "seek", seconds=second)
    for _ in range(100):
        before = window.positions()
        window.frames(15)
        if np.array_equal(window.positions(), before):
            return before
    raise AssertionError("never: the character stands still")


def test_the_sound_of_a_take_is_in_step_with_its_image_after_a_jump_and_a_pause_silences_it(window):
    name = window.state("character")
    ask(window, "play_film")
    ask(window, "pause")
    seconds = [1.5, 2.5, 3.5, 4.5]
    shown = np.array([places(window, second) for second in seconds])
    vertex = int(np.ptp(shown, axis=0).sum(axis=1).argmax())
    way = shown[:, vertex, :2]
    circle = np.linalg.lstsq(np.c_[2 * way, np.ones(len(way))], (way**2).sum(axis=1))[0]  # around the shoulder

    def angle(points):
        return np.arctan2(*(points - circle[:2]).T[::-1])

    second_of = np.poly1d(np.polyfit(angle(way), seconds, 1))
    assert second_of(angle(way)) == pytest.approx(seconds, abs=0.002)
    off = np.inf
    while off > MAX_OFFSET_SECONDS:  # a machine that is busy for some seconds draws late
        ask(window, "stop")
        ask(window, "play_film")
        ask(window, "seek", seconds=0.5)
        found = window.page.evaluate("([name, vertex]) => follow(name, vertex)", [name, vertex])
        in_time = [each for *each, is_in_time in found if is_in_time and each[2] > 0]  # before the sound's end
        if not in_time:
            continue
        x, y, sample, later = np.transpose(in_time)
        offsets = FULL_SECONDS * sample - later - EARLY_SECONDS - second_of(angle(np.c_[x, y]))
        # an image stays until the next frame, so many are late, none early
        off = abs(np.quantile(offsets, 0.25))
    ask(window, "seek", seconds=3.0)
    ask(window, "pause")
    window.until("!measure(state.character, 0)[2]")
