"""What `puppetline doctor` found of one thing."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes
    ----------
    name : str
    ok : bool or None
        None for what is not there and need not be.
    detail : str
        What was found.
    fix : str
        What to do, empty where there is nothing to do.
    """

    name: str
    ok: bool | None
    detail: str
    fix: str = ""
