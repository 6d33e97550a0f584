"""Errors for optional libraries that sensors require: a library that is missing, or one that cannot be loaded."""

import ctypes.util

from puppetline.errors import SourceError


class NotInstalledError(SourceError):
    """A library that a source requires is not installed. A library that cannot be loaded is a plain SourceError."""


def import_error(module: str, error: Exception) -> type[SourceError]:
    """Return the class of error for an `error` that occurred while importing a top-level Python module.

    The error may also concern another module that the module imports.
    """
    return NotInstalledError if isinstance(error, ModuleNotFoundError) and error.name == module else SourceError


def load_error(library: str) -> type[SourceError]:
    """Return the class of error for a shared library that cannot be loaded, named without prefix and suffix."""
    return NotInstalledError if ctypes.util.find_library(library) is None else SourceError
