"""Contents of a scene file: characters, takes, sounds, music, cameras, titles, speech bubbles and the set."""

import difflib
from pathlib import Path
from typing import Annotated, ClassVar, Literal, Self

from PIL import ImageColor
from pydantic import BeforeValidator, Field, StrictBool, model_validator

from engine_bridge.puppet.puppet import Number, Text
from puppetline import toml_schema
from puppetline.errors import PuppetlineError
from puppetline.toml_schema import FilmSet, FilmSize, Kind, Table, check_distinct, mistake

MAX_SECONDS = 6 * 3600.0
"""Maximum length of a film, in seconds."""


class SceneError(PuppetlineError):
    """A scene file is wrong."""


def check_exists(path: Path, where: str, kind: str, otherwise: str = "set mute = true") -> None:
    """Refuse a missing file, which a scene file names.

    Parameters
    ----------
    path : Path
    where : str
        Place of its name.
    kind : str
        What the file is: "a recording".
    otherwise : str
        What to do without the file, an imperative.

    Raises
    ------
    SceneError
    """
    if not path.is_file():
        raise SceneError(
            where,
            found=f"the missing file {path}",
            expected=f"{kind}, relative to the scene file",
            fix=f"Correct the path, copy the file there, or {otherwise}.",
        )


def _color(text: object) -> object:
    try:
        ImageColor.getrgb(text if isinstance(text, str) else "")
    except ValueError:
        raise mistake(found=repr(text), expected="a colour", fix='Write it like "#8fb4d9" or "skyblue".') from None
    return text


Mood = Literal["day", "evening", "night", "overcast", "spotlight", "water"]
"""Names of the lights in `engine_bridge.film.moods`."""

Typeface = Literal["plain", "serif", "round", "hand", "poster"]
"""Names of the typefaces in `engine_bridge.film.typeface`; any other value is a file."""

MusicLoop = Literal["cheerful", "calm", "waltz", "adventure", "suspense"]
"""Names of the pieces of music in `engine_bridge.film.music`."""


def _check_at_most_one(table: Table, *keys: str) -> None:
    given = [key for key in keys if getattr(table, key) is not None]
    if len(given) > 1:
        expected = f"one of {', '.join(keys[:-1])} and {keys[-1]}"
        raise mistake(given[1], found=" and ".join(given), expected=expected, fix="Remove the others.")


Color = Annotated[str, BeforeValidator(_color)]
Seconds = Annotated[Number, Field(ge=0, le=MAX_SECONDS)]
Fade = Annotated[Number, Field(ge=0, le=10)]
Gain = Annotated[Number, Field(ge=-80, le=40)]
Place = tuple[Number, Number]


class FilmTable(Table):
    """[film]: size in pixels, frames per second, length, by default until the last take ends, and fades to black."""

    size: FilmSize = (1280, 720)
    fps: Annotated[Number, Field(ge=1, le=120)] = 30.0
    seconds: Annotated[Number, Field(gt=0, le=MAX_SECONDS)] | None = None
    fade_in: Fade = 0.0
    fade_out: Fade = 0.0


class CharacterTable(Table):
    """[[character]]: a puppet, where it stands (metres to the right and to the front), its height and its colour.

    Characters without a position stand side by side.
    """

    name: Text
    puppet: Text
    position: Place | None = None
    turn: Number = 0.0
    height: Annotated[Number, Field(gt=0)] | None = None
    color: Color | None = None


class _PartTable(Table):
    """A part of a file, in its own seconds."""

    start: Seconds = 0.0
    stop: Seconds | None = None

    @model_validator(mode="after")
    def _check_part(self) -> Self:
        if self.stop is not None and self.stop <= self.start:
            raise mistake(
                "stop",
                found=f"{self.stop:g} s",
                expected=f"a time after its start, {self.start:g} s",
                fix="Raise stop, or remove it.",
            )
        return self


class TakeTable(_PartTable):
    """[[take]]: a part of a recording that a character plays, from a time of the film on."""

    character: Text
    file: Text
    user: Annotated[int, Field(strict=True)] | None = None
    at: Seconds | None = None
    loop: Annotated[int, Field(strict=True, ge=1, le=10_000)] = 1
    fade: Fade = 0.3
    position: Place | None = None
    turn: Number | None = None
    sound: StrictBool = True
    mute: StrictBool = False


class SoundTable(_PartTable):
    """[[sound]]: a part of a sound file, from a time of the film on, with its gain in decibels and its fades."""

    file: Text
    at: Seconds = 0.0
    gain: Gain = 0.0
    fade_in: Seconds = 0.0
    fade_out: Seconds = 0.0
    mute: StrictBool = False


class MusicTable(Table):
    """[music]: a piece of `engine_bridge.film.music` or a sound file, repeated until the film ends."""

    loop: MusicLoop | None = None
    file: Text | None = None
    gain: Gain = -14.0
    fade_in: Seconds = 0.5
    fade_out: Seconds = 2.0

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        _check_at_most_one(self, "loop", "file")
        return self


class CameraTable(Table):
    """[[camera]]: a shot, from a time of the film until the next one; its distance follows from what it shows.

    `fade` is the length of the cross-fade from the shot before it, which begins with it. `behind` is the character over
    whose shoulder it looks, by default the nearest one to those that are shown. Without an azimuth, it looks from where
    the other characters are least in the way.
    """

    at: Seconds = 0.0
    shot: Literal["wide", "close", "follow", "over the shoulder"] = "wide"
    show: tuple[Text, ...] = ()
    behind: Text | None = None
    azimuth: Annotated[Number, Field(ge=-360, le=360)] | None = None
    elevation: Annotated[Number, Field(ge=0, le=89)] = 4.0
    field_of_view: Annotated[Number, Field(ge=5, le=120)] = 30.0
    zoom: Annotated[Number, Field(gt=0, le=20)] = 1.0
    fade: Fade = 0.0


