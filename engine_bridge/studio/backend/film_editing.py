"""Edits the film of the studio's takes, and plays it on the characters of the service."""

import asyncio
import contextlib

from engine_bridge.film.moods import lighting_of
from engine_bridge.film.scene import SceneError, TakeTable
from engine_bridge.studio.messages.film import FilmScene, FilmState
from engine_bridge.studio.messages.state import TakeState
from engine_bridge.studio.project.film_file import FilmFile
from engine_bridge.studio.project.take_list import TakeList
from engine_bridge.studio.project.workspace import Workspace
from engine_bridge.studio.service.own_service import OwnService
from puppetline.errors import PuppetlineError


class FilmEditing:
    """The film of the studio's takes.

    Parameters
    ----------
    workspace : Workspace
    service : OwnService
    takes : TakeList
    """

    def __init__(self, workspace: Workspace, service: OwnService, takes: TakeList) -> None:
        self._workspace, self._service, self._takes = workspace, service, takes
        self.file = FilmFile(workspace.folder, lambda file: self._by_file.get(file, _UNKNOWN).seconds)

    @property
    def state(self) -> FilmState:
        """The takes of the film, or why they cannot be read."""
        try:
            scene = self.file.scene
            return FilmState(takes=self.file.takes, scene=scene, light=lighting_of(scene))
        except PuppetlineError as error:
            return FilmState(problem=self._workspace.without_folders(str(error)))

    def edit(self, takes: list[TakeTable] | None, scene: FilmScene | None = None) -> None:
        """Replace the takes of the film and the other tables of its scene file, where they are given."""
        self.file.replace(self.file.takes if takes is None else takes, [*self._by_file, *self._workspace.media], scene)

    def end_of(self, character: str) -> float:
        """Return the second of the film at which a character's last take ends; 0 without one."""
        return max((_end(take) for take in self._played(None) if take.character == character), default=0.0)

    def add(self, take: TakeState, character: str) -> None:
        """Add a take that was recorded: where the others played meanwhile, or after the character's last one.

        The service gets it ready in the background.
        """
        at = self.end_of(character) if take.at is None else max(take.at, 0.0)
        self.edit([*self.file.takes, TakeTable(character=character, file=_file(take.name), at=round(at, 3))])
        self._loading = asyncio.create_task(self._load(take, character))

    async def _load(self, take: TakeState, character: str) -> None:
        with contextlib.suppress(PuppetlineError):  # said when it is played
            await self._service.request("load_take", character=character, take=take.name, part=_part(take, character))

    def players(self, take: str) -> list[str]:
        """Return the characters that play a recording; empty also if the film cannot be read, which its state says."""
        with contextlib.suppress(PuppetlineError):
            return [each.character for each in self.file.takes if each.file == _file(take)]
        return []

    def forget(self, take: str) -> None:
        """Remove a recording that is deleted."""
        takes = self.file.takes
        kept = [each for each in takes if each.file != _file(take)]
        if len(kept) < len(takes):
            self.edit(kept)

    async def play(self, at: float, but: str | None = None) -> PuppetlineError | None:
        """Play all takes that are not over at a second of the film, and wait there.

        Returns the error of a take that cannot be played; the rest plays.

        Parameters
        ----------
        at : float
        but : str, optional
            A character that does not play.
        """
        await self._service.request("stop")
        known, begun = self._by_file, set[str]()
        failed: PuppetlineError | None = None
        for take in self._played(but):
            recorded, begin = known.get(take.file), max(take.at or 0.0, at)
            if recorded is None:
                failed = failed or _missing(take)
                continue
            over = recorded.seconds is not None and _end(take) <= begin
            if over or take.character not in self._service.described:
                continue
            try:
                await self._service.request(
                    "play_take",
                    character=take.character,
                    take=recorded.name,
                    part=_part(recorded, take.character),
                    at=begin,
                    start=take.start + begin - (take.at or 0.0),
                    stop=take.stop,
                    beside=take.character in begun,
                    pause=not begun,  # a take may be over before the next one is loaded
                )
            except PuppetlineError as error:
                failed = failed or error
                continue
            begun.add(take.character)
        return failed

    async def claim(self, character: str) -> None:
        """Let a performer of a character's stage drive it, if none does."""
        described = self._service.described.get(character, {})
        stages = self._service.status.get("stages", [])
        users = [user["user"] for each in stages if each["name"] == described.get("stage") for user in each["users"]]
        if users and described.get("performer") is None:
            await self._service.request("choose_user", character=character, user=users[0])

    def _played(self, but: str | None) -> list[TakeTable]:
        return [take for take in self.file.takes if not take.mute and take.character != but]

    @property
    def _by_file(self) -> dict[str, TakeState]:
        return {_file(each.name): each for each in self._takes.states}


_UNKNOWN = TakeState(name="", seconds=None, frames=0, bytes=0, written=0.0)


def _missing(take: TakeTable) -> SceneError:
    return SceneError(
        take.file,
        found="a missing file",
        expected="the take that the film shows",
        fix="Remove the take from the film, or copy the file back.",
    )


def _file(take: str) -> str:
    return f"takes/{take}.log"


def _part(take: TakeState, character: str) -> str | None:
    """Return the character in a take whose performer drives a character."""
    return character if character in take.parts else next(iter(take.parts), None)


def _end(take: TakeTable) -> float:
    return (take.at or 0.0) + (take.stop or 0.0) - take.start
