"""The studio's scene file: takes from the page, and what people have written by hand."""

import pytest

from engine_bridge.film import scene
from engine_bridge.film.scene import BubbleTable, CameraTable, MusicTable, SceneError, TakeTable
from engine_bridge.studio.messages.film import FilmScene
from engine_bridge.studio.project.film_file import FilmFile
from puppetline.errors import ServiceError

from ...refusals import refused

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


def test_tables_of_the_scene_are_replaced_where_they_differ_and_come_back_as_they_were(film):
    film.path.write_text(HAND)
    before, takes = film.scene, film.takes
    dog = scene.CharacterTable(name="dog", puppet="/etc/passwd", position=(1.0, 0.0), height=0.5, color="red")
    wanted = FilmScene(
        film=scene.FilmTable(size=(640, 360), fade_in=1.0),
        character=(dog,),
        music=MusicTable(loop="calm"),
        camera=(CameraTable(), CameraTable(at=2.0, shot="close", show=("dog",))),
        background=scene.BackgroundTable(set="snow"),
        title=before.title,
        bubble=(BubbleTable(character="dog", text="Woof"),),
    )
    film.replace(takes, [], wanted)
    assert film.scene == wanted.model_copy(update={"character": (dog.model_copy(update={"puppet": "dog.toml"}),)})
    assert scene.load(film.path).title == before.title
    text = film.path.read_text()
    for line in ("# our first film", "size = [640, 360]", "height = 0.5 # as tall as Bello"):
        assert line in text
    film.replace(takes, [], before)
    assert film.scene == before
    film.replace(takes, [], before.model_copy(update={"character": ()}))
    assert film.scene == before


def test_new_characters_stand_beside_the_others_without_touching_them_and_leave_with_all_that_names_them(film):
    widths = {"dog": 1.0, "dragon": 6.0, "cat": 0.4, "mouse": 0.1}
    for name in widths:
        film.introduce(name, widths)
        film.introduce(name, widths)
    places = {each.name: each.position[0] for each in film.scene.character}
    assert places == {"dog": 0.0, "dragon": 3.8, "cat": -1.0, "mouse": -1.55}
    shots = (CameraTable(show=("dog",), behind="cat"), CameraTable(at=1.0, show=("dog", "cat")))
    bubbles = (BubbleTable(character="cat", kind="name"),)
    film.replace([], [], film.scene.model_copy(update={"camera": shots, "bubble": bubbles}))
    film.remove("cat")
    assert film.scene.bubble == ()
    assert film.scene.camera == (CameraTable(show=("dog",)), CameraTable(at=1.0, show=("dog",)))


@pytest.mark.parametrize(
    "wrong",
    [
        {"camera": (CameraTable(show=("cat",)),)},
        {"camera": (CameraTable(at=1.0), CameraTable(at=1.0))},
        {"music": MusicTable(file="../secret.mp3")},
        {"background": scene.BackgroundTable(picture="/etc/passwd")},
        {"title": (scene.TitleTable(text="Hi", font="/etc/passwd"),)},
    ],
)
def test_a_scene_that_does_not_fit_or_names_other_files_changes_nothing(film, wrong):
    film.path.write_text(HAND)
    with pytest.raises((SceneError, ServiceError)):
        film.replace(film.takes, ["media/song.mp3"], film.scene.model_copy(update=wrong))
    assert film.path.read_text() == HAND


def test_two_takes_of_a_character_never_begin_at_the_same_time(film):
    film.replace([take(1, 1.0), take(2, 1.0)], ["takes/take-1.log", "takes/take-2.log"])
    assert [each.at for each in film.takes] == [1.0, 1.1]


def test_no_request_puts_another_file_into_the_film(film):
    taken = [TakeTable(character="dog", file="/etc/passwd")]
    assert refused(ServiceError, film.replace, taken, ["takes/take-1.log"]).found == "the file '/etc/passwd'"
    film.remove("dog")
    assert not film.path.exists()


def test_a_mistake_of_a_person_is_told_and_nothing_is_written_over_it(film):
    film.path.write_text(HAND.replace("height = 0.9", "height = -1"))
    refused(SceneError, film.replace, [], [], FilmScene())
    assert "height = -1" in film.path.read_text()
    film.path.write_text("[film\n")
    assert "line 1" in refused(SceneError, lambda: film.takes).found
