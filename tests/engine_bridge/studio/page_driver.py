"""`puppetline studio` as a process, and its page in a browser."""

import contextlib
import json
import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np

from ...conftest import ROOT, missing

TIMEOUT_SECONDS = 240.0
"""Time after which a test fails, in seconds; the first start of a service compiles."""

CAMERA = {"PYTHONPATH": str(Path(__file__).parent / "virtual_camera")}
"""Environment of a process that has a virtual camera, camera:0."""

STILL = """(seconds) => new Promise((resolve, reject) => {
  let [before, same] = ["", 0];
  setTimeout(() => reject(`still moving after ${seconds} s: ${before}`), 1000 * seconds);
  const look = () => {
    const { limbs } = studio.viewer.places();
    const now = JSON.stringify(limbs);
    same = now === before && limbs.length > 0 ? same + 1 : 0;
    before = now;
    if (same >= 6) resolve(limbs);
    else requestAnimationFrame(look);
  };
  look();
})"""
"""JavaScript: the places of all limbs, as soon as they are the same in seven images in a row."""

FEWER_IMAGES = """{
  const draw = requestAnimationFrame;
  window.requestAnimationFrame = (work) => setTimeout(() => draw(work), 100);
  window.cancelAnimationFrame = clearTimeout;
}"""
"""JavaScript: draw at most ten images per second, which leaves the processor to the rest of the test."""

REMEMBER = 'localStorage.getItem("puppetline.face") ?? localStorage.setItem("puppetline.face", "{face}");'
"""JavaScript: the page opens with a face, until another one is chosen."""

AXE = ROOT / "engine_bridge" / "studio" / "page" / "node_modules" / "axe-core" / "axe.min.js"

RULES = ("wcag2a", "wcag2aa", "wcag21aa", "wcag22aa")

CHECK = """async (rules) => {
  const [draw, held] = [requestAnimationFrame, []];
  window.requestAnimationFrame = (work) => held.push(work); // drawing leaves the processor to axe
  const { violations } = await axe.run({ preload: false, resultTypes: ["violations"], runOnly: rules });
  window.requestAnimationFrame = draw;
  held.forEach(draw);
  return violations;
}"""
"""JavaScript: what axe finds."""

COUNT_CLICKS = "window.clicks = 0; addEventListener('pointerdown', () => window.clicks++, true);"


class Command:
    """A command of `puppetline` that prints addresses."""

    def __init__(self, *arguments, cwd=None, environment):
        self._process = subprocess.Popen(
            [sys.executable, "-m", "puppetline", *map(str, arguments)],
            cwd=cwd,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": "1"} | environment,
        )
        self.pid = self._process.pid
        self.lines = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        self.lines.extend(self._process.stdout)

    def printed(self, pattern, known=0):
        """Return all that it has printed of a pattern, as soon as these are more than a number."""
        end = time.monotonic() + TIMEOUT_SECONDS
        while time.monotonic() < end:
            found = re.findall(pattern, "".join(self.lines))
            if len(found) > known:
                return found
            assert self._process.poll() is None, "".join(self.lines)
            time.sleep(0.1)
        raise AssertionError("".join(self.lines))

    def close(self):
        """End the command as Ctrl-C does."""
        self._process.terminate()
        self._process.wait(60)


class Studio(Command):
    """The command `puppetline studio`, with a virtual camera."""

    def __init__(self, folder, *arguments):
        own = [] if folder is None else ["--folder", folder]
        super().__init__("studio", "--no-browser", "--port", "0", *own, *arguments, environment=CAMERA)
        self.folder, self.last_address = folder, ""
        self._used = 0

    def address(self):
        """Return an address whose one-time token was not used before."""
        found = self.printed(r"http://\S+#token=\S+", self._used)
        self._used, self.last_address = len(found), found[-1]
        return self.last_address

    def open(self, browser, face="workshop", **options):
        """Open the page in a window of its own, with a face."""
        coarse = {"viewport": {"width": 1280, "height": 720}, "device_scale_factor": 0.5}
        context = browser.new_context(**(coarse | options))
        return Window(context, self.address(), face)


