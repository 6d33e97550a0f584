"""A film without a mouse: two meshes, a take, a title, music and the film, with Tab, Enter, Space and letters only."""

import shutil

import pytest

from .page_driver import running

pytestmark = pytest.mark.slow

FOCUSED = "(document.activeElement?.ariaLabel ?? document.activeElement?.innerText ?? '').trim()"

LABELLED = "document.activeElement?.closest('label')?.querySelector('span')?.innerText === '{}'"

MAX_TABS = 150


class Keyboard:
    """The keys of a person, in a window."""

    def __init__(self, window):
        self._window, self.press = window, window.page.keyboard.press

    def reach(self, condition):
        """Press Tab until a JavaScript condition of the focused element is true."""
        for _ in range(MAX_TABS):
            if self._window.page.evaluate(condition):
                return
            self.press("Tab")
        raise AssertionError(condition)

    def choose(self, name, key="Enter"):
        """Press a button."""
        self.reach(f"document.activeElement?.tagName === 'BUTTON' && {FOCUSED} === '{name}'")
        self.press(key)

    def write(self, label, text):
        """Type into a field."""
        self.reach(LABELLED.format(label))
        self.press("Control+a")
        self._window.page.keyboard.type(text)
        self.press("Enter")

    def bring(self, name, file):
        """Choose a file in the dialog that a button opens."""
        with self._window.page.expect_file_chooser() as chooser:
            self.choose(name)
        chooser.value.set_files(file)


def test_a_film_of_two_own_meshes_is_made_with_the_keyboard_alone(blob_file, browser, tmp_path):
    meshes = [shutil.copy(blob_file, tmp_path / f"{name}.glb") for name in ("ada", "bob")]
    folder = tmp_path / "studio"
    folder.mkdir()
    (folder / "film.toml").write_text("[film]\nsize = [160, 90]\n")
    with running(folder) as studio:
        window = studio.open(browser, face="film")
        keys = Keyboard(window)
        window.until("state.connected === 'open' && state.server")
        keys.bring("Choose a 3D file…", meshes[0])
        window.until("state.server.characters.length === 1 && state.busy.length === 0")
        keys.choose("Add a character…", "Space")
        keys.bring("Choose a 3D file…", meshes[1])
        window.until("state.server.characters.length === 2 && state.busy.length === 0")
        window.until("state.server.characters.every((each) => each.state === 'performing')")
        keys.choose("Record", "Space")
        window.until("state.server.recording && !state.count")
        window.frames(30)
        keys.choose("Stop recording")
        window.until("state.film.present.takes.length === 1 && state.busy.length === 0")

        keys.write("What is your film called?", "Ada and Bob")
        keys.write("Another title, at the red line", "The end")
        window.until("state.server.film.scene.title.length === 2 && state.busy.length === 0")
        keys.write("From second", "9")
        window.until("state.server.film.scene.title[1].text === 'Ada and Bob' && state.busy.length === 0")
        row = "document.activeElement.closest('.entry').querySelector('input').value"
        assert window.page.evaluate(row) == "Ada and Bob"  # the row has moved, and the focus with it
        keys.choose("Waltz", "Space")
        window.until("state.server.film.scene.music.loop === 'waltz' && state.busy.length === 0")

        keys.press("?")
        assert window.page.evaluate("document.activeElement.closest('dialog') !== null && studio.state().help")
        keys.press("Space")  # presses the only button
        window.until("!state.help")
        assert window.page.evaluate(FOCUSED) == "Waltz"

        window.until("state.plan?.film")
        keys.choose("Play")
        frame = window.page.locator(".shown-film .frame")
        frame.wait_for()
        box = frame.bounding_box()
        width, height = window.state("plan.film.size")
        assert abs(box["width"] / box["height"] - width / height) < 0.01
        keys.choose("Make the film")
        window.until("document.querySelector('dialog video')?.currentTime > 0")
        keys.choose("Close", "Space")
        window.until("!state.made")
        window.close()
