"""The characters of a service, loaded from their puppet files, once and again."""

import hashlib
from concurrent.futures import Executor
from pathlib import Path

from engine_bridge import puppet as puppet_file
from engine_bridge.live.frame import StreamedCharacter
from engine_bridge.live.live_basis import LiveBasis
from engine_bridge.live.role import Role
from engine_bridge.live.service_file import CharacterTable, ServiceFile, StageTable, character_names
from engine_bridge.rig import Rig, load_rig


class Cast:
    """Loads the characters that the settings name.

    Parameters
    ----------
    settings : ServiceFile
    folder : Path
        What files are relative to.
    executor : Executor
        Of the roles' calibrations.
    """

    def __init__(self, settings: ServiceFile, folder: Path, executor: Executor) -> None:
        self._settings, self._folder, self._executor = settings, folder, executor

    def load(self) -> list[list[Role]]:
        """Return the roles of each stage.

        Raises
        ------
        PuppetlineError
            The first thing that is wrong with one of the files.
        """
        return [
            [
                self._role(stage, table, name)
                for table, name in zip(stage.character, character_names(stage), strict=True)
            ]
            for stage in self._settings.stage
        ]

    def _role(self, stage: StageTable, table: CharacterTable, name: str) -> Role:
        rig = load_rig(self._folder / table.puppet)
        basis = None if table.morphs is None else LiveBasis.load(self._folder / table.morphs, rig)
        character = StreamedCharacter(name, rig, _revision(rig, basis), basis)
        character.prepare()  # here, and not when the first client asks for it
        idle = None if table.idle is None else self._folder / table.idle
        return Role(character, stage.manner, self._executor, idle)


def _revision(rig: Rig, basis: LiveBasis | None) -> int:
    """Make a number of what a client knows of a character; after a restart it is the same."""
    digest = hashlib.sha256(puppet_file.dumps(rig.puppet).encode())
    for array in (rig.character.vertices, rig.character.triangles, rig.model.ladder, rig.model.weights):
        digest.update(array.tobytes())
    digest.update(repr(None if basis is None else basis.names).encode())
    return int.from_bytes(digest.digest()[:4], "little")
