"""Takes are drawn with the characters that play them in the film."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from engine_bridge.studio.backend.film_editing import FilmEditing
from engine_bridge.studio.backend.take_drawing import TakeDrawing

FILM = '[[character]]\nname = "human"\npuppet = "live.toml"\n[[take]]\ncharacter = "{}"\nfile = "takes/take-1.log"\n'


@pytest.mark.parametrize(
    ("film", "there", "chosen"),
    [
        (FILM.format("human"), ["dog", "human"], "human"),
        (FILM.format("cat"), ["cow", "human", "dog"], "dog"),
        ("", ["cow"], "cow"),
        ("[[take]", ["dog"], "dog"),
        (FILM.format("human"), [], None),
    ],
    ids=["who plays it", "who was there", "anybody", "the film is damaged", "nobody"],
)
def test_a_take_is_drawn_with_the_character_that_plays_it(tmp_path, film, there, chosen):
    """The take was recorded while a dog and a human were there."""
    (tmp_path / "film.toml").write_text(film)
    take = SimpleNamespace(name="take-1", seconds=2.0, parts=["dog", "human"])
    takes = SimpleNamespace(states=[take])
    opened = SimpleNamespace(all=[SimpleNamespace(name=each, live_file=Path(each)) for each in there])
    editing = FilmEditing(SimpleNamespace(folder=tmp_path), None, takes)
    assert TakeDrawing(takes, editing, opened, None, None)._puppet_for(take) == (chosen and Path(chosen))
