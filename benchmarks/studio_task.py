"""Measure a family's evening in the studio: from the empty page to a film of two own meshes that talk.

python -m benchmarks.studio_task [MESH MESH] [--pictures FOLDER]

A script brings two meshes, by default the winged horse and the human as if they were somebody's own, chooses the
webcam, switches on the microphone, records two takes of 20 s, the second over the first, writes a title, chooses music,
makes the film, watches it and saves it. The performer is drawn, and speaks by tones.

The person takes 2 s for a click, with finding and pointing, and 0.3 s for a key, in which the machine goes on with what
it has begun. Performing and watching take as long as they last. Everything that the person waits for is the machine's:
each wait is measured from the end of an action until the page shows its result and can be clicked again; the 3 s before
the clap of each take are among them. Chromium draws without a graphics card. On a busy machine, the processor time of
Puppetline's own processes says more.
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

CLICK, KEY = 2.0, 0.3
"""Seconds that a click and a key take."""

WAITING_SECONDS = 300.0
"""Maximum duration of a wait."""

RECORDED_SECONDS = 20.0
"""Duration of each take, and so of the film, in seconds."""

LARGE = {"width": 1920, "height": 1080}
"""Size of a large window, for pictures."""

MESHES = "pegasus", "human"
"""Examples that are brought if no meshes are given."""

MOVING = (
    "state.server?.characters.length === 2 && state.busy.length === 0 && studio.viewer.shown(state.character)?.moment"
)


@dataclass
class Person:
    """A person with a mouse; counts clicks, and the seconds of the person and of the machine.

    Attributes
    ----------
    page : Page
        Playwright's.
    clicks : int
    seconds, waited : float
        Of the person, and of the machine.
    """

    page: Any
    clicks: int = 0
    seconds: float = 0.0
    waited: float = 0.0

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Count what happens as time of the machine."""
        start = time.monotonic()
        yield
        self.waited += time.monotonic() - start

    def wait(self, expression: str) -> Any:
        """Wait for something, see `until`."""
        with self.waiting():
            return until(self.page, expression, WAITING_SECONDS)

    def take(self, seconds: float) -> None:
        """Perform, watch, point or write."""
        self.seconds += seconds
        self.page.wait_for_timeout(1000 * seconds)

    def click(self, what: Any) -> None:
        """Click something as soon as it can be clicked, also while it moves."""
        self.clicks += 1
        self.take(CLICK)
        with self.waiting():
            what.and_(self.page.locator(":enabled")).click(timeout=1000 * WAITING_SECONDS, force=True)

    def choose_files(self, button: Any, files: Sequence[Path]) -> None:
        """Click a button that opens a dialog for files, click each file in it, and then its button."""
        with self.page.expect_file_chooser() as chooser:
            self.click(button)
        self.clicks += len(files) + 1
        self.take((len(files) + 1) * CLICK)
        chooser.value.set_files(files)

    def write(self, field: Any, text: str) -> None:
        """Click a field, type into it, and press Enter."""
        self.click(field)
        self.take((len(text) + 1) * KEY)
        field.fill(text)
        field.press("Enter")


@dataclass(frozen=True)
class Step:
    """What one step took: clicks, seconds of person and machine, and the processor time of Puppetline's processes."""

    title: str
    clicks: int
    person: float
    machine: float
    processor: float


