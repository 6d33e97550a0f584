"""The film that takes become, and requests that edit, play and make it."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from engine_bridge.film.scene import CharacterTable, SetTables, TakeTable
from engine_bridge.pictures.surroundings import Lighting
from engine_bridge.studio.messages.base import Request, Seconds
from puppetline.toml_schema import Table

MAX_ROWS = 1000
"""Maximum number of rows of a kind in the film."""


class FilmScene(SetTables):
    """The tables of the film's scene file besides its takes, as they are written there (docs/film.md)."""

    character: Annotated[tuple[CharacterTable, ...], Field(max_length=MAX_ROWS)] = ()


class FilmState(Table):
    """The film: its takes, the other tables of its scene file, its light, and what is wrong with the file, if anything.

    `at` and `stop` of takes are those that apply, also where the scene file omits them.
    """

    takes: Sequence[TakeTable] = ()
    scene: FilmScene = FilmScene()
    light: Lighting = Field(default_factory=Lighting)
    problem: str = ""


class EditFilm(Request):
    """Replace the takes of the film if there are `takes`, and the other tables of its scene file if there is `scene`.

    Result: `FilmState`.

    The `file` of a take is ``takes/NAME.log``, and that of a sound or a picture ``media/NAME``, or one that the film
    has. Characters that are not in `scene` stay as they are, and no character's `puppet` changes.
    """

    do: Literal["edit_film"]
    takes: Annotated[list[TakeTable], Field(max_length=MAX_ROWS)] | None = None
    scene: FilmScene | None = None


class PlayFilm(Request):
    """Play the film's takes on the characters, from a second on. Result: ``{}``."""

    do: Literal["play_film"]
    at: Seconds = 0.0


class PlanFilm(Request):
    """Compute what the film shows at each moment, which the page shows while it plays. Result: `FilmPlan`."""

    do: Literal["plan_film"]


class MakeFilm(Request):
    """Make a video of the film, a job.

    Result: `FilmReply`.
    """

    do: Literal["make_film"]


class FilmReply(Table):
    """A film that was made: a file to download, its duration in seconds, and sentences about its takes."""

    file: str
    name: str
    seconds: float
    notes: Sequence[str]


class ShareFilm(Request):
    """Let phones in the same network open a film that was made. Result: `ShareReply`."""

    do: Literal["share_film"]
    file: str


class ShareReply(Table):
    """A film that is shared: its address for phones, the QR code of it (SVG, base64), and a poster to download."""

    address: str
    code: str
    poster: str
    poster_name: str


class Install(Request):
    """Install what a webcam, films or a microphone require, an extra, with pip, a job. Result: ``{}``."""

    do: Literal["install"]
    extra: Literal["camera", "film", "sound"]
