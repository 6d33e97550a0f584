"""What was computed once, kept in files: each under a name that stands for all that it was made of."""

import hashlib
import logging
import os
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

log = logging.getLogger(__name__)

Arrays = dict[str, NDArray[Any]]

VERSION = 9
"""Goes up whenever anything that is kept would differ from a new one."""

MAX_CACHE_BYTES = 1_000_000_000
"""Bytes of all files together; beyond, those go that were not used for the longest time."""

CONTENTS_ARRAY = "content"
"""The array in a file that says what belongs in it: the key, and the names of the other arrays."""


def cache_key(*things: object) -> str:
    """Return a name for what is made of some things: equal for equal arrays and equal words for the rest, only then."""
    digest = hashlib.sha256(str(VERSION).encode())
    for thing in things:
        if isinstance(thing, np.ndarray):
            digest.update(repr((thing.dtype.str, thing.shape)).encode())
            digest.update(np.ascontiguousarray(thing).data)
        else:
            digest.update(repr(thing).encode())
    return digest.hexdigest()[:32]


def load_or_compute(
    folder: Path | None, key: str, make: Callable[[], Arrays], is_current: Callable[[Arrays], bool] = lambda _: True
) -> Arrays:
    """Take arrays from their file, or make them and write that file.

    A file that is damaged, or holds something else, is made anew with a warning in the log; a folder that cannot be
    written costs the next start its speed and nothing more.

    Parameters
    ----------
    folder : Path or None
        Made where it does not exist; None for nothing to be kept.
    key : str
        From `cache_key`, with all that the arrays depend on.
    make : callable
        Any error of it is passed on.
    is_current : callable, optional
        Tells whether arrays that were kept still hold, for what their key cannot say.
    """
    if folder is None:
        return make()
    path = folder / f"{key}.npz"
    if path.exists():
        try:
            arrays = _read(path, key)
            if is_current(arrays):
                return arrays
        except Exception as error:  # whatever is wrong with a cache, the cure is the same
            log.warning("%s: %s: it is made anew", path, error)
    arrays = make()
    try:
        _write(path, key, arrays)
        _make_room(folder)
    except OSError as error:
        log.warning("%s: %s: nothing is kept for the next start", path, error)
    return arrays


def _read(path: Path, key: str) -> Arrays:
    """Read a file back; each array in it carries a checksum."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    if arrays.pop(CONTENTS_ARRAY).tolist() != [key, *arrays]:
        raise ValueError("it belongs to something else, or is not whole")
    with suppress(OSError):  # a folder that is only read has no order to keep
        path.touch()
    return arrays


def _write(path: Path, key: str, arrays: Arrays) -> None:
    """Write a file beside and then rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    content: dict[str, Any] = {CONTENTS_ARRAY: np.array([key, *arrays]), **arrays}
    try:
        with beside.open("wb") as file:
            np.savez(file, **content)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)


def _make_room(folder: Path) -> None:
    """Remove the files that were not used for the longest time, as many as are too many."""
    room = MAX_CACHE_BYTES
    for path, state in sorted(
        ((path, path.stat()) for path in folder.glob("*.npz")), key=lambda each: -each[1].st_mtime
    ):
        room -= state.st_size
        if room < 0:
            path.unlink(missing_ok=True)
