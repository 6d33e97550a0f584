"""Make images of the studio's page in each of its states, light and dark.

python -m benchmarks.studio_pictures FOLDER [--docs | --page]

With `--docs`, only the images of docs/images are made. With `--page`, the pictures of the example characters and of the
film's places that the page shows, in engine_bridge/studio/page/pictures.
"""

import argparse
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image

from benchmarks.live_peers import free_tcp_ports
from benchmarks.own_cache import own_cache
from benchmarks.studio_page import CAMERA, SIZE, chromium, command, studio, until
from engine_bridge.character.examples import MOTIONS, prepare
from engine_bridge.film.sets import SETS, panorama
from engine_bridge.studio.long_work.take_pictures import draw_take

MOVING = "state.busy.length === 0 && studio.viewer.shown(state.character)?.moment"

PHONE = {"width": 390, "height": 780}

EXAMPLE_SIZE = 128, 112
"""Width and height of a picture of an example character, in pixels."""

PLACE_SIZE = 960, 360
"""Width and height of a picture of a place, in pixels."""

DRAWN_WITH = """async (ratio) => {
  const { stage } = studio.viewer, before = stage.ratio;
  stage.ratio = ratio;
  stage.renderer.setPixelRatio(ratio);
  stage.resize();
  studio.viewer.dirty = true;
  await new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)));
  return before;
}"""
"""JavaScript: draw the view with this number of pixels, across and down, per pixel of the page; return the old one."""

Shoot, Save = Callable[[str], None], Callable[[str, bytes], None]


def states(page: Any, mesh: Path, shoot: Shoot) -> None:
    """Go through the states of a studio, and shoot each of them."""

    def button(name: str) -> Any:
        return page.get_by_role("button", name=name, exact=True)

    until(page, "state.connected === 'open' && state.server")
    shoot("empty")
    with page.expect_file_chooser() as chooser:
        button("Choose a 3D file…").click()
    chooser.value.set_files(mesh)
    until(page, "state.server.jobs.some((job) => job.state === 'running')")
    shoot("working")
    until(page, f"state.server.characters.length === 1 && {MOVING}")
    page.wait_for_timeout(3000)  # the smooth motion begins, and the picture is drawn
    shoot("scene")
    page.get_by_role("tab", name="Character").click()
    shoot("character")
    button("Workshop").click()
    shoot("list")
    page.locator(".panel button.line", has_text="left wing").first.click()
    shoot("part")
    page.keyboard.press("Escape")
    page.get_by_role("tab", name="Motion").click()
    until(page, "state.preview")
    shoot("motion")
    button("Record").click()
    until(page, "state.server.recording")
    until(page, "state.count === 0")
    shoot("clapper")
    page.wait_for_timeout(2000)
    button("Stop recording").click()
    until(page, "state.recording?.kind === 'take' && state.server.takes[0].picture")
    page.wait_for_timeout(500)  # the picture arrives
    shoot("takes")
    button("Export").click()
    until(page, "state.exported")
    shoot("exported")
    button("Make the film").click()
    until(page, "state.made")
    page.wait_for_timeout(500)  # the film plays
    shoot("film")
    page.locator(".dialog").get_by_role("button", name="Close", exact=True).click()
    button("Change…").click()
    until(page, "state.sources")
    shoot("sources")
    button("Use my webcam").click()
    until(page, "state.server.source.uri === 'camera:0' && state.server.performers.length === 1")
    button("Show what the sensor sees").click()
    until(page, "state.look?.picture && state.look.performers.length === 1")
    page.wait_for_timeout(500)  # the picture is drawn
    shoot("sensor")


def pages(folder: Path, browser: Any, scheme: str, save: Save) -> None:
    """Save the image of each state of a studio."""

    def opened(address: str, script: str = "") -> Any:
        page = browser.new_context(viewport=SIZE, color_scheme=scheme).new_page()
        page.add_init_script(script)
        page.goto(address)
        return page

    with studio(folder / scheme, **CAMERA) as addresses:
        address = next(addresses)
        page = opened(address)
        states(page, folder / "pegasus.glb", lambda name: save(name, page.screenshot()))
        page.close()
        refused = opened(address)
        refused.get_by_role("alert").get_by_text("Open the address").wait_for()
        save("no_token", refused.screenshot())
        flat = opened(address, "HTMLCanvasElement.prototype.getContext = () => null;")
        flat.get_by_role("alert").get_by_text("WebGL").wait_for()
        save("no_webgl", flat.screenshot())


def joined(folder: Path, browser: Any, scheme: str, save: Save) -> None:
    """Save the image of the page of a service that was started on its own."""
    puppet = next(folder.glob("*.toml"))
    serve = ["serve", "--puppet", puppet, "--source", "demo:walk?loop", "--port", free_tcp_ports(), "--no-announce"]
    with command(*serve, "--studio", 0) as addresses:
        page = browser.new_context(viewport=SIZE, color_scheme=scheme).new_page()
        page.goto(next(addresses))
        until(page, f"state.server?.characters.length === 1 && {MOVING}")
        page.wait_for_timeout(3000)
        save("joined", page.screenshot())