class Window:
    """A browser window with the page; `page` is Playwright's."""

    def __init__(self, context, address, face="workshop"):
        context.set_default_timeout(1000 * TIMEOUT_SECONDS)
        self.context, self.page = context, context.new_page()
        self.problems = []
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("console", self._console)
        self.page.add_init_script(COUNT_CLICKS + FEWER_IMAGES + REMEMBER.format(face=face))
        self.page.goto(address)

    def _console(self, message):
        if message.type == "error" and "ERR_CONNECTION_REFUSED" not in message.text:
            self.problems.append(message.text)

    def state(self, path=""):
        """Return the page's state, or a part of it such as ``server.source.name``."""
        return json.loads(self.page.evaluate(f"JSON.stringify(studio.state(){path and '.' + path} ?? null)"))

    def until(self, expression, seconds=TIMEOUT_SECONDS):
        """Wait until a JavaScript expression is true, with `state` for the page's state; return its value."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            value = self.page.evaluate(f"(() => {{ const state = studio.state(); return {expression}; }})()")
            if value:
                return value
            self.page.wait_for_timeout(30)
        shown = {key: self.state(key) for key in ("connected", "notice", "busy", "server", "selection")}
        raise AssertionError(f"never: {expression}; {shown}")

    def idle(self):
        """Wait until all that was requested is done."""
        self.until("state.busy.length === 0")
        assert self.state("notice") is None, self.state("notice")

    @property
    def puppet(self):
        """The puppet of the shown character."""
        return self.page.evaluate("(s => s.puppets[s.character]?.present)(studio.state())")

    def limb(self, name):
        """A limb of the shown puppet."""
        return next(limb for limb in self.puppet["limb"] if limb["name"] == name)

    def handle(self, name):
        """A handle of the shown puppet."""
        return next(handle for handle in self.puppet["handle"] if handle["name"] == name)

    def place(self, limb, point):
        """Return where a point of a limb is in the window at rest, in pixels; wait until the view stands still."""
        box = self.page.locator(".overlay").bounding_box()
        limbs = self.page.evaluate(STILL, TIMEOUT_SECONDS)
        x, y, _ = next(each for each in limbs if each["name"] == limb)["points"][point]
        return box["x"] + x, box["y"] + y

    @contextlib.contextmanager
    def dragged(self, start, end):
        """Drag the pointer, and hold it at the end meanwhile."""
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(*end, steps=4)
        yield
        self.page.mouse.up()

    def drag(self, start, end):
        """Drag the pointer."""
        with self.dragged(start, end):
            pass

    def edited(self, before):
        """Wait until the puppet differs from another one, and what was edited is applied."""
        shown = "JSON.stringify(state.puppets[state.character].present)"
        self.until(f"{shown} !== JSON.stringify({json.dumps(before)})")
        self.idle()

    def frames(self, count):
        """Wait until so many further frames of the shown character have been streamed and drawn."""
        number = "studio.viewer.moment(state.character)?.later"
        self.until(f"{number} >= {self.until(number) + count}")

    def positions(self):
        """Return the positions (n, 3) of the shown character's vertices as they are drawn."""
        return np.reshape(self.page.evaluate("[...studio.viewer.positions(studio.state().character)]"), (-1, 3))

    def save(self, act, path):
        """Do something that saves a file on this computer; return where it is saved."""
        with self.page.expect_download() as download:
            act()
        download.value.save_as(path)
        return path

    def button(self, name):
        """A button, by its whole name."""
        return self.page.get_by_role("button", name=name, exact=True)

    def tab(self, name):
        """Open a tab of the right panel."""
        self.page.get_by_role("tab", name=name).click()

    def close(self):
        """Close the window; fail if the page had an error, also one of its Content Security Policy."""
        self.context.close()
        assert self.problems == []


@contextlib.contextmanager
def running(folder, *arguments):
    """Run a studio."""
    studio = Studio(folder, *arguments)
    try:
        yield studio
    finally:
        studio.close()
        sys.stdout.writelines(studio.lines)  # pytest shows it if a test fails


def violations(page, rules=RULES):
    """Return what axe finds on a page that is serious: the names of rules, and where they are broken."""
    if not AXE.is_file():
        missing("browser", "axe-core is not installed (make lint)")
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE.read_text(encoding="utf-8") + "; null")
    found = page.evaluate(CHECK, list(rules))
    serious = [each for each in found if each["impact"] in ("serious", "critical")]
    return [(each["id"], [node["target"] for node in each["nodes"]]) for each in serious]
