"""Errors that a user can cause and fix."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path


class PuppetlineError(Exception):
    """Something that a user gave cannot be used; the message says how to fix it.

    Parameters
    ----------
    where : str or Path
        File, with line or field if known (see `at`).
    found, expected : str
        Noun phrases: what is there, and what should be.
    fix : str
        What to do next, as a sentence.
    """

    def __init__(self, where: str | Path, *, found: str, expected: str, fix: str) -> None:
        self.where = str(where)
        self.found = found
        self.expected = expected
        self.fix = fix
        super().__init__(f"{heading(where)} found {found}; expected {expected}. {fix}")

    @property
    def parts(self) -> dict[str, str]:
        """The four parts by name, as programs read them."""
        return {"where": self.where, "found": self.found, "expected": self.expected, "fix": self.fix}

    def __reduce__(self) -> tuple[Callable[[str], "PuppetlineError"], tuple[str]]:
        """Return how to make the error again in another process, which its message alone cannot do."""
        return partial(type(self), found=self.found, expected=self.expected, fix=self.fix), (self.where,)


class SkeletonLogError(PuppetlineError):
    """A skeleton log cannot be read."""


class MeshError(PuppetlineError):
    """A mesh or character file cannot be used."""


class PuppetError(PuppetlineError):
    """A puppet file, or a mapping or handle given by hand, is wrong."""


class SourceError(PuppetlineError):
    """A live source of skeletons cannot be opened, or has ended."""


class RecordingEndError(SourceError):
    """A recording that a source plays has ended, as it should."""


class ServiceError(PuppetlineError):
    """The live service cannot start with its settings, or cannot do what a client requests."""


class OutputError(PuppetlineError):
    """A result cannot be written."""


def unknown_name(where: str, found: str, known: Iterable[str]) -> ServiceError:
    """Return the error for a request with a name that does not exist.

    Parameters
    ----------
    where, found : str
        Parts of the message.
    known : iterable of str
        The names that exist.
    """
    names = ", ".join(known)
    expected, fix = (f"one of {names}", "Choose one of these.") if names else ("one that exists", "There is none yet.")
    return ServiceError(where, found=found, expected=expected, fix=fix)


def heading(where: str | Path) -> str:
    """Return a file or source with one colon: ``take.csv:``, or ``openni:``, whose name already ends with it."""
    return f"{str(where).removesuffix(':')}:"


def at(path: str | Path, line: int | None = None, field: str | None = None) -> str:
    """Return the name of a place in a file: ``take.csv, line 7`` or ``dog.toml, handle[2].joint``."""
    parts = [str(path)]
    if line is not None:
        parts.append(f"line {line}")
    if field is not None:
        parts.append(field)
    return ", ".join(parts)
