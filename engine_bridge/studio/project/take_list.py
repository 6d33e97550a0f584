"""The list of takes, with their durations and pictures."""

import json
from itertools import count
from pathlib import Path
from typing import Any

from capture import sound
from engine_bridge.service.takes.take_folder import Takes
from engine_bridge.studio.messages.state import TakeState
from engine_bridge.studio.project.workspace import Workspace


class TakeList:
    """Lists takes; each file is read again only when it has changed.

    Parameters
    ----------
    workspace : Workspace
    """

    def __init__(self, workspace: Workspace) -> None:
        self._workspace, self._takes = workspace, Takes(workspace.folder / "takes")
        self._known: dict[str, TakeState] = {}
        self._offered: dict[Path, str] = {}

    @property
    def states(self) -> list[TakeState]:
        """All takes, by name."""
        listed = self._takes.all()
        self._known = {each["name"]: self._state(**each) for each in listed}
        return list(self._known.values())

    def state(self, name: str) -> TakeState:
        """Return the name, duration, frames, size and time of one take.

        Raises
        ------
        ServiceError
            There is no take of that name.
        """
        self.path(name)
        return next(each for each in self.states if each.name == name)

    def new_name(self) -> str:
        """Return ``take-1``, or the first such name that no take has."""
        names = {each["name"] for each in self._takes.all()}
        return next(name for number in count(1) if (name := f"take-{number}") not in names)

    def picture(self, name: str, wave: bool = False) -> Path:
        """Return the file with the picture of a take, or with the wave form of its sound."""
        return self._workspace.folder / "pictures" / f"{name}{'.wave' if wave else ''}.png"

    def sound(self, name: str) -> Path:
        """Return the file with the sound of a take, which may be missing."""
        return self._takes.folder / f"{name}{sound.ENDING}"

    def delete(self, name: str) -> None:
        """Delete a take, its sound and its pictures.

        Raises
        ------
        ServiceError
            There is no take of that name.
        """
        for path in (self.path(name), self.sound(name), self.picture(name), self.picture(name, wave=True)):
            path.unlink(missing_ok=True)
            self._workspace.withdraw(self._offered.pop(path, ""))  # a new take may get the name

    def path(self, name: str) -> Path:
        """Return the file of a take, see `Takes.path`."""
        return self._takes.path(name)

    def _state(self, name: str, bytes: int, written: float, sound: bool) -> TakeState:  # noqa: A002
        known = self._known.get(name)
        if known is None or (known.bytes, known.written, known.sound) != (bytes, written, sound):
            facts = _facts(self._takes.folder / f"{name}.log")
            known = TakeState(name=name, bytes=bytes, written=written, sound=sound, **facts)
        offered = {
            "picture": self._offer(self.picture(name)),
            "wave": self._offer(self.picture(name, wave=True)),
            "sound_file": self._offer(self.sound(name)),
        }
        return known.model_copy(update=offered)

    def _offer(self, file: Path) -> str:
        if file not in self._offered and file.exists():
            self._offered[file] = self._workspace.offer(file, file.name, "model").id
        return self._offered.get(file, "") if file.exists() else ""


def _facts(path: Path) -> dict[str, Any]:
    """Return seconds and frames of a take, and what its first cue says of the film and of its performers."""
    first = last = None
    facts: dict[str, Any] = {"seconds": None, "frames": 0}
    try:
        with path.open("rb") as file:
            for line in file:
                if not line.endswith(b"}\n"):
                    continue
                if b'"stage"' in line and first is None:
                    facts |= _beginning(json.loads(line))
                if b'"p"' in line:
                    facts["frames"] += 1
                    first, last = first or line, line
            if first is not None and last is not None:
                facts["seconds"] = float(json.loads(last)["t"]) - float(json.loads(first)["t"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {"seconds": None, "frames": 0}
    return facts


def _beginning(cue: dict[str, Any]) -> dict[str, Any]:
    arguments = cue["arguments"]
    parts = [name for name, each in arguments.get("characters", {}).items() if each.get("user") is not None]
    return {"at": (arguments.get("timeline") or {}).get("at"), "parts": parts}
