"""The studio's scene file: takes from the page, and what people have written by hand."""

import pytest

from engine_bridge.film import scene
from engine_bridge.film.scene import SceneError, TakeTable
from engine_bridge.studio.project.film_file import FilmFile
from puppetline.errors import ServiceError

HAND = """# our first film
[film]
size = [640, 360]

[[character]]
name = "dog"
puppet = "dog.toml"
height = 0.9 # as tall as Bello

[[take]]
character = "dog"
file = "elsewhere.log"
stop = 2.0
fade = 1.0

[[title]]
text = "The end"
"""


@pytest.fixture
def film(tmp_path):
    return FilmFile(tmp_path, {"takes/take-1.log": 4.0, "takes/take-2.log": 3.0}.get)


def take(number, at, character="dog", **more):
    return TakeTable(character=character, file=f"takes/take-{number}.log", at=at, **more)


def test_takes_and_characters_become_a_scene_that_film_accepts(film):
    assert film.takes == []
    takes = [take(2, 1.0, "cat", start=0.5), take(1, 0.0, stop=2.0, mute=True)]
    film.replace(takes, ["takes/take-1.log", "takes/take-2.log"])
    assert film.takes == [takes[1], takes[0].model_copy(update={"stop": 3.0})]
    read = scene.load(film.path)
    assert [(each.name, each.puppet, each.position) for each in read.character] == [
        ("dog", "characters/dog/live.toml", (0.0, 0.0)),
        ("cat", "characters/cat/live.toml", (1.2, 0.0)),
    ]
    assert read.take[1].stop is None
    film.remove("dog")
    assert [each.character for each in film.takes] == ["cat"]
    assert [each.name for each in scene.load(film.path).character] == ["cat"]


def test_what_was_written_by_hand_stays_and_omitted_times_are_those_that_apply(film):
    film.path.write_text(HAND + '\n[[take]]\ncharacter = "dog"\nfile = "takes/take-1.log"\n')
    first, second = film.takes
    assert (first.at, first.stop, first.fade) == (0.0, 2.0, 1.0)
    assert (second.at, second.stop) == (2.0, 4.0)
    film.replace([second, first], [])
    text = film.path.read_text()
    for line in ("# our first film", "height = 0.9 # as tall as Bello", 'text = "The end"', "fade = 1.0"):
        assert line in text
    assert film.takes == [first, second]


def test_two_takes_of_a_character_never_begin_at_the_same_time(film):
    film.replace([take(1, 1.0), take(2, 1.0)], ["takes/take-1.log", "takes/take-2.log"])
    assert [each.at for each in film.takes] == [1.0, 1.1]


def test_no_request_puts_another_file_into_the_film(film):
    with pytest.raises(ServiceError) as caught:
        film.replace([TakeTable(character="dog", file="/etc/passwd")], ["takes/take-1.log"])
    assert caught.value.found == "the file '/etc/passwd'"
    film.remove("dog")
    assert not film.path.exists()


def test_a_mistake_of_a_person_is_told_with_its_line(film):
    film.path.write_text("[film\n")
    with pytest.raises(SceneError) as caught:
        film.takes  # noqa: B018
    assert "line 1" in caught.value.found
