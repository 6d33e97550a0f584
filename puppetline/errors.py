"""The one family of errors that a user can cause and mend."""

from pathlib import Path


class PuppetlineError(Exception):
    """Something a user gave does not fit; the message says how to mend it.

    Parameters
    ----------
    where : str or Path
        File, with line or field where that is known (see `at`).
    found, expected : str
        What stands there and what should.
    fix : str
        The next thing to do, as a sentence.
    """

    def __init__(self, where: str | Path, *, found: str, expected: str, fix: str) -> None:
        self.where = str(where)
        self.found = found
        self.expected = expected
        self.fix = fix
        super().__init__(f"{heading(where)} found {found}; expected {expected}. {fix}")


class SkeletonLogError(PuppetlineError):
    """A skeleton log cannot be read."""


class MeshError(PuppetlineError):
    """A mesh or character file cannot be used."""


class PuppetError(PuppetlineError):
    """A puppet file, or a mapping or handle given by hand, is wrong."""


class SourceError(PuppetlineError):
    """A live source of skeletons cannot be opened, or has ended."""


class ServiceError(PuppetlineError):
    """The live service cannot start as it is set up, or cannot do what it is asked."""


class OutputError(PuppetlineError):
    """A result cannot be written."""


def heading(where: str | Path) -> str:
    """Begin what is said of a file or a source: ``take.csv:``, or ``openni:``, whose name ends with the colon."""
    return f"{str(where).removesuffix(':')}:"


def at(path: str | Path, line: int | None = None, field: str | None = None) -> str:
    """Name a place in a file: ``take.csv, line 7`` or ``dog.toml, handle[2].joint``."""
    parts = [str(path)]
    if line is not None:
        parts.append(f"line {line}")
    if field is not None:
        parts.append(field)
    return ", ".join(parts)