def documented(folder: Path, browser: Any, save: Save) -> None:
    """Save the images of the documentation: the example human and dog in the film, takes of them, an arm, a phone."""
    with studio(folder / "human") as addresses:
        page = browser.new_context(viewport=SIZE, color_scheme="light").new_page()
        page.goto(next(addresses))

        def button(name: str) -> Any:
            return page.get_by_role("button", name=name, exact=True)

        def take(number: int, during: Callable[[], None]) -> None:
            button("Record").click()
            until(page, "state.server.recording && state.count === null")
            page.wait_for_timeout(5000)
            during()
            button("Stop recording").click()
            until(page, f"state.server.takes.filter(({{ picture }}) => picture).length === {number}")

        button("Human").click()
        until(page, f"state.server?.characters.length === 1 && {MOVING}")
        button("Add a character…").click()
        button("Dog").click()
        until(page, f"state.server?.characters.length === 2 && state.character === 'dog' && {MOVING}")
        until(page, "Object.keys(state.portraits).length === 2")
        button("Meadow").click()
        page.get_by_label("What is your film called?").fill("The new dog")
        page.get_by_label("What is your film called?").press("Enter")
        page.wait_for_timeout(2000)
        save("studio", sharp(page))
        take(1, lambda: save("studio_record", sharp(page)))
        page.locator(".card", has_text="Human").click()
        take(2, lambda: None)
        page.get_by_role("tab", name="Character").click()
        page.wait_for_timeout(1000)
        save("studio_character", sharp(page))
        button("Play").click()
        until(page, "state.server.timeline?.takes.length === 2")
        page.wait_for_timeout(2000)
        save("studio_film", page.locator(".strip").screenshot())
        button("Another window…").click()
        address = until(page, "state.notice?.text.match(/http\\S+/)?.[0]")
        phone = browser.new_context(viewport=PHONE, color_scheme="light", has_touch=True).new_page()
        phone.goto(address)
        until(phone, f"state.server?.characters.length === 2 && {MOVING}")
        phone.wait_for_timeout(2000)
        save("studio_phone", sharp(phone))
        phone.close()
        button("Dismiss").click()
        button("Workshop").click()
        page.get_by_role("tab", name="Limbs").click()
        button("Rest pose").click()
        page.locator(".panel button.line", has_text="left arm").first.click()
        page.wait_for_timeout(2000)
        save("studio_limb", sharp(page))
        page.close()
    sensor(folder / "sensor", browser, save)


def sharp(page: Any) -> bytes:
    """Return an image of a page. Its view is drawn as with a graphics card; without one, it has fewer pixels."""
    before = page.evaluate(DRAWN_WITH, 2)
    image: bytes = page.screenshot()
    page.evaluate(DRAWN_WITH, before)
    return image


def sensor(folder: Path, browser: Any, save: Save) -> None:
    """Save the image of what a camera sees, beside the human that its performer moves."""
    with studio(folder, **CAMERA) as addresses:
        page = browser.new_context(viewport=SIZE, color_scheme="light").new_page()
        page.goto(next(addresses))
        page.get_by_role("button", name="Human", exact=True).click()
        until(page, f"state.server?.characters.length === 1 && {MOVING}")
        page.get_by_role("button", name="Use my webcam", exact=True).click()
        until(page, "state.server.source.uri === 'camera:0' && state.server.performers.length === 1")
        page.get_by_role("button", name="Show what the camera sees", exact=True).click()
        until(page, "state.look?.picture && state.look.performers.length === 1")
        page.wait_for_timeout(3000)  # the picture is drawn, and the performer is calibrated
        page.get_by_text("joints tracked").scroll_into_view_if_needed()
        save("studio_sensor", sharp(page))


def shown_by_the_page(folder: Path, save: Path) -> None:
    """Draw the pictures of the example characters and of the film's places."""
    for character in MOTIONS:
        log, puppet = prepare(character, folder)
        draw_take(puppet, log, save / f"{character}.webp", EXAMPLE_SIZE)
    for name in SETS:
        painted = Image.fromarray(panorama(name)).convert("RGB").resize(PLACE_SIZE)
        painted.save(save / f"set_{name}.webp", quality=60, method=6)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--docs", action="store_true", help="make the images of the documentation only")
    parser.add_argument("--page", action="store_true", help="make the pictures that the page shows only")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name, own_cache(Path(name)), chromium() as browser:
        folder = Path(name)
        if options.page:
            shown_by_the_page(folder, options.folder)
            return
        if options.docs:
            documented(folder, browser, lambda name, image: _write(options.folder / f"{name}.png", image))
            return
        prepare("pegasus", folder)
        for scheme in ("light", "dark"):

            def save(state: str, image: bytes, scheme: str = scheme) -> None:
                _write(options.folder / f"{state}_{scheme}.png", image)

            pages(folder, browser, scheme, save)
            joined(folder, browser, scheme, save)


def _write(path: Path, image: bytes) -> None:
    path.write_bytes(image)


if __name__ == "__main__":
    main()
