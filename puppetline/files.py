"""Reading of whole files, and writing of results that are complete or absent."""

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
        Parts of the error's message.
    family : type
        Class of the error.

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


@contextmanager
def output_errors(path: Path) -> Iterator[None]:
    """Turn an error of the operating system into one about a file, for example because of permissions or a full disk.

    Raises
    ------
    OutputError
    """
    try:
        yield
    except OSError as error:
        raise OutputError(
            path,
            found=f"a file that cannot be written ({error.strerror})",
            expected="a folder with write permission and free space",
            fix="Choose another folder, free disk space, or change the folder's permissions.",
        ) from error


def check_writable(path: Path, ending: str, inputs: Iterable[Path] = ()) -> None:
    """Check before the work whether its result can be written.

    Parameters
    ----------
    path : Path
    ending : str
        Required end of the file's name, for example ``".glb"``.
    inputs : iterable of Path
        Files that the result must not replace.

    Raises
    ------
    OutputError
        The file cannot be written, has another ending, or is one of the inputs.
    """
    with output_errors(path):
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
                fix="Choose another folder." if path.parent.exists() else f"Create it: mkdir -p {path.parent}",
            )
        if any(path.resolve() == other.resolve() for other in inputs):
            raise OutputError(path, found="an input file", expected="another file", fix="Choose another name with -o.")
        beside = _beside(path)
        try:
            beside.touch()
        finally:  # also after an interrupt, which may come between the two
            beside.unlink(missing_ok=True)


def check_one_of(path: Path, endings: Iterable[str], expected: str, fix: str, inputs: Iterable[Path] = ()) -> None:
    """Check before the work whether its result can be written with one of several endings.

    Parameters
    ----------
    path : Path
    endings : iterable of str
    expected, fix : str
        Parts of the message about another ending.
    inputs : iterable of Path
        Files that the result must not replace.

    Raises
    ------
    OutputError
    """
    ending = path.suffix.lower()
    if ending not in endings:
        raise OutputError(path, found=f"the ending {path.suffix!r}", expected=expected, fix=fix)
    check_writable(path, ending, inputs)


REPLACING = "Choose another name, or replace it with --force."
"""How to go on when a file of this name exists already."""


def check_new(path: Path, fix: str = REPLACING, expected: str = "a new name") -> None:
    """Check before the work that a result replaces no file.

    Parameters
    ----------
    path : Path
    fix, expected : str, optional
        Parts of the error's message.

    Raises
    ------
    OutputError
        The file exists.
    """
    if path.exists():
        raise OutputError(path, found="an existing file", expected=expected, fix=fix)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield a name in the folder of `path` to write to; rename it to `path` if the block succeeds.

    The data are on the disk before they have the name, so that a power cut leaves no empty file.

    Raises
    ------
    OutputError
        The operating system refuses, for example because of permissions or a full disk.
    """
    beside = _beside(path)
    with output_errors(path):
        try:
            yield beside
            with beside.open("rb+") as written:  # Windows synchronises what is open for writing
                os.fsync(written.fileno())
            beside.replace(path)
        finally:
            beside.unlink(missing_ok=True)


def append_error(path: Path, error: OSError) -> OutputError:
    """Return the error for a file that is written piece by piece and that the operating system refuses to write."""
    return OutputError(
        path,
        found=f"a file that cannot be written ({error.strerror or error})",
        expected="a writable file with enough disk space",
        fix="Choose another path, free disk space, or change the permissions.",
    )


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
