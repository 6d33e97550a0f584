"""Puppetline: a performer's skeleton moves any character mesh.

The work is done by three packages beside this one: `capture` (skeletons in), `solver` (geometry) and `engine_bridge`
(puppet files, glTF, command line). This package holds what all three share.
"""

from importlib.metadata import version

__version__ = version("puppetline")
