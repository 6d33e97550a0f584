"""The folder of takes, the only place where a name from the network becomes a file."""

import re
from contextlib import suppress
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import Any

from capture import sound
from puppetline.errors import ServiceError, unknown_name
from puppetline.files import output_errors

ENDING = ".log"

NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")


class Takes:
    """Lists and names takes.

    Parameters
    ----------
    folder : Path
        Created when the first take begins.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def new(self, name: str | None, stage: str) -> Path:
        """Return a file for a new take.

        Parameters
        ----------
        name : str or None
            Letters, digits, _ and -; by default, it is made of the stage and the time.
        stage : str

        Raises
        ------
        ServiceError
            An invalid name, or the name of an existing take.
        OutputError
            The folder cannot be created.
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
                found=f"the name of an existing take ({name!r})",
                expected="a new name",
                fix="Choose another name, or omit it.",
            )
        with output_errors(self.folder):
            self.folder.mkdir(parents=True, exist_ok=True)
        return path

    def path(self, name: str) -> Path:
        """Return the file of a take.

        Raises
        ------
        ServiceError
            There is no take of that name.
        """
        names = [each["name"] for each in self.all()]
        if name not in names:
            raise unknown_name("the request, take", f"no take {name!r}", names)
        return self.folder / f"{name}{ENDING}"

    def all(self) -> list[dict[str, Any]]:
        """List the takes: name, size in bytes, time of the last change, and whether there is a sound beside it."""
        if not self.folder.is_dir():
            return []
        facts = []
        for path in sorted(self.folder.glob(f"*{ENDING}")):
            with suppress(OSError):  # deleted at this moment, or a link to nowhere
                stat = path.stat()
                heard = path.with_suffix(sound.ENDING).exists()
                facts.append({"name": path.stem, "bytes": stat.st_size, "written": stat.st_mtime, "sound": heard})
        return facts

    def _unused(self, name: str) -> str:
        numbered = (f"{name}-{k}" for k in count(2))
        return next(each for each in chain([name], numbered) if not (self.folder / f"{each}{ENDING}").exists())
