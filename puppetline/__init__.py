"""Puppetline animates any character mesh with a performer's skeleton.

>>> import puppetline as pl
>>> take = pl.load_recording("walk.bvh")
>>> dog = pl.propose("dog.glb")
>>> dog.convert(take, "dog_walk.glb").form
'rig'

Three other packages do the work: `capture` (skeleton input), `solver` (geometry) and `engine_bridge` (puppet files,
glTF, live service, command line). The names in `__all__` are stable. Each is imported when it is used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from engine_bridge.client.client import Client, connect
    from engine_bridge.performance.character_motion import CharacterMotion
    from puppetline.characters import Character, load, propose
    from puppetline.errors import PuppetlineError
    from puppetline.player import Player
    from puppetline.recordings import LiveSource, Recording, load_recording, open_source

__all__ = (
    "Character",
    "CharacterMotion",
    "Client",
    "LiveSource",
    "Player",
    "PuppetlineError",
    "Recording",
    "connect",
    "load",
    "load_recording",
    "open_source",
    "propose",
)

__version__: str

_MODULES = {
    "puppetline.characters": ("Character", "load", "propose"),
    "puppetline.recordings": ("LiveSource", "Recording", "load_recording", "open_source"),
    "puppetline.player": ("Player",),
    "puppetline.errors": ("PuppetlineError",),
    "engine_bridge.client.client": ("Client", "connect"),
    "engine_bridge.performance.character_motion": ("CharacterMotion",),
}
"""Names of this package, by the module that has them."""

if not TYPE_CHECKING:  # otherwise type checkers would accept any attribute

    def __getattr__(name: str) -> object:
        """Import a name when it is used: the packages take a second to import."""
        if name == "__version__":
            from importlib.metadata import version

            return version("puppetline")
        for module, names in _MODULES.items():
            if name in names:
                return getattr(import_module(module), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
