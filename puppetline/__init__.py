"""Puppetline animates any character mesh with a performer's skeleton.

Three other packages do the work: `capture` (skeleton input), `solver` (geometry) and `engine_bridge` (puppet files,
glTF, live service, command line). This package contains what they share.
"""

from typing import TYPE_CHECKING

__version__: str

if not TYPE_CHECKING:  # otherwise type checkers would accept any attribute

    def __getattr__(name: str) -> str:
        """Look up the version when it is used, because that takes a third of the time that --help takes."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib.metadata import version

        return version("puppetline")
