"""Puppetline: a performer's skeleton moves any character mesh.

The work is done by three packages beside this one: `capture` (skeletons in), `solver` (geometry) and `engine_bridge`
(puppet files, glTF, command line). This package holds what all three share.
"""

from typing import TYPE_CHECKING

__version__: str

if not TYPE_CHECKING:  # which would take any name for an attribute

    def __getattr__(name: str) -> str:
        """Look the version up when it is asked for: that takes a third of the time until the help is there."""
        if name != "__version__":
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib.metadata import version

        return version("puppetline")
