"""The result of one check."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """The result of one check of `puppetline doctor`.

    Attributes
    ----------
    name : str
    ok : bool or None
        True if it works. False if it does not, although Puppetline requires it or the user has asked for it. None if it
        is optional, and missing or unusable at present.
    detail : str
        What was found.
    fix : str
        What would install, free or improve it; empty if there is nothing to do.
    """

    name: str
    ok: bool | None
    detail: str
    fix: str = ""
