"""Typefaces: each text is drawn with letters that it has."""

import shutil

import pytest
from PIL import ImageFont

from engine_bridge.film import typeface as typefaces
from engine_bridge.film.scene import SceneError
from engine_bridge.film.typeface import FILES, typeface

from ..refusals import refused


@pytest.mark.parametrize("font", FILES)
def test_each_typeface_has_the_letters_of_western_europe(tmp_path, font):
    assert typeface(font, "Größe, français, ¿qué?", 20, "title", tmp_path).path.name == FILES[font][1]


def test_a_typeface_without_the_letters_is_replaced(tmp_path):
    assert typeface("round", "Привет, Łódź", 20, "title", tmp_path).path.name == FILES["plain"][1]


@pytest.mark.parametrize(
    ("files", "text", "letters"),
    [(FILES, "a 犬 b 猫", "犬猫"), (dict.fromkeys(FILES, ("no_such_package", "a.ttf")), "a b", "ab")],
    ids=["no typeface has them", "there is no typeface"],
)
def test_letters_without_a_typeface_are_one_message(tmp_path, monkeypatch, files, text, letters):
    monkeypatch.setattr(typefaces, "SYSTEM_FILES", ())
    monkeypatch.setattr(typefaces, "FILES", files)
    error = refused(SceneError, typeface, "hand", text, 20, "title", tmp_path)
    assert (error.where, error.found) == ("title, text", f"the letters {letters}")


def test_a_file_is_a_typeface(tmp_path):
    shutil.copy(typeface("serif", "a", 20, "title", tmp_path).path, tmp_path / "own.otf")
    assert isinstance(typeface("own.otf", "a", 20, "title", tmp_path), ImageFont.FreeTypeFont)
    assert refused(SceneError, typeface, "none.otf", "a", 20, "title", tmp_path).where == "title, font"
