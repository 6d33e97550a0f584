"""The five example characters, with as many vertices as those of the paper's Table 1."""

from collections.abc import Callable

from . import biped, dinosaur, dog, human, pegasus
from .character import ColoredSurface

__all__ = ["CHARACTERS", "ColoredSurface"]

CHARACTERS: dict[str, Callable[[], ColoredSurface]] = {
    "dinosaur": dinosaur.build,
    "biped": biped.build,
    "pegasus": pegasus.build,
    "dog": dog.build,
    "human": human.build,
}
"""Functions that make the characters, by name; each returns the same bytes every time."""
