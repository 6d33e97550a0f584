"""Optional libraries that sensors require: whether one that does not load is installed at all."""

import ctypes.util

from puppetline.errors import SourceError


class NotInstalledError(SourceError):
    """A library that a source requires is not installed; one that is installed but does not load is a SourceError."""


def import_error(module: str, error: Exception) -> type[SourceError]:
    """Return the class of error for a Python module that `error` keeps from being imported.

    Parameters
    ----------
    module : str
        Name of the top-level module. The error may also be about a module that it imports.
    error : Exception
    """
    return NotInstalledError if isinstance(error, ModuleNotFoundError) and error.name == module else SourceError


def load_error(library: str) -> type[SourceError]:
    """Return the class of error for a shared library that does not load.

    Parameters
    ----------
    library : str
        Name without prefix and suffix, as `ctypes.util.find_library` expects it.
    """
    return NotInstalledError if ctypes.util.find_library(library) is None else SourceError
