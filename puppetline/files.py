"""Files that are read whole, and results that are there whole or not at all."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from puppetline.errors import OutputError, PuppetlineError


def read_whole(
    path: Path, expected: str, family: type[PuppetlineError], fix: str = "Check the path and the file's permissions."
) -> bytes:
    """Read a file.

    Parameters
    ----------
    path : Path
    expected, fix : str
        What an error says should be there, and what to do.
    family : type
        Of the error.

    Raises
    ------
    PuppetlineError
        Of that family.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise family(
            path, found=f"a file that cannot be read ({error.strerror})", expected=expected, fix=fix
        ) from error


def check_writable(path: Path, ending: str, inputs: Iterable[Path] = ()) -> None:
    """Find out before the work, not after it, whether a result can be written.

    Parameters
    ----------
    path : Path
    ending : str
        What the file's name must end in, as ``".glb"``.
    inputs : iterable of Path
        Files that the result must not replace.

    Raises
    ------
    OutputError
    """
    try:
        if path.exists() and not path.is_file():
            raise OutputError(
                path, found="a folder or device", expected="a file name", fix="Add a file name to the path."
            )
        if path.suffix.lower() != ending:
            raise OutputError(
                path, found=f"the ending {path.suffix!r}", expected=repr(ending), fix=f"Call it {path.stem}{ending}."
            )
        if not path.parent.is_dir():
            raise OutputError(
                path,
                found=f"no folder {path.parent}",
                expected="an existing folder",
                fix="Choose another." if path.parent.exists() else f"Make it: mkdir -p {path.parent}",
            )
        if any(path.resolve() == other.resolve() for other in inputs):
            raise OutputError(
                path, found="a file that is read from", expected="another one", fix="Choose another name with -o."
            )
        beside = _beside(path)
        beside.touch()
        beside.unlink()
    except OSError as error:
        raise _refused(path, error) from error


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Give a name beside `path` to write to, and rename it when the block has ended well.

    Raises
    ------
    OutputError
        Whatever the operating system has against it: no room, no permission.
    """
    beside = _beside(path)
    try:
        try:
            yield beside
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise _refused(path, error) from error


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")


def _refused(path: Path, error: OSError) -> OutputError:
    return OutputError(
        path,
        found=f"a file that cannot be written ({error.strerror})",
        expected="a folder that you may write to, with room left",
        fix="Choose another place with -o, or change the folder's permissions.",
    )
