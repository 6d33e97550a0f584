"""Loads the characters of a service from their puppet files, at the start and at each reload."""

from concurrent.futures import Executor
from pathlib import Path
from weakref import WeakKeyDictionary

from engine_bridge.export.live_basis import LiveBasis
from engine_bridge.performance.rig import rig_of
from engine_bridge.puppet.puppet_document import PuppetDocument
from engine_bridge.service.loading.service_file import CharacterTable, ServiceFile, StageTable, character_names
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.frame import StreamedCharacter


class CharacterLoader:
    """Loads the characters of a service file.

    Parameters
    ----------
    settings : ServiceFile
    folder : Path
        Folder that the paths in the service file are relative to.
    executor : Executor
        Computes calibrations.
    """

    def __init__(self, settings: ServiceFile, folder: Path, executor: Executor) -> None:
        self._settings, self._folder, self._executor = settings, folder, executor
        self._documents: WeakKeyDictionary[CharacterPlayer, PuppetDocument] = WeakKeyDictionary()

    def load(self, settings: ServiceFile) -> list[list[CharacterPlayer]]:
        """Load all characters and return their players, one list per stage.

        Parameters
        ----------
        settings : ServiceFile
            The service file, or a newer one for its stages.

        Raises
        ------
        PuppetlineError
            The first error in one of the files.
        """
        return [
            [
                self._player(stage, table, name)
                for table, name in zip(stage.character, character_names(stage), strict=True)
            ]
            for stage in settings.stage
        ]

    def document(self, player: CharacterPlayer) -> PuppetDocument:
        """Return the puppet file that a character was loaded from."""
        return self._documents[player]

    def _player(self, stage: StageTable, table: CharacterTable, name: str) -> CharacterPlayer:
        document = PuppetDocument(self._folder / table.puppet)
        for _, output in self._settings.output_tables():
            output.check_puppet(name, document.puppet, document.path)
        rig = rig_of(document.puppet, document.path)
        basis = None if table.morphs is None else LiveBasis.load(self._folder / table.morphs, rig)
        character = StreamedCharacter.of(name, rig, basis)
        character.prepare()  # now, so that the first client does not wait for it
        idle = None if table.idle is None else self._folder / table.idle
        player = CharacterPlayer(character, stage.player_settings, self._executor, idle)
        self._documents[player] = document
        return player
