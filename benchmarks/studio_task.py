"""Measure a family's evening in the studio at the pace of a person: from the empty page to a film of two characters who
talk.

python -m benchmarks.studio_task

A script brings the winged horse as if it were a scan, drags a joint of a proposed limb, maps another limb, gives the
horse a mouth by two clicks, chooses the webcam, switches on the microphone, adds the dog, records two takes of 10 s,
the second over the first, trims one, makes the film, watches it and saves it. The performer is drawn, and speaks by
tones. Before each action it waits as long as a person takes by the keystroke-level model (Card, Moran and Newell,
Communications of the ACM 23(7), 1980): 1.35 s to think, 1.1 s to point, 0.1 s to press or release a button. It also
waits 2 s, which is an assumption, to read what is new. The rest is the time of the machine, on which Chromium draws
without a graphics card. On a busy machine, the processor time of Puppetline's own processes says more.
"""

import argparse
import contextlib
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks.own_cache import own_cache
from benchmarks.studio_page import CAMERA, SIZE, chromium, studio, until
from engine_bridge.character.examples import prepare

THINK, POINT, PRESS, READ = 1.35, 1.1, 0.1, 2.0
"""Seconds that a person takes to think, to point, to press or release a button, and to read a panel."""

RECORDED_SECONDS = 10.0

MOVING = (
    "state.server?.characters.length === 1 && state.busy.length === 0 && studio.viewer.shown(state.character)?.moment"
)


@dataclass
class Person:
    """A person with a mouse; counts clicks and seconds.

    Attributes
    ----------
    page : Page
        Playwright's.
    clicks : int
    seconds : float
        Time for reading, thinking, pointing and pressing.
    """

    page: Any
    clicks: int = 0
    seconds: float = 0.0

    def take(self, seconds: float) -> None:
        """Let time pass."""
        self.seconds += seconds
        self.page.wait_for_timeout(1000 * seconds)

    def click(self, what: Any) -> None:
        """Think, point at something, and click it."""
        self.take(THINK + POINT + 2 * PRESS)
        self.clicks += 1
        what.click()

    def click_at(self, x: float, y: float) -> None:
        """Think, point at a place in the window, and click it."""
        self.take(THINK + POINT + 2 * PRESS)
        self.clicks += 1
        self.page.mouse.click(x, y)

    def choose_file(self, button: Any, file: Path) -> None:
        """Click a button that opens a dialog for files, and double-click a file in it."""
        with self.page.expect_file_chooser() as chooser:
            self.click(button)
        self.take(READ + THINK + POINT + 4 * PRESS)
        self.clicks += 2
        chooser.value.set_files(file)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag from one place in the window to another."""
        self.take(THINK + POINT + PRESS)
        self.clicks += 1
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.take(POINT + PRESS)
        self.page.mouse.move(*end, steps=10)
        self.page.mouse.up()


@dataclass(frozen=True)
class Step:
    """What one step took: seconds in all and of the person, clicks, and processor time of Puppetline's processes."""

    title: str
    seconds: float
    person: float
    clicks: int
    processor: float