class FloorTable(Table):
    """[floor]: whether there is one, and its colour, by default the set's; before a picture, it shows shadows only."""

    show: StrictBool = True
    color: Color | None = None


class LightTable(Table):
    """[light]: its mood, by default the set's."""

    mood: Mood | None = None


DEFAULT_SET: FilmSet = "studio"


class BackgroundTable(Table):
    """[background]: a set, a colour, two colours from top to bottom, or a picture that covers the frame."""

    set: FilmSet | None = None
    color: Color | None = None
    colors: tuple[Color, Color] | None = None
    picture: Text | None = None

    @model_validator(mode="after")
    def _check_one(self) -> Self:
        _check_at_most_one(self, "set", "color", "colors", "picture")
        return self

    @property
    def shown_set(self) -> FilmSet | None:
        """The set, by default `DEFAULT_SET`; None for colours and pictures."""
        return None if self.color or self.colors or self.picture else self.set or DEFAULT_SET


class _TextTable(Table):
    """A text over the picture; its size is a share of the picture's height, `font` a `Typeface` or a file."""

    at: Seconds = 0.0
    seconds: Annotated[Number, Field(gt=0, le=MAX_SECONDS)] = 3.0
    size: Annotated[Number, Field(gt=0, le=1)]
    font: Text = "plain"


class TitleTable(_TextTable):
    """[[title]]: a text over the picture."""

    text: Text
    place: Literal["top", "middle", "bottom"] = "middle"
    size: Annotated[Number, Field(gt=0, le=1)] = 0.09
    color: Color = "white"
    fade: Fade = 0.4


class BubbleTable(_TextTable):
    """[[bubble]]: what a character says or thinks, beside its head, or its name, below it."""

    character: Text
    text: Text | None = None
    kind: Literal["speech", "thought", "name"] = "speech"
    size: Annotated[Number, Field(gt=0, le=1)] = 0.05

    @model_validator(mode="after")
    def _check_text(self) -> Self:
        if self.text is None and self.kind != "name":
            raise mistake("text", found="nothing", expected="what the character says", fix="Add the key text.")
        return self


class SetTables(Table):
    """The tables of a scene file besides characters and takes."""

    film: FilmTable = FilmTable()
    sound: tuple[SoundTable, ...] = ()
    music: MusicTable = MusicTable()
    camera: tuple[CameraTable, ...] = ()
    background: BackgroundTable = BackgroundTable()
    floor: FloorTable = FloorTable()
    light: LightTable = LightTable()
    title: tuple[TitleTable, ...] = ()
    bubble: tuple[BubbleTable, ...] = ()


class Scene(SetTables):
    """All tables of a scene file."""

    file_kind: ClassVar[Kind | None] = "scene"

    character: Annotated[tuple[CharacterTable, ...], Field(min_length=1)]
    take: tuple[TakeTable, ...] = ()

    @model_validator(mode="after")
    def _check_names(self) -> Self:
        names = [each.name for each in self.character]
        check_distinct(names, "character")
        for index, take in enumerate(self.take):
            _check_name(take.character, names, "take", index, "character")
        for index, camera in enumerate(self.camera):
            for number, shown in enumerate(camera.show):
                _check_name(shown, names, "camera", index, "show", number)
            if camera.behind is not None:
                _check_name(camera.behind, names, "camera", index, "behind")
            if camera.behind in camera.show:
                raise mistake(
                    "camera",
                    index,
                    "behind",
                    found=f"{camera.behind!r}, which is shown",
                    expected="a character that looks at those that are shown",
                    fix="Remove the name from show, or remove the key behind.",
                )
        for index, bubble in enumerate(self.bubble):
            _check_name(bubble.character, names, "bubble", index, "character")
        return self

    @model_validator(mode="after")
    def _check_cuts(self) -> Self:
        times = [camera.at for camera in self.camera]
        for index in range(1, len(times)):
            if times[index] <= times[index - 1]:
                raise mistake(
                    "camera",
                    index,
                    "at",
                    found=f"{times[index]:g} s after a camera at {times[index - 1]:g} s",
                    expected="cameras in the order of their times",
                    fix="Give each camera a later time than the one before it.",
                )
        return self

    @model_validator(mode="after")
    def _check_length(self) -> Self:
        if self.film.seconds is None and not any(not take.mute for take in self.take):
            raise mistake(
                found="no take",
                expected="at least one take, or the length of the film",
                fix="Add a table [[take]], or the key seconds in [film].",
            )
        return self


def load(path: Path) -> Scene:
    """Read and check a scene file.

    Raises
    ------
    SceneError
        With the line of a syntax error, or the table and key of anything else.
    """
    text = toml_schema.read_text(path, "a scene file", "Check the path; docs/film.md shows a scene file.", SceneError)
    return toml_schema.check(Scene, toml_schema.parse(text, path, SceneError), path, SceneError)


def _check_name(name: str, names: list[str], *place: str | int) -> None:
    if name not in names:
        close = difflib.get_close_matches(name, names, 1)
        raise mistake(
            *place,
            found=f"{name!r}, which is not the name of a character",
            expected=f"one of {', '.join(names)}",
            fix=f"Did you mean {close[0]!r}?" if close else "Correct the name, or add a table [[character]].",
        )
