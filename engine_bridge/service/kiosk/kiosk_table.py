"""[kiosk] of the service file: recordings by gesture, films, and what the visitors' screen shows."""

import re
from typing import Annotated

from pydantic import Field, FiniteFloat, model_validator

from engine_bridge.service.security.endpoints import Text
from puppetline.toml_schema import FilmSet, FilmSize, Table, mistake

LANGUAGES = ("en", "de", "es", "fr", "it", "nl")
"""Languages in which the screen has texts of its own."""

Color = Annotated[str, Field(pattern=r"^#[0-9a-fA-F]{6}$")]
Language = Annotated[str, Field(pattern=r"^[a-z]{2,3}(-[A-Za-z]{2,4})?$")]


class ScreenTexts(Table):
    """[kiosk.screen.texts.LANGUAGE]: texts that replace those of the screen."""

    invite: Text | None = None
    stand: Text | None = None
    raise_hands: Text | None = None
    count: Text | None = None
    recording: Text | None = None
    making: Text | None = None
    film: Text | None = None
    minutes: Text | None = None


class ScreenTable(Table):
    """[kiosk.screen]: branding of the visitors' screen; files are relative to the service file.

    Attributes
    ----------
    title, logo : str or None
        Text and image file at the top.
    film : str or None
        .mp4 or .webm that plays in a loop while no performer is in view; without it, the character plays its `idle`.
    background, color, accent : str
        Colours of the ground, of texts and of what matters, such as ``"#101828"``.
    languages : tuple of str
        The first is written large, the others below it.
    texts : dict
        Texts by language. A language that the screen does not have must have all of them.
    """

    title: Text | None = None
    logo: Text | None = None
    film: Text | None = None
    background: Color = "#131a2b"
    color: Color = "#ffffff"
    accent: Color = "#ffb020"
    languages: Annotated[tuple[Language, ...], Field(min_length=1, max_length=3)] = ("en",)
    texts: dict[Language, ScreenTexts] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _texts_are_complete(self) -> "ScreenTable":
        for language in self.languages:
            texts = self.texts.get(language, ScreenTexts()).model_dump()
            missing = [key for key, text in texts.items() if text is None]
            if language not in LANGUAGES and missing:
                raise mistake(
                    "texts",
                    language,
                    found=f"no text for {', '.join(missing)}",
                    expected=f"all texts of a language other than {', '.join(LANGUAGES)}",
                    fix=f"Write them into [kiosk.screen.texts.{language}].",
                )
        return self


class KioskTable(Table):
    """[kiosk]: visitors record themselves by holding both hands above their heads, see `Kiosk`.

    Attributes
    ----------
    hands_up : float
        Seconds for which they hold them.
    count_in : int
        Seconds from the gesture to the recording.
    longest : float
        Seconds after which a recording ends without the gesture.
    minutes : float
        Minutes after which a visitor's take, sound and film are deleted.
    size : (int, int)
        Width and height of the films, in pixels.
    set : str
        Landscape or room around the characters of the films.
    phone_port : int
        Port at which visitors' phones get their films, on all addresses of this machine; 0 for none.
    phone_address : str or None
        Address by which phones reach that port, such as ``"https://films.example"``; without it, it is found.
    screen : ScreenTable
    """

    hands_up: Annotated[FiniteFloat, Field(strict=True, ge=0.5, le=10)] = 2.0
    count_in: Annotated[int, Field(strict=True, ge=0, le=10)] = 3
    longest: Annotated[FiniteFloat, Field(strict=True, ge=1, le=600)] = 60.0
    minutes: Annotated[FiniteFloat, Field(strict=True, gt=0, le=1440)] = 10.0
    size: FilmSize = (1280, 720)
    set: FilmSet = "stage"
    phone_port: Annotated[int, Field(strict=True, ge=0, le=65535)] = 7481
    phone_address: Text | None = None
    screen: ScreenTable = ScreenTable()

    @model_validator(mode="after")
    def _address_is_one(self) -> "KioskTable":
        if self.phone_address is not None and not re.fullmatch(r"https?://[^\s/?#]+", self.phone_address):
            raise mistake(
                "phone_address",
                found=repr(self.phone_address),
                expected="the beginning of an address",
                fix="Write it like https://films.example or http://192.168.1.5:7481.",
            )
        return self
