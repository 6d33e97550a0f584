"""Measure a family's evening in the studio at the pace of a person: from the empty page to a film of two own meshes
that talk.

python -m benchmarks.studio_task

A script brings the winged horse and the human as if they were somebody's own meshes, chooses the webcam, switches on
the microphone, records two takes of 20 s, the second over the first, writes a title, chooses music, makes the film,
watches it and saves it. The performer is drawn, and speaks by tones. Before each action it waits as long as a person
takes by the keystroke-level model (Card, Moran and Newell, Communications of the ACM 23(7), 1980): 1.35 s to think,
1.1 s to point, 0.1 s to press or release a button, 0.2 s for a key. It also waits 2 s, which is an assumption, to read
what is new. The rest is the time of the machine, on which Chromium draws without a graphics card. On a busy machine,
the processor time of Puppetline's own processes says more.
"""

import argparse
import contextlib
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil

from benchmarks.own_cache import own_cache
from benchmarks.studio_page import CAMERA, SIZE, chromium, studio, until
from engine_bridge.character.examples import prepare

THINK, POINT, PRESS, KEY, READ = 1.35, 1.1, 0.1, 0.2, 2.0
"""Seconds that a person takes to think, to point, to press or release a button, to press a key, and to read a panel."""

RECORDED_SECONDS = 20.0
"""Duration of each take, and so of the film, in seconds."""

MESHES = "pegasus", "human"
"""Examples that are brought as if they were somebody's own."""

MOVING = (
    "state.server?.characters.length === 2 && state.busy.length === 0 && studio.viewer.shown(state.character)?.moment"
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

    def choose_files(self, button: Any, files: Sequence[Path]) -> None:
        """Click a button that opens a dialog for files, click each file in it, and then its button."""
        with self.page.expect_file_chooser() as chooser:
            self.click(button)
        self.take(READ + (len(files) + 1) * (THINK + POINT + 2 * PRESS))
        self.clicks += len(files) + 1
        chooser.value.set_files(files)

    def write(self, field: Any, text: str) -> None:
        """Click a field, type into it, and press Enter."""
        self.click(field)
        self.take((len(text) + 1) * KEY)
        field.fill(text)
        field.press("Enter")


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
    meshes : sequence of Path
    """

    def __init__(self, page: Any, meshes: Sequence[Path]) -> None:
        self.person = Person(page)
        self._page, self._meshes = page, meshes

    def run(self) -> Iterator[Step]:
        """Do all steps; yield what each of them took."""
        begin = self.bring, self.webcam, self.microphone, self.first_take, self.second_take
        for step in (*begin, self.title, self.music, self.make_film, self.watch, self.save):
            start, person, clicks = time.monotonic(), self.person.seconds, self.person.clicks
            used = processor_seconds()
            step()
            seconds = time.monotonic() - start
            title = str(step.__doc__).rstrip(".")
            used = processor_seconds() - used
            yield Step(title, seconds, self.person.seconds - person, self.person.clicks - clicks, used)

    def bring(self) -> None:
        """Bring two meshes, up to their first motion."""
        until(self._page, "state.connected === 'open' && state.server")
        self.person.take(READ)
        self.person.choose_files(self._button("Choose a 3D file…"), self._meshes)
        until(self._page, MOVING)

    def webcam(self) -> None:
        """Choose the webcam."""
        self.person.take(READ)
        self.person.click(self._button("Use my webcam"))
        until(self._page, "state.server.source.kind === 'live' && state.server.performers.length > 0")

    def microphone(self) -> None:
        """Switch on the microphone."""
        self.person.click(self._button("Microphone"))
        until(self._page, "state.server.microphone && state.busy.length === 0")

    def first_take(self) -> None:
        """Record one of them for 20 s."""
        self._take(1)

    def second_take(self) -> None:
        """Record the other one for 20 s, over the first."""
        self.person.click(self._page.locator(".card[aria-pressed=false]"))
        self._take(2)

    def _take(self, number: int) -> None:
        self.person.click(self._button("Record"))
        until(self._page, "state.server.recording && state.recordedFrom !== null && state.count === null")
        self.person.take(RECORDED_SECONDS)
        self.person.click(self._button("Stop recording"))
        until(self._page, f"state.film.present.takes.length === {number} && state.busy.length === 0")

    def title(self) -> None:
        """Write a title."""
        self.person.take(READ)
        self.person.write(self._page.get_by_label("What is your film called?"), "The new horse")
        until(self._page, "state.server.film.scene.title.length === 1")

    def music(self) -> None:
        """Choose music."""
        self.person.click(self._button("Cheerful"))
        until(self._page, "state.server.film.scene.music.loop === 'cheerful'")

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
        for mesh in MESHES:
            prepare(mesh, Path(name))
        with studio(Path(name) / "studio", **CAMERA) as addresses, chromium() as browser:
            page = browser.new_page(viewport=SIZE)
            page.goto(next(addresses))
            print("| step | s | of the person | of the machine | clicks | processor, s |", "|" + " --- |" * 6, sep="\n")
            steps = []
            for step in Task(page, [Path(name) / f"{mesh}.glb" for mesh in MESHES]).run():
                steps.append(step)
                print(row(step), flush=True)
            keys = "seconds", "person", "clicks", "processor"
            print(row(Step("all", *(sum(getattr(each, key) for each in steps) for key in keys))))


if __name__ == "__main__":
    main()
