"""What `puppetline doctor` found of one thing."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes
    ----------
    name : str
    ok : bool or None
        True for what works. False for what does not, although Puppetline requires it or the user has asked for it: only
        this is a fault. None for what is optional and not there, or cannot be used now.
    detail : str
        What was found.
    fix : str
        What would install, free or improve it, empty where there is nothing to do.
    """

    name: str
    ok: bool | None
    detail: str
    fix: str = ""
