"""The folder of takes: a name from the network becomes a file here and nowhere else."""

import re
from contextlib import suppress
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import Any

from puppetline.errors import OutputError, ServiceError

ENDING = ".log"

NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")


class Takes:
    """Finds and names takes.

    Parameters
    ----------
    folder : Path
        Made when the first take begins.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def new(self, name: str | None, stage: str) -> Path:
        """Return a file for a new take.

        Parameters
        ----------
        name : str or None
            Letters, digits, _ and -; made of the stage and the time where there is none.
        stage : str

        Raises
        ------
        ServiceError
            A name that is no such name, or there is a take of that name.
        OutputError
            The folder cannot be made.
        """
        name = name or self._unused(f"{stage}-{datetime.now():%Y%m%d-%H%M%S}")
        if not NAME.fullmatch(name):
            raise ServiceError(
                "the take's name",
                found=repr(name),
                expected="up to 64 letters, digits, _ and -",
                fix="Choose such a name: it becomes a file.",
            )
        path = self.folder / f"{name}{ENDING}"
        if path.exists():
            raise ServiceError(
                "the take's name",
                found=f"{name!r}, of which there is a take",
                expected="a new name",
                fix="Choose another one, or leave it out.",
            )
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OutputError(
                self.folder,
                found=f"that it cannot be made ({error.strerror})",
                expected="a folder for takes",
                fix="Choose another one with --takes, or give permission there.",
            ) from error
        return path

    def all(self) -> list[dict[str, Any]]:
        """List the takes: name, bytes, and when it was last written to."""
        if not self.folder.is_dir():
            return []
        facts = []
        for path in sorted(self.folder.glob(f"*{ENDING}")):
            with suppress(OSError):  # deleted at this moment, or a link to nowhere
                stat = path.stat()
                facts.append({"name": path.stem, "bytes": stat.st_size, "written": stat.st_mtime})
        return facts

    def _unused(self, name: str) -> str:
        numbered = (f"{name}-{k}" for k in count(2))
        return next(each for each in chain([name], numbered) if not (self.folder / f"{each}{ENDING}").exists())
