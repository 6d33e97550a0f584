"""Errors for optional libraries that sensors require: a library that is missing, or one that cannot be loaded."""

import ctypes.util
import importlib
from typing import Any

from puppetline.errors import SourceError

UNLOADABLE = "a library that cannot be loaded"

DEBIAN_PACKAGES = {"libusb-1.0.so.0": "libusb-1.0-0"}
"""Debian's packages of shared libraries that a Python package requires and does not bring."""


class NotInstalledError(SourceError):
    """A library that a source requires is not installed. A library that cannot be loaded is a plain SourceError."""


def load_module(module: str, where: str, *, found: str, expected: str, fix: str) -> Any:
    """Return a Python module.

    Parameters
    ----------
    module, where : str
    found, expected, fix : str
        Parts of the error's message; the reason is added to the first. If the reason is a shared library of
        `DEBIAN_PACKAGES`, the other two name it and its package.

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
        library = str(error).partition(":")[0]
        if library in DEBIAN_PACKAGES:
            expected = f"{library}, which {module} requires"
            fix = f"Install it: apt install {DEBIAN_PACKAGES[library]} on Debian and Ubuntu."
        raise kind(where, found=f"{found} ({error})", expected=expected, fix=fix) from error


def load_error(library: str) -> type[SourceError]:
    """Return the class of error for a shared library that cannot be loaded, named without prefix and suffix."""
    return NotInstalledError if ctypes.util.find_library(library) is None else SourceError