class Task:
    """The task in a page that is open.

    Parameters
    ----------
    page : Page
    meshes : sequence of Path
        Two.
    """

    def __init__(self, page: Any, meshes: Sequence[Path]) -> None:
        self.person = Person(page)
        self._page, self._meshes = page, meshes

    def run(self) -> Iterator[Step]:
        """Do all steps; yield what each of them took."""
        begin = self.bring, self.webcam, self.microphone, self.first_take, self.second_take
        for step in (*begin, self.title, self.music, self.make_film, self.watch, self.save):
            before = self._counted()
            step()
            clicks, *seconds = (after - earlier for after, earlier in zip(self._counted(), before, strict=True))
            yield Step(str(step.__doc__).rstrip("."), int(clicks), *seconds)

    def _counted(self) -> tuple[int, float, float, float]:
        return self.person.clicks, self.person.seconds, self.person.waited, processor_seconds()

    def bring(self) -> None:
        """Bring two meshes, up to their first motion."""
        self.person.wait("state.connected === 'open' && state.server")
        self.person.choose_files(self._button("Choose a 3D file…"), self._meshes)
        self.person.wait(MOVING)

    def webcam(self) -> None:
        """Choose the webcam."""
        self.person.click(self._button("Use my webcam"))
        self.person.wait("state.server.source.kind === 'live' && state.server.performers.length > 0")

    def microphone(self) -> None:
        """Switch on the microphone."""
        self.person.click(self._button("Microphone"))
        self.person.wait("state.server.microphone && state.busy.length === 0")

    def first_take(self) -> None:
        """Record one of them for 20 s."""
        self._take(1)

    def second_take(self) -> None:
        """Record the other one for 20 s, over the first."""
        self.person.click(self._page.locator(".card[aria-pressed=false]"))
        self._take(2)

    def _take(self, number: int) -> None:
        self.person.click(self._button("Record"))
        self.person.wait("state.server.recording && state.recordedFrom !== null")
        self.person.take(RECORDED_SECONDS)
        self.person.click(self._button("Stop recording"))
        self.person.wait(f"state.film.present.takes.length === {number} && state.busy.length === 0")

    def title(self) -> None:
        """Write a title."""
        self.person.write(self._page.get_by_label("What is your film called?"), "The new friend")
        self.person.wait("state.server.film.scene.title.length === 1")

    def music(self) -> None:
        """Choose music."""
        self.person.click(self._button("Cheerful"))
        self.person.wait("state.server.film.scene.music.loop === 'cheerful'")

    def make_film(self) -> None:
        """Make the film."""
        self.person.click(self._button("Make the film"))
        self.person.wait("state.made")

    def watch(self) -> None:
        """Watch the film."""
        seconds = self.person.wait("document.querySelector('video')?.duration")
        self.person.take(seconds)
        self.person.wait("document.querySelector('video').ended")

    def save(self) -> None:
        """Save the film."""
        with self._page.expect_download(timeout=1000 * WAITING_SECONDS) as download:
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


def save_pictures(page: Any, folder: Path, number: int) -> None:
    """Save pictures of the page in a small and a large window."""
    for size in (LARGE, SIZE):
        page.set_viewport_size(size)
        page.screenshot(path=folder / f"{number:02}_{size['width']}.png")


def row(step: Step) -> str:
    """Return a line of the table."""
    return f"| {step.title} | {step.clicks} | {step.person:.0f} | {step.machine:.1f} | {step.processor:.0f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mesh", type=Path, nargs="*", help="two meshes")
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="save pictures of the page after each step")
    options = parser.parse_args()
    if len(options.mesh) not in (0, 2):
        parser.error("two meshes are brought")
    with tempfile.TemporaryDirectory() as name, own_cache(Path(name)):
        meshes = options.mesh or [Path(name) / f"{example}.glb" for example in MESHES]
        for example in () if options.mesh else MESHES:
            prepare(example, Path(name))
        with studio(Path(name) / "studio", **CAMERA) as addresses, chromium() as browser:
            page = browser.new_page(viewport=SIZE)
            page.goto(next(addresses))
            print("| step | clicks | person, s | machine, s | processor, s |", "|" + " --- |" * 5, sep="\n")
            steps = []
            for number, step in enumerate(Task(page, meshes).run(), 1):
                steps.append(step)
                print(row(step), flush=True)
                if options.pictures:
                    save_pictures(page, options.pictures, number)
            keys = "clicks", "person", "machine", "processor"
            print(row(Step("all", *(sum(getattr(each, key) for each in steps) for key in keys))))
            print(f"Load of the machine: {', '.join(f'{load:.1f}' for load in psutil.getloadavg())}")


if __name__ == "__main__":
    main()
