"""Goes through a take as its stage did, for one of its characters."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from capture.events import Cue, Event
from capture.sources.replay import RecordingSource
from engine_bridge.performance.channels import sound_cue
from engine_bridge.service.players.character_player import CharacterPlayer
from engine_bridge.service.stages.stage import Stage, StageSettings
from puppetline.errors import PuppetlineError, ServiceError, SkeletonLogError


class TakeStage:
    """A take, and a character that one of its performers drives.

    Parameters
    ----------
    player : CharacterPlayer
        The character, without a performer.
    path : Path
        A take, or any recording.
    part : str, optional
        Name of the character in the take whose performer drives this one; the character's own by default.

    Attributes
    ----------
    offset : float
        Second of the timeline at which the take began, if other takes played meanwhile; otherwise 0.
    sound : dict or None
        File of the sound beside the take, and the time of its first sample (``at``) since the take's first event.
    note : str
        The first error in the take, if it can be played nevertheless; otherwise empty.

    Raises
    ------
    PuppetlineError
        The file cannot be read.
    """

    def __init__(self, player: CharacterPlayer, path: Path, part: str | None = None) -> None:
        self.offset, self.note = 0.0, ""
        self.sound: dict[str, Any] | None = None
        self._player, self._path, self._part = player, path, part or player.character.name
        self._source = RecordingSource.of_file(path.name, path)
        self._stage, self._directed = Stage(path.stem, [player], StageSettings()), False

    def frames(self) -> Iterator[float]:
        """Yield a time in seconds since the take's first event whenever the player has shown a frame.

        Raises
        ------
        PuppetlineError
            The take is one of other characters, or none of it can be read.
        """
        first: float | None = None
        player = self._player
        try:
            for event in self._source.events():
                first = event.time if first is None else first
                if isinstance(event, Cue):
                    event = self._prepared(event, first)
                for each in (*(() if self._directed else self._stage.beginnings(event.time, recorded=True)), event):
                    before = player.sequence
                    self._step(each)
                    if player.sequence > before:
                        yield each.time - first
        except SkeletonLogError as error:
            if not player.sequence:
                raise
            self.note = self.note or str(error)
        finally:
            self._source.close()

    def _step(self, event: Event) -> None:
        try:
            self._stage.step(event, 0)
        except PuppetlineError as error:  # a cue that does not fit, which a stage ignores too
            self.note = self.note or str(error)
        else:
            self._directed = self._directed or (isinstance(event, Cue) and event.do == "stage")

    def _prepared(self, cue: Cue, first: float) -> Cue:
        """Return a cue with the name of the player's character, after the stage has got the take's characters."""
        arguments = dict(cue.arguments)
        if cue.do == "sound" and (sound := sound_cue(cue)) is not None:
            self.sound = {"file": sound[0], "at": sound[1] - first}
        if isinstance(arguments.get("character"), str):
            arguments["character"] = self._renamed(arguments["character"])
        if cue.do == "stage" and isinstance(arguments.get("characters"), dict):
            recorded: dict[str, Any] = arguments["characters"]
            if self._part not in recorded:
                raise self._of_others(recorded)
            arguments["characters"] = {self._renamed(name): state for name, state in recorded.items()}
            arguments["reserved"] = [self._renamed(name) for name in arguments.get("reserved", [])]
            players = [self._player if name == self._part else _absent(self._renamed(name)) for name in recorded]
            self._stage = Stage(self._path.stem, players, StageSettings())
            self.offset = float((arguments.get("timeline") or {}).get("at", 0.0))
        return replace(cue, arguments=arguments)

    def _renamed(self, name: str) -> str:
        """Return the player's name for the chosen character, and names that differ from it for the others."""
        return self._player.character.name if name == self._part else f"{name} of the take"

    def _of_others(self, recorded: dict[str, Any]) -> ServiceError:
        return ServiceError(
            f"take {self._path.stem!r}",
            found=f"a take of {', '.join(recorded) or 'no character'}",
            expected=f"a take of {self._part}",
            fix=f'Name the character whose motion to use: "part": "{next(iter(recorded), self._part)}".',
        )


class _Absent:
    """A character of a take that is not shown: only its performer matters, who cannot drive another character."""

    next_calibration = None
    motion = SimpleNamespace(mirror=False)

    def __init__(self, name: str) -> None:
        self.character = SimpleNamespace(name=name)
        self.user: int | None = None

    def enter(self, user: int, _time: float) -> None:
        self.user = user

    def leave(self, _time: float) -> None:
        self.user = None

    def resume(self, snapshot: dict[str, Any], _time: float, _shift: float) -> None:
        self.user = snapshot["user"]

    def perform(self, *_: Any) -> None:
        """Show nothing."""

    def calibrate(self, _time: float) -> bool:
        return True

    pass_time = begin = set_mirror = set_sensor = perform


def _absent(name: str) -> CharacterPlayer:
    return cast(CharacterPlayer, _Absent(name))
