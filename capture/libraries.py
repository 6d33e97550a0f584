"""Errors for optional libraries that sensors require: a library that is missing, or one that cannot be loaded."""

import ctypes.util
import importlib
from typing import Any

from puppetline.errors import SourceError

UNLOADABLE = "a library that cannot be loaded"


class NotInstalledError(SourceError):
    """A library that a source requires is not installed. A library that cannot be loaded is a plain SourceError."""


def load_module(module: str, where: str, *, found: str, expected: str, fix: str) -> Any:
    """Return a Python module.

    Parameters
    ----------
    module, where : str
    found, expected, fix : str
        Parts of the error's message; the reason is added to the first.

    Raises
    ------
    SourceError
        It cannot be imported; `NotInstalledError` if it is the package itself that is missing, and not another one that
        it imports.
    """
    try:
        return importlib.import_module(module)
    except (ImportError, OSError) as error:  # OSError: a shared library is missing
        missing = isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]
        kind = NotInstalledError if missing else SourceError
        raise kind(where, found=f"{found} ({error})", expected=expected, fix=fix) from error


def load_error(library: str) -> type[SourceError]:
    """Return the class of error for a shared library that cannot be loaded, named without prefix and suffix."""
    return NotInstalledError if ctypes.util.find_library(library) is None else SourceError
