"""The film of the studio's takes: a scene file, `film.toml`, which people may also edit by hand."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import tomlkit

from engine_bridge.film.scene import CharacterTable, SceneError, TakeTable
from puppetline import toml_schema
from puppetline.errors import ServiceError
from puppetline.files import written_whole

SPACING = 1.2
"""Distance between characters that are added to the film, in metres."""

MIN_SECONDS = 0.1
"""Minimum distance in seconds between the beginnings of two takes of one character."""


class FilmFile:
    """The scene file; it is read again when it has changed.

    Parameters
    ----------
    folder : Path
        The studio's folder.
    seconds : callable
        Returns the duration of a recording by its path in the file, None if unknown.
    """

    def __init__(self, folder: Path, seconds: Callable[[str], float | None]) -> None:
        self.path, self._seconds = folder / "film.toml", seconds
        self._read: tuple[int, list[dict[str, Any]]] = -1, []  # time of the last change, and tables [[take]]

    @property
    def takes(self) -> list[TakeTable]:
        """The takes, with the times at which they begin and stop.

        Raises
        ------
        SceneError
            The file cannot be read, or a take in it is wrong.
        """
        takes, ends = [], dict[str, float]()
        for values in self._tables():
            take = toml_schema.check(TakeTable, values, self.path, SceneError)
            whole = self._seconds(take.file)
            stop = take.stop if take.stop is not None else whole
            at = ends.get(take.character, 0.0) if take.at is None else take.at
            ends[take.character] = at + take.loop * ((stop or 0.0) - take.start)
            takes.append(take.model_copy(update={"at": at, "stop": stop}))
        return takes

    def replace(self, takes: Iterable[TakeTable], known: Iterable[str]) -> None:
        """Write other takes; characters are added side by side, and everything else in the file stays.

        Parameters
        ----------
        takes : iterable of TakeTable
        known : iterable of str
            Files that may be used besides those in the film.

        Raises
        ------
        ServiceError
            A take of another file.
        PuppetlineError
            The file cannot be read or written.
        """
        document = self._document()
        allowed = {*known, *(str(each.get("file")) for each in self._tables())}
        tables, last = tomlkit.aot(), dict[str, float]()
        for take in sorted(takes, key=lambda each: each.at or 0.0):
            if take.file not in allowed:
                raise ServiceError(
                    "the request, takes",
                    found=f"the file {take.file!r:.80}",
                    expected="a take",
                    fix="Record it, or add it to the scene file by hand.",
                )
            at = max(take.at or 0.0, last.get(take.character, -1.0) + MIN_SECONDS)
            last[take.character] = at
            tables.append(_table(take.model_copy(update={"at": round(at, 3)})))
        if "character" not in document:
            document["character"] = tomlkit.aot()
        names = [each["name"] for each in document["character"]]
        for name in dict.fromkeys(take["character"] for take in tables if take["character"] not in names):
            document["character"].append(_table(_placed(name, len(document["character"]))))
        document["take"] = tables
        self._write(document)

    def remove(self, character: str) -> None:
        """Remove a character that was closed, and its takes."""
        document = self._document()
        for key, name in (("take", "character"), ("character", "name")):
            kept = [each for each in document.get(key, ()) if each[name] != character]
            if key in document:
                document[key] = tomlkit.aot()
                document[key].extend(kept)
        if self.path.exists():
            self._write(document)

    def _tables(self) -> list[dict[str, Any]]:
        changed = self.path.stat().st_mtime_ns if self.path.exists() else -1
        if changed != self._read[0]:
            self._read = changed, self._document().unwrap().get("take", [])
        return self._read[1] if changed >= 0 else []

    def _document(self) -> tomlkit.TOMLDocument:
        if not self.path.exists():
            return tomlkit.parse("# The film of the studio's takes (docs/film.md).\n")
        text = toml_schema.read_text(self.path, "a scene file", "Delete it to begin a new film.", SceneError)
        toml_schema.parse(text, self.path, SceneError)  # with the line of a mistake
        return tomlkit.parse(text)

    def _write(self, document: tomlkit.TOMLDocument) -> None:
        with written_whole(self.path) as beside:
            beside.write_text(tomlkit.dumps(document), encoding="utf-8")


def _placed(name: str, number: int) -> CharacterTable:
    """Return a character of the studio beside the others: in the middle, right, left, and so on."""
    x = SPACING * ((number + 1) // 2) * (1 if number % 2 else -1)
    return CharacterTable(name=name, puppet=f"characters/{name}/live.toml", position=(x, 0.0))


def _table(values: TakeTable | CharacterTable) -> Any:
    table = tomlkit.table()
    table.update(values.model_dump(mode="json", exclude_defaults=True))
    return table