class Task:
    """The task in a page that is open.

    Parameters
    ----------
    page : Page
    mesh : Path
    """

    def __init__(self, page: Any, mesh: Path) -> None:
        self.person = Person(page)
        self._page, self._mesh = page, mesh

    def run(self) -> Iterator[Step]:
        """Do all steps; yield what each of them took."""
        steps = self.bring, self.drag_joint, self.remap, self.add_mouth, self.webcam, self.microphone, self.add_dog
        for step in (*steps, self.first_take, self.second_take, self.trim, self.make_film, self.watch, self.save):
            start, person, clicks = time.monotonic(), self.person.seconds, self.person.clicks
            used = processor_seconds()
            step()
            seconds = time.monotonic() - start
            title = str(step.__doc__).rstrip(".")
            used = processor_seconds() - used
            yield Step(title, seconds, self.person.seconds - person, self.person.clicks - clicks, used)

    def bring(self) -> None:
        """Bring the mesh, up to its first motion."""
        until(self._page, "state.connected === 'open' && state.server")
        self.person.take(READ)
        self.person.choose_file(self._button("Choose a mesh…"), self._mesh)
        until(self._page, MOVING)

    def drag_joint(self) -> None:
        """Drag a joint of a proposed limb."""
        self.person.take(READ)
        self.person.click(self._button("Rest pose"))
        self.person.click(self._limb(0))
        _, (x, y) = self._points(LIMBS[0])[:2]
        before = self._puppet()
        self.person.drag((x, y), (x + 12, y - 12))
        self._edited(before)

    def remap(self) -> None:
        """Map a limb to another joint of the performer."""
        self.person.click(self._button("‹ All limbs and handles"))
        before = self._puppet()
        self.person.click(self._page.locator("#joint-hand_left"))
        self.person.click(self._limb(1))
        self._edited(before)

    def add_mouth(self) -> None:
        """Give the horse a mouth, from the side."""
        self.person.click(self._button("+ Mouth"))
        self.person.take(READ)
        box = self._page.locator(".overlay").bounding_box()
        x, y = box["x"] + 60, box["y"] + box["height"] - 60
        self.person.drag((x, y), (x + box["height"] / 4, y))  # a quarter of a turn
        neck, muzzle = (np.array(point) for point in self._points("head")[:: len(self._points("head")) - 1])
        along = muzzle - neck
        down = np.array([-along[1], along[0]]) * np.sign(along[0])
        before = self._puppet()
        for share, lower in JAW_PLACES:
            self.person.click_at(*(neck + share * along + lower * down))
        self._edited(before)

    def microphone(self) -> None:
        """Switch on the microphone."""
        self.person.click(self._button("Microphone"))
        until(self._page, "state.server.microphone && state.busy.length === 0")

    def webcam(self) -> None:
        """Choose the webcam."""
        self.person.click(self._button("Live"))
        self.person.click(self._button("Change…"))
        self.person.take(READ)
        until(self._page, "state.sources")
        self.person.click(self._button("Use my webcam"))
        until(self._page, "state.server.source.kind === 'live' && state.server.characters[0].state === 'performing'")

    def add_dog(self) -> None:
        """Add the dog."""
        self.person.take(THINK + POINT + 4 * PRESS + READ)
        self.person.clicks += 2
        self._page.get_by_label("Character", exact=True).select_option(label="Open another…")
        self.person.click(self._button("Dog"))
        until(
            self._page, "state.server.characters.length === 2 && state.character === 'dog' && state.busy.length === 0"
        )

    def first_take(self) -> None:
        """Record the horse for 10 s."""
        self.person.take(THINK + POINT + 4 * PRESS)
        self.person.clicks += 2
        self._page.get_by_label("Character", exact=True).select_option("pegasus")
        self._take(1)

    def second_take(self) -> None:
        """Record the dog for 10 s, over the horse."""
        self.person.click(self._button("dog"))
        self._take(2)

    def _take(self, number: int) -> None:
        self.person.click(self._button("Record"))
        until(self._page, "state.server.recording && !state.count")
        self.person.take(RECORDED_SECONDS)
        self.person.click(self._button("Stop recording"))
        until(self._page, f"state.film.present.length === {number} && state.busy.length === 0")

    def trim(self) -> None:
        """Trim the end of the first take."""
        self.person.take(READ)
        edge = self._page.locator(".clip").first.locator(".edge.end").bounding_box()
        x, y = edge["x"] + edge["width"] / 2, edge["y"] + edge["height"] / 2
        before = self._page.evaluate("studio.state().film.present[0].stop")
        self.person.drag((x, y), (x - 40, y))
        until(self._page, f"state.film.present[0].stop < {before} && state.busy.length === 0")

    def make_film(self) -> None:
        """Make the film."""
        self.person.click(self._button("Make the film"))
        until(self._page, "state.made", seconds=1200)

    def watch(self) -> None:
        """Watch the film."""
        seconds = until(self._page, "document.querySelector('video').duration")
        self.person.take(seconds)
        until(self._page, "document.querySelector('video').ended")

    def save(self) -> None:
        """Save the film."""
        with self._page.expect_download() as download:
            self.person.click(self._button("Save the film"))
        if download.value.path().read_bytes()[4:8] != b"ftyp":
            raise SystemExit("the download is not an .mp4")

    def _button(self, name: str) -> Any:
        return self._page.get_by_role("button", name=name, exact=True)

    def _limb(self, number: int) -> Any:
        """Return the entry of a limb of arms or legs in the list."""
        return self._page.locator(".panel button.line", has_text=LIMBS[number]).first

    def _points(self, limb: str) -> list[tuple[float, float]]:
        """Return where the points of a limb are in the window, as soon as the view stands still."""
        box = self._page.locator(".overlay").bounding_box()
        return [(box["x"] + x, box["y"] + y) for x, y, *_ in self._page.evaluate(STILL, limb)]

    def _puppet(self) -> str:
        return str(self._page.evaluate("JSON.stringify(studio.state().puppets[studio.state().character].present)"))

    def _edited(self, before: str) -> None:
        changed = f"JSON.stringify(state.puppets[state.character].present) !== {before!r}"
        until(self._page, f"{changed} && state.busy.length === 0")


LIMBS = "left front leg", "right wing"
"""Limbs of the winged horse: one whose joint is dragged, and one that is mapped."""

JAW_PLACES = (0.3, 0.35), (1.0, 0.22)
"""Where the jaw begins and ends: along the head, from the neck to the muzzle, and below, as shares of its length."""

STILL = """(name) => new Promise((resolve) => {
  let before = "";
  const look = () => {
    const limb = studio.viewer.places().limbs.find((each) => each.name.includes(name));
    const now = JSON.stringify(limb ?? null);
    if (now === before && limb !== undefined) resolve(limb.points);
    else {
      before = now;
      setTimeout(look, 500);
    }
  };
  look();
})"""
"""JavaScript: the places of a limb's points, in pixels of the view, as soon as it stands still for half a second."""


def processor_seconds() -> float:
    """Return the processor time of the studio, its workers and its service so far."""
    used = 0.0
    for each in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if "python" in each.name():
                used += sum(each.cpu_times()[:2])
    return used


def row(step: Step) -> str:
    """Return a line of the table."""
    seconds = f"{step.seconds:.1f} | {step.person:.1f} | {step.seconds - step.person:.1f}"
    return f"| {step.title} | {seconds} | {step.clicks} | {step.processor:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.parse_args()
    with tempfile.TemporaryDirectory() as name, own_cache(Path(name)):
        prepare("pegasus", Path(name))
        with studio(Path(name) / "studio", **CAMERA) as addresses, chromium() as browser:
            page = browser.new_page(viewport=SIZE)
            page.goto(next(addresses))
            print("| step | s | of the person | of the machine | clicks | processor, s |", "|" + " --- |" * 6, sep="\n")
            steps = []
            for step in Task(page, Path(name) / "pegasus.glb").run():
                steps.append(step)
                print(row(step), flush=True)
            keys = "seconds", "person", "clicks", "processor"
            print(row(Step("all", *(sum(getattr(each, key) for each in steps) for key in keys))))


if __name__ == "__main__":
    main()
