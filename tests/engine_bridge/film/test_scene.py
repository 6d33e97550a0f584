"""Scene files: what they may say, and what is said about their mistakes."""

import pytest

from engine_bridge.film import scene as scenes
from engine_bridge.film.scene import SceneError

from ..refusals import refused

CHARACTER = '[[character]]\nname = "a"\npuppet = "a.toml"\n'
TAKE = '[[take]]\ncharacter = "a"\nfile = "a.log"\n'
BOTH = CHARACTER + TAKE
BACKGROUND = '[background]\ncolor = "red"\npicture = "a.png"'
CAMERAS = "[[camera]]\nat = 2\n[[camera]]\nat = 1"


@pytest.fixture
def load(tmp_path):
    def read(text):
        if text is not None:
            (tmp_path / "scene.toml").write_text(text)
        return scenes.load(tmp_path / "scene.toml")

    return read


@pytest.mark.parametrize(
    ("text", "where", "found"),
    [
        (TAKE, "character", "nothing"),
        (CHARACTER, "the whole file", "no take"),
        (CHARACTER + BOTH, "[[character]] 2 'a', name", "a second character named 'a'"),
        (BOTH.replace('character = "a"', 'character = "b"'), "[[take]] 1, character", "'b'"),
        (BOTH + "stop = 1\nstart = 2", "[[take]] 1, stop", "1 s"),
        (BOTH + "lop = 2", "[[take]] 1, lop", "the unknown key 'lop'"),
        (BOTH + "[film]\nsize = [1281, 720]", "[film], size", "1281 × 720 pixels"),
        (BOTH + '[floor]\ncolor = "gren"', "[floor], color", "'gren'"),
        (BOTH + BACKGROUND, "[background], picture", "color and picture"),
        (BOTH + '[background]\nset = "moon"', "[background], set", "'moon'"),
        (BOTH + '[music]\nloop = "calm"\nfile = "a.mp3"', "[music], file", "loop and file"),
        (BOTH + '[[bubble]]\ncharacter = "a"', "[[bubble]] 1, text", "nothing"),
        (BOTH + '[[bubble]]\ncharacter = "b"\ntext = "Hi"', "[[bubble]] 1, character", "'b'"),
        (BOTH + '[[camera]]\nbehind = "c"', "[[camera]] 1, behind", "'c'"),
        (BOTH + '[[camera]]\nbehind = "a"\nshow = ["a"]', "[[camera]] 1, behind", "'a', which is shown"),
        (BOTH + CAMERAS, "[[camera]] 2, at", "1 s after a camera at 2 s"),
        (BOTH + '[[camera]]\nshow = ["c"]', "[[camera]] 1, show, 1", "'c'"),
        (BOTH + "[film]\nfps = 0", "[film], fps", "0"),
        ('[character]\nmesh = "dog.glb"', None, "a puppet file"),
        ('[[stage]]\nsource = "osc:0"', None, "a service file"),
        (None, None, "a file that cannot be read"),
    ],
)
def test_a_mistake_is_explained_in_terms_of_the_file(load, text, where, found):
    error = refused(SceneError, load, text)
    assert error.where.endswith("scene.toml" if where is None else f"scene.toml, {where}")
    assert error.found.startswith(found)
