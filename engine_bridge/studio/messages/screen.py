"""What a screen of visitors gets from ``GET /screen``."""

from puppetline.toml_schema import Table


class ScreenSettings(Table):
    """Everything about a screen that the stream does not say; a screen asks for it every few seconds.

    Attributes
    ----------
    version : str
        Of the page, its branding and the characters: a screen loads its page again when it changes.
    models : list of str
        Characters whose materials are at ``/screen/models/NAME.glb``.
    kiosk : KioskScreen or None
        None for a service without ``[kiosk]``.
    """

    version: str
    models: list[str]
    kiosk: "KioskScreen | None"


class KioskScreen(Table):
    """The settings of ``[kiosk]`` that its screen shows.

    Attributes
    ----------
    title : str
    files : list of str
        Those of ``logo`` and ``film`` that there are, at ``/screen/files/NAME``.
    background, color, accent : str
    languages : list of str
    texts : dict
        Texts by language and name that replace those of the page.
    minutes : float
        Minutes for which a film is offered.
    longest : float
        Maximum length of a recording in seconds.
    phones : str or None
        Beginning of the addresses of films; None without a network.
    """

    title: str
    files: list[str]
    background: str
    color: str
    accent: str
    languages: list[str]
    texts: dict[str, dict[str, str]]
    minutes: float
    longest: float
    phones: str | None
