"""Cache of computed arrays in files, whose names are hashes of the inputs."""

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

VERSION = 32
"""Version of the cached arrays; raise it whenever the code computes other arrays from the same inputs."""

MAX_CACHE_BYTES = 1_000_000_000
"""Maximum total size of the files in bytes; beyond it, the least recently used files are deleted."""

CONTENTS_ARRAY = "content"
"""Name of the array in a file that lists the key and the names of the other arrays."""


def cache_key(*things: object) -> str:
    """Return a name for the results of inputs: a hash of all arrays and of the `repr` of all other inputs."""
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
    """Read arrays from their file, or compute them and write the file.

    A damaged file, or one with other contents, is replaced, and a warning is logged. If the folder cannot be written, a
    warning is logged too. A file that is no longer current is replaced without a warning.

    Parameters
    ----------
    folder : Path or None
        Created if it does not exist; None for no cache.
    key : str
        From `cache_key`, with all inputs of the arrays.
    make : callable
        Computes the arrays; its errors are passed on.
    is_current : callable, optional
        Returns whether cached arrays are still valid, for inputs that are not in the key.
    """
    if folder is None:
        return make()
    path = folder / f"{key}.npz"
    if path.exists():
        try:
            arrays = _read(path, key)
            if is_current(arrays):
                return arrays
        except Exception as error:  # any error in a cache file has the same fix
            log.warning("%s: unreadable cache file (%s), computing again", path, error)
    arrays = make()
    try:
        _write(path, key, arrays)
        _make_room(folder)
    except OSError as error:
        log.warning("%s: could not save the results for the next start: %s", path, error)
    return arrays


def _read(path: Path, key: str) -> Arrays:
    """Read a file, whose arrays have checksums, and mark it as used."""
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    if arrays.pop(CONTENTS_ARRAY).tolist() != [key, *arrays]:
        raise ValueError("other or missing arrays")
    with suppress(OSError):  # a read-only folder has no order of use
        path.touch()
    return arrays


def _write(path: Path, key: str, arrays: Arrays) -> None:
    """Write a file completely: under a temporary name, which is then changed."""
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
    """Delete the least recently used files beyond the maximum size."""
    room = MAX_CACHE_BYTES
    for path, state in sorted(
        ((path, path.stat()) for path in folder.glob("*.npz")), key=lambda each: -each[1].st_mtime
    ):
        room -= state.st_size
        if room < 0:
            path.unlink(missing_ok=True)
