"""Takes are drawn with the characters that play them in the film."""

import asyncio
from pathlib import Path
from types import SimpleNamespace

import pytest

from engine_bridge.studio.backend.film_editing import FilmEditing
from engine_bridge.studio.backend.take_drawing import TakeDrawing
from engine_bridge.studio.messages.state import TakeState

FILM = """
[[character]]
name = "human"
puppet = "characters/human/live.toml"

[[take]]
character = "{player}"
file = "takes/take-1.log"
"""


@pytest.fixture
def draw(tmp_path):
    """Draw a take that was recorded while a dog and a human were there; return the puppet file."""

    def draw(film, *open_ones):
        drawn = []

        async def run(task, puppet, *_):
            drawn.append((task, puppet))

        take = TakeState(
            name="take-1", seconds=2.0, frames=60, bytes=9, written=0.0, sound=False, parts=["dog", "human"]
        )
        takes = SimpleNamespace(
            states=[take],
            sound=lambda name: tmp_path / f"{name}.wav",
            picture=lambda name, wave=False: tmp_path / f"{name}.png",
            path=lambda name: tmp_path / f"{name}.log",
        )
        (tmp_path / "film.toml").write_text(film)
        opened = SimpleNamespace(all=[SimpleNamespace(name=each, live_file=Path(each)) for each in open_ones])
        editing = FilmEditing(SimpleNamespace(folder=tmp_path), None, takes)

        async def begin():
            drawing = TakeDrawing(takes, editing, opened, SimpleNamespace(run=run), lambda: None)
            drawing.begin()
            await drawing._drawing

        asyncio.run(begin())
        return drawn

    return draw


def test_a_take_is_drawn_with_the_character_that_plays_it(draw):
    assert draw(FILM.format(player="human"), "dog", "human") == [("draw_take", Path("human"))]
    assert draw(FILM.format(player="cat"), "cow", "human", "dog") == [("draw_take", Path("dog"))]
    assert draw("", "cow") == [("draw_take", Path("cow"))]
    assert draw("[[take]", "dog") == [("draw_take", Path("dog"))]
    assert draw(FILM.format(player="human")) == []
