"""The film that takes become, and requests that edit, play and make it."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from engine_bridge.film.scene import TakeTable
from engine_bridge.studio.messages.base import Request, Seconds
from puppetline.toml_schema import Table


class FilmState(Table):
    """The film: its tables ``[[take]]`` (docs/film.md), and what is wrong with its scene file, empty if nothing.

    `at` and `stop` are those that apply, also where the scene file omits them.
    """

    takes: Sequence[TakeTable] = ()
    problem: str = ""


class EditFilm(Request):
    """Replace the takes of the film; each `file` is ``takes/NAME.log``, or one that it has. Result: `FilmState`."""

    do: Literal["edit_film"]
    takes: Annotated[list[TakeTable], Field(max_length=1000)]


class PlayFilm(Request):
    """Play the film's takes on the characters, from a second on. Result: ``{}``."""

    do: Literal["play_film"]
    at: Seconds = 0.0


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


class Install(Request):
    """Install what a webcam, films or a microphone require, an extra, with pip, a job. Result: ``{}``."""

    do: Literal["install"]
    extra: Literal["camera", "film", "sound"]
