"""Loads the stages of a service file, at the start and at each reload."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from capture.sound_input import is_sound_file, open_sound
from engine_bridge.service.loading.character_loader import CharacterLoader
from engine_bridge.service.loading.service_file import ServiceFile, stage_names
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.stages.stage import Stage
from engine_bridge.service.stages.stage_runner import StageRunner


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
