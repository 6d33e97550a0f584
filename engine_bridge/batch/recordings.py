"""The recordings of a batch: files, folders, patterns and lists of them."""

import glob
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path, PurePath

from capture.formats import recognize
from capture.formats.options import ReadOptions
from puppetline.errors import SkeletonLogError
from puppetline.files import read_whole

LIST_MARK = "@"
"""First character of an argument that names a file with a list."""


@dataclass(frozen=True)
class Recording:
    """A recording to convert.

    Attributes
    ----------
    name : str
        Name of its results, without ending and with "/" between folders.
    path : Path
        Absolute path.
    """

    name: str
    path: Path


@dataclass(frozen=True)
class Recordings:
    """The recordings that were found.

    Attributes
    ----------
    found : list of Recording
        Sorted by name; names and paths are unique.
    others : list of Path
        Files in folders that are not recordings.
    """

    found: list[Recording]
    others: list[Path]


def find_recordings(arguments: Iterable[str], excluded: Path, options: ReadOptions) -> Recordings:
    """Find the recordings that the arguments of a command refer to.

    An argument is a file, a folder, which is searched with all folders in it, a pattern with ``*``, ``?``, ``[…]`` or
    ``**``, or ``@`` and the name of a file with one of these per line. In folders, only files with the content of a
    recording are used, and empty or unreadable files, which are reported as failed. Hidden files are skipped.

    Parameters
    ----------
    arguments : iterable of str
    excluded : Path
        Folder that is not searched.
    options : ReadOptions
        How they are read; text in folders is a recording if its columns or joints are named.

    Raises
    ------
    SkeletonLogError
        An argument refers to nothing, there is no recording at all, or two recordings have the same name.
    """
    recordings: dict[Path, Recording] = {}
    others: dict[Path, None] = {}
    arguments = list(arguments)
    for argument in arguments:
        listed = argument.startswith(LIST_MARK)
        for each in _listed(Path(argument[1:])) if listed else [argument]:
            for recording, is_chosen in _candidates(each, excluded.absolute(), must_exist=not listed):
                if recording.path in recordings or recording.path in others:
                    continue
                if is_chosen or _may_be_recording(recording.path, options):
                    recordings[recording.path] = recording
                else:
                    others[recording.path] = None
    if not recordings:
        raise SkeletonLogError(
            ", ".join(arguments),
            found=f"{len(others):,} files, none of which is a recording" if others else "no file",
            expected="recordings in a format that puppetline inspect recognises",
            fix="Check the path of the folder or list.",
        )
    return Recordings(sorted(_with_unique_names(list(recordings.values())), key=lambda each: each.name), list(others))


def _listed(path: Path) -> list[str]:
    """Return the lines of a list; blank lines and lines that begin with # are comments."""
    text = read_whole(path, "a list of recordings, one per line", SkeletonLogError).decode(errors="surrogateescape")
    return [line for each in text.splitlines() if (line := each.strip()) and not line.startswith("#")]


def _candidates(argument: str, excluded: Path, *, must_exist: bool) -> Iterator[tuple[Recording, bool]]:
    """Yield the files of an argument, and whether each is used whatever it contains."""
    path = Path(argument)
    if path.is_dir():
        yield from _files_in(path, path.rglob("*"), excluded)
    elif path.exists() or not glob.has_magic(argument):
        if must_exist and not path.exists():
            raise SkeletonLogError(
                path,
                found="no such file or folder",
                expected="a recording, a folder, a pattern or @LIST",
                fix="Check the path.",
            )
        yield Recording(path.stem, path.absolute()), True
    else:
        matching = sorted(map(Path, glob.glob(argument, recursive=True)))  # noqa: PTH207  # an absolute or relative pattern
        if not matching:
            raise SkeletonLogError(
                argument, found="no matching file", expected="a pattern of recordings", fix="Check the pattern."
            )
        base = _fixed_folder(path)
        for each in matching:
            files = _files_in(base, each.rglob("*") if each.is_dir() else [each], excluded)
            yield from ((recording, is_chosen or each.is_file()) for recording, is_chosen in files)


def _fixed_folder(pattern: Path) -> Path:
    """Return the folder in front of the first part of a pattern that has a wildcard."""
    parts = list(pattern.parts)
    fixed = next(index for index, part in enumerate(parts) if glob.has_magic(part))
    return Path(*parts[:fixed])


def _files_in(base: Path, paths: Iterable[Path], excluded: Path) -> Iterator[tuple[Recording, bool]]:
    """Yield the visible files of some paths below a folder, without those in the excluded folder."""
    for path in sorted(paths):
        inside, absolute = path.relative_to(base), path.absolute()
        hidden = any(part.startswith(".") for part in inside.parts)
        if path.is_file() and not hidden and not absolute.is_relative_to(excluded):
            yield Recording(inside.with_suffix("").as_posix(), absolute), False


def _may_be_recording(path: Path, options: ReadOptions) -> bool:
    """Return whether a file is a recording, or one that its conversion should report: empty or unreadable."""
    try:
        return path.stat().st_size == 0 or recognize(path, options) is not None
    except (OSError, SkeletonLogError):
        return True


def _with_unique_names(recordings: list[Recording]) -> list[Recording]:
    """Add the endings of the files to names that several recordings share."""
    counts = Counter(each.name for each in recordings)
    named = [
        replace(each, name=PurePath(each.name).with_name(each.path.name).as_posix()) if counts[each.name] > 1 else each
        for each in recordings
    ]
    paths: dict[str, Path] = {}
    for each in named:
        other = paths.setdefault(each.name, each.path)
        if other != each.path:
            raise SkeletonLogError(
                each.path,
                found=f"the same name as {other}",
                expected="recordings with different names",
                fix="Pass the folder that contains both, or a quoted pattern; their folders then become part of the "
                "names of the results.",
            )
    return named
