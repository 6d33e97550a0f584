"""Loads the stages of a service file and their characters, at the start and at each reload."""

from collections.abc import Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from capture.sound_input import open_sound
from engine_bridge.export.live_basis import LiveBasis
from engine_bridge.performance.prepared_character import prepared_of
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.puppet_document import PuppetDocument
from engine_bridge.service.loading.service_file import (
    CharacterTable,
    ServiceFile,
    StageTable,
    character_names,
    stage_names,
)
from engine_bridge.service.outputs.output import OutputTable
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.protocol.scene import StreamedCharacter
from engine_bridge.service.stages.stage import Stage
from engine_bridge.service.stages.stage_runner import StageRunner


def load_players(
    settings: ServiceFile, folder: Path, executor: Executor, outputs: Iterable[OutputTable]
) -> list[list[CharacterPlayer]]:
    """Load all characters of a service file and return their players, one list per stage.

    Parameters
    ----------
    settings : ServiceFile
    folder : Path
        Folder that the paths in the service file are relative to.
    executor : Executor
        Computes calibrations.
    outputs : iterable of OutputTable
        Tables of the outputs that are open; each checks the puppets.

    Raises
    ------
    PuppetlineError
        The first error in one of the files.
    """

    def player(stage: StageTable, table: CharacterTable, name: str) -> CharacterPlayer:
        document = PuppetDocument(folder / table.puppet)

        def load(puppet: Puppet) -> CharacterPlayer:
            for output in outputs:
                output.check_puppet(name, puppet, document.path)
            prepared = prepared_of(puppet, document.path)
            basis = None if table.morphs is None else LiveBasis.load(folder / table.morphs, prepared)
            character = StreamedCharacter.of(name, prepared, basis)
            character.prepare()  # now, so that the first client does not wait for it
            idle = None if table.idle is None else folder / table.idle
            loaded = CharacterPlayer(character, stage.player_settings, executor, idle)
            loaded.document, loaded.with_puppet = document, load
            return loaded

        return load(document.puppet)

    return [
        [player(stage, table, name) for table, name in zip(stage.character, character_names(stage), strict=True)]
        for stage in settings.stage
    ]


@dataclass(frozen=True)
class LoadedStage:
    """A stage that was loaded: its name, its players, and its runner, which a previous load may have made."""

    name: str
    players: list[CharacterPlayer]
    runner: StageRunner


def load_stages(
    settings: ServiceFile,
    folder: Path,
    executor: Executor,
    outputs: Iterable[OutputTable],
    runners: Sequence[StageRunner] = (),
) -> list[LoadedStage]:
    """Load the stages of a service file, and open the sources that no stage has yet.

    Parameters
    ----------
    settings, folder, executor, outputs
        See `load_players`.
    runners : sequence of StageRunner
        Runners of the previous load; the sequence is not changed.

    Raises
    ------
    PuppetlineError
        An error in a file, or a source that cannot be opened. Sources that were opened are closed.
    """
    heard = {runner.sound_name for runner in runners}
    for table in settings.stage:
        if table.sound is not None and table.sound not in heard:  # its errors come now: loading takes longer
            open_sound(table.sound, folder).close()
    loaded: list[LoadedStage] = []
    kept = list(runners)
    try:
        cast = load_players(settings, folder, executor, outputs)
        for name, table, players in zip(stage_names(settings), settings.stage, cast, strict=True):
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
