"""The list of takes, with their durations."""

import json
from pathlib import Path

from engine_bridge.service.takes.take_folder import Takes
from engine_bridge.studio.messages import TakeState


class TakeList:
    """Lists takes; each file is read again only when it has changed.

    Parameters
    ----------
    folder : Path
    """

    def __init__(self, folder: Path) -> None:
        self._takes = Takes(folder)
        self._known: dict[str, TakeState] = {}

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

    def path(self, name: str) -> Path:
        """Return the file of a take, see `Takes.path`."""
        return self._takes.path(name)

    def _state(self, name: str, bytes: int, written: float, sound: bool) -> TakeState:  # noqa: A002
        known = self._known.get(name)
        if known is not None and (known.bytes, known.written, known.sound) == (bytes, written, sound):
            return known
        first, last, frames = _extent(self._takes.folder / f"{name}.log")
        seconds = None if first is None or last is None else last - first
        return TakeState(name=name, seconds=seconds, frames=frames, bytes=bytes, written=written, sound=sound)


def _extent(path: Path) -> tuple[float | None, float | None, int]:
    """Return the times of the first and last skeleton of a take, and the number of skeletons."""
    first = last = None
    frames = 0
    try:
        with path.open("rb") as file:
            for line in file:
                if b'"p"' not in line or not line.endswith(b"}\n"):
                    continue
                frames += 1
                if first is None:
                    first = float(json.loads(line)["t"])
                last_line = line
            if frames:
                last = float(json.loads(last_line)["t"])
    except (OSError, ValueError, KeyError, TypeError):
        return None, None, 0
    return first, last, frames
