"""The characters that are open in the studio, each with a folder in the workspace."""

import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from engine_bridge.studio.long_work import tasks
from engine_bridge.studio.long_work.worker import Progress, Worker
from engine_bridge.studio.project.workspace import Download, Upload, Workspace, shown
from puppetline.errors import ServiceError, unknown_name

MAX_CHARACTERS = 16
"""Maximum number of characters that are open at the same time."""


@dataclass
class OpenCharacter:
    """An open character.

    Attributes
    ----------
    name : str
        Name in requests and topics.
    title : str
        Name of the file that it was opened from.
    folder : Path
    saved_file : Path
        Puppet file that `Characters.save` writes to.
    puppet, saved : dict
        Values of the puppet in the service, and of the one that was opened or last saved.
    targets : list of str
        Names of the morph targets that the mesh has.
    width : float
        Width at rest in metres, as far as the file's unit says so.
    digest : str
        Hash of what the page's model depends on.
    model : Download or None
        The page's model.
    """

    name: str
    title: str
    folder: Path
    saved_file: Path
    puppet: dict[str, Any]
    saved: dict[str, Any]
    targets: list[str]
    width: float = 0.0
    vertices: int = 0
    triangles: int = 0
    digest: str = ""
    model: Download | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def live_file(self) -> Path:
        """Puppet file that the service loads."""
        return self.folder / tasks.LIVE


class Characters:
    """Opens, edits and saves characters.

    Parameters
    ----------
    workspace : Workspace
    worker : Worker
    """

    def __init__(self, workspace: Workspace, worker: Worker) -> None:
        self._workspace, self._worker = workspace, worker
        self._open: dict[str, OpenCharacter] = {}

    @property
    def all(self) -> list[OpenCharacter]:
        """The characters in the order in which they were opened."""
        return list(self._open.values())

    def __getitem__(self, name: str) -> OpenCharacter:
        if name not in self._open:
            raise unknown_name("the request, character", f"no character {name!r}", self._open)
        return self._open[name]

    async def open_mesh(self, upload: Upload, options: dict[str, Any], progress: Progress) -> OpenCharacter:
        """Open an uploaded mesh with a proposed puppet."""
        return await self._make(upload.path.stem, upload.name, progress, "propose", upload.path, options=options)

    async def open_puppet(self, puppet: Upload, mesh: Upload, progress: Progress) -> OpenCharacter:
        """Open an uploaded puppet file with an uploaded mesh."""
        return await self._make(puppet.path.stem, puppet.name, progress, "open_puppet", puppet.path, mesh.path)

    async def open_example(self, name: str, progress: Progress) -> OpenCharacter:
        """Open an example character."""
        made = self._workspace.folder / "examples"
        return await self._make(name, f"{name} (example)", progress, "open_example", name, made)

    async def open_file(self, path: Path, progress: Progress) -> OpenCharacter:
        """Open a puppet file of the command line, which `save` then writes to."""
        folder = self._new_folder(path.stem)
        return await self._prepared(folder, path.name, path, progress, "prepare", path.absolute(), folder)

    async def reopen(self, name: str, title: str, saved_file: Path, progress: Progress) -> OpenCharacter:
        """Open a character of the last run as it was, with edits that were not saved."""
        folder = self._workspace.folder / "characters" / name
        character = await self._add(folder, title, saved_file, progress, "prepare", folder / tasks.LIVE, folder)
        character.saved = await self._worker.run("values_of_file", saved_file)
        return character

    async def edit(self, name: str, puppet: dict[str, Any]) -> OpenCharacter:
        """Replace a character's puppet."""
        character = self[name]
        self._take(character, await self._worker.run("edit", character.folder, puppet))
        return character

    async def save(self, name: str) -> OpenCharacter:
        """Write a character's puppet to its file."""
        character = self[name]
        await self._worker.run("save", character.saved_file, character.folder)
        character.saved = character.puppet
        return character

    def close(self, name: str) -> None:
        """Close a character and delete its folder; a puppet file of the command line stays."""
        character = self[name]
        if character.model is not None:
            self._workspace.withdraw(character.model.id)
        del self._open[name]
        shutil.rmtree(character.folder, ignore_errors=True)

    def _new_folder(self, stem: str) -> Path:
        if len(self._open) >= MAX_CHARACTERS:
            raise ServiceError(
                "the stage",
                found=f"{MAX_CHARACTERS} open characters",
                expected="fewer characters",
                fix="Close one of them first.",
            )
        return self._workspace.character_folder(stem)

    async def _make(
        self, stem: str, title: str, progress: Progress, task: str, *arguments: Any, options: Any = None
    ) -> OpenCharacter:
        """Open a character whose puppet file is in its folder."""
        folder = self._new_folder(stem)
        more = () if options is None else (options,)
        saved_file = folder / f"{folder.name}.toml"
        return await self._prepared(folder, title, saved_file, progress, task, *arguments, folder, *more)

    async def _prepared(self, folder: Path, *rest: Any) -> OpenCharacter:
        try:
            return await self._add(folder, *rest)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise

    async def _add(
        self, folder: Path, title: str, saved_file: Path, progress: Progress, task: str, *arguments: Any
    ) -> OpenCharacter:
        facts = await self._worker.run(task, *arguments, progress=progress)
        puppet = facts["puppet"]
        character = OpenCharacter(folder.name, shown(title), folder, saved_file, puppet, puppet, facts["targets"])
        self._take(character, facts)
        character.notes = facts["notes"]
        self._open[character.name] = character
        return character

    def _take(self, character: OpenCharacter, facts: dict[str, Any]) -> None:
        """Update a character with what a task reports of its puppet and model."""
        character.puppet = facts["puppet"]
        character.vertices, character.triangles = facts["vertices"], facts["triangles"]
        character.width = facts["width"]
        if facts["digest"] == character.digest:
            return
        character.digest = facts["digest"]
        if character.model is not None:
            self._workspace.withdraw(character.model.id)
        character.model = None
        if facts["model"]:
            path = character.folder / tasks.MODEL
            character.model = self._workspace.offer(path, f"{character.name}.glb", "model")
