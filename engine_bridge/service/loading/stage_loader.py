"""Loads the stages of a service file and their characters, at the start and at each reload."""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakKeyDictionary

from capture.sound_input import is_sound_file, open_sound
from engine_bridge.export.live_basis import LiveBasis
from engine_bridge.performance.rig import rig_of
from engine_bridge.puppet.puppet_document import PuppetDocument
from engine_bridge.service.loading.service_file import (
    CharacterTable,
    ServiceFile,
    StageTable,
    character_names,
    stage_names,
)
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.stages.stage import Stage
from engine_bridge.service.stages.stage_runner import StageRunner


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


@dataclass(frozen=True)
class LoadedStage:
    """A stage that was loaded: its name, its players, and its runner, which a previous load may have made."""

    name: str
    players: list[CharacterPlayer]
    runner: StageRunner


def load_stages(
    settings: ServiceFile, folder: Path, loader: CharacterLoader, runners: Sequence[StageRunner] = ()
) -> list[LoadedStage]:
    """Load the stages of a service file, and open the sources that no stage has yet.

    Parameters
    ----------
    settings : ServiceFile
    folder : Path
        Folder that files of the sources are relative to.
    loader : CharacterLoader
    runners : sequence of StageRunner
        Runners of the previous load; the sequence is not changed.

    Raises
    ------
    PuppetlineError
        An error in a file, or a source that cannot be opened. Sources that were opened are closed.
    """
    for table in settings.stage:
        if table.sound is not None and is_sound_file(table.sound):  # loading characters takes longer
            open_sound(table.sound, folder).close()
    loaded: list[LoadedStage] = []
    kept = list(runners)
    try:
        for name, table, players in zip(stage_names(settings), settings.stage, loader.load(settings), strict=True):
            runner = _matching(kept, name, table.source, table.sound)
            if runner is None:
                runner = StageRunner(table.source, Stage(name, players, table.settings), folder, table.sound)
            else:
                kept.remove(runner)
            loaded.append(LoadedStage(name, players, runner))
    except BaseException:
        for stage in loaded:
            if stage.runner not in runners:
                stage.runner.close()
        raise
    return loaded


def _matching(runners: list[StageRunner], name: str, uri: str, sound: str | None) -> StageRunner | None:
    """Return the runner of a source and a sound, of the same stage if several have it; None if no stage has it.

    A recording belongs to its stage: another stage plays it from the beginning. A sensor or port can be open only once.
    """
    same = [runner for runner in runners if (runner.source.name, runner.sound_name) == (uri, sound)]
    named = [runner for runner in same if runner.stage.name == name]
    return next(iter([*named, *(runner for runner in same if not runner.recorded)]), None)
