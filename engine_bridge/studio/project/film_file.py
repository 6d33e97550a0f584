"""The film of the studio's takes: a scene file, `film.toml`, which people may also edit by hand."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, get_args

import tomlkit

from engine_bridge.film.scene import CharacterTable, Scene, SceneError, TakeTable, Typeface
from engine_bridge.studio.messages.film import FilmScene
from puppetline import toml_schema
from puppetline.errors import ServiceError
from puppetline.files import written_whole

GAP = 0.3
"""Distance between characters that are added to the film, in metres."""

DEFAULT_WIDTH = 0.9
"""Width of a character that is not open, in metres."""

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
        self._read: tuple[int, dict[str, Any]] = -1, {}  # time of the last change, and all tables

    @property
    def takes(self) -> list[TakeTable]:
        """The takes, with the times at which they begin and stop.

        Raises
        ------
        SceneError
            The file cannot be read, or a take in it is wrong.
        """
        takes, ends = [], dict[str, float]()
        for values in self._tables().get("take", []):
            take = toml_schema.check(TakeTable, values, self.path, SceneError)
            whole = self._seconds(take.file)
            stop = take.stop if take.stop is not None else whole
            at = ends.get(take.character, 0.0) if take.at is None else take.at
            ends[take.character] = at + take.loop * ((stop or 0.0) - take.start)
            takes.append(take.model_copy(update={"at": at, "stop": stop}))
        return takes

    @property
    def scene(self) -> FilmScene:
        """All tables but the takes, as they are written.

        Raises
        ------
        SceneError
            The file cannot be read, or a table in it is wrong.
        """
        return toml_schema.check(FilmScene, _without_takes(self._tables()), self.path, SceneError)

    def introduce(self, character: str, widths: dict[str, float]) -> None:
        """Add a character beside the others, if the film does not have it.

        Parameters
        ----------
        character : str
        widths : dict
            Widths of open characters, in metres.
        """
        document = self._document()
        if character not in [each["name"] for each in document.get("character", ())]:
            _add(document, character, widths)
            self._write(document)

    def replace(self, takes: Iterable[TakeTable], known: Iterable[str], scene: FilmScene | None = None) -> None:
        """Write other takes, and perhaps other tables; characters are added side by side.

        Tables that do not change stay as they are written.

        Parameters
        ----------
        takes : iterable of TakeTable
        known : iterable of str
            Files that may be used besides those in the film.
        scene : FilmScene, optional
            Characters that are not in it stay as they are, and no character's puppet changes.

        Raises
        ------
        ServiceError
            Another file.
        SceneError
            The tables do not fit each other.
        PuppetlineError
            The file cannot be read or written.
        """
        document, takes, before = self._document(), list(takes), self.scene
        allowed = {*known, *_files(document.unwrap())}
        used = [take.file for take in takes] + ([] if scene is None else _files(scene.model_dump()))
        for file in used:
            if file not in allowed:
                raise ServiceError(
                    "the request",
                    found=f"the file {file!r:.80}",
                    expected="a take, or a sound or picture of the film",
                    fix="Record or upload it, or add it to the scene file by hand.",
                )
        tables, last = tomlkit.aot(), dict[str, float]()
        for take in sorted(takes, key=lambda each: each.at or 0.0):
            at = max(take.at or 0.0, last.get(take.character, -1.0) + MIN_SECONDS)
            last[take.character] = at
            tables.append(_table(take.model_copy(update={"at": round(at, 3)})))
        names = [each["name"] for each in document.get("character", ())]
        for name in dict.fromkeys(take["character"] for take in tables if take["character"] not in names):
            _add(document, name, {})
        document["take"] = tables
        if scene is not None:
            _change(document, before, scene)
            values = document.unwrap()
            seconds = {"seconds": 1.0, **values.get("film", {})}  # a scene without takes is a scene too
            if values.get("character"):
                toml_schema.check(Scene, {**values, "film": seconds}, self.path, SceneError)
        self._write(document)

    def remove(self, character: str) -> None:
        """Remove a character that was closed, its takes and bubbles, and its name in shots."""
        document = self._document()
        for shot in document.get("camera", ()):
            if character in shot.get("show", ()):
                shot["show"] = [each for each in shot["show"] if each != character]
            if shot.get("behind") == character:
                del shot["behind"]
        for key, name in (("take", "character"), ("bubble", "character"), ("character", "name")):
            kept = [each for each in document.get(key, ()) if each[name] != character]
            if key in document:
                document[key] = tomlkit.aot()
                document[key].extend(kept)
        if self.path.exists():
            self._write(document)

    def _tables(self) -> dict[str, Any]:
        changed = self.path.stat().st_mtime_ns if self.path.exists() else -1
        if changed != self._read[0]:
            self._read = changed, self._document().unwrap()
        return self._read[1] if changed >= 0 else {}

    def _document(self) -> tomlkit.TOMLDocument:
        if not self.path.exists():
            return tomlkit.parse("# The film of the studio's takes (docs/film.md).\n")
        text = toml_schema.read_text(self.path, "a scene file", "Delete it to begin a new film.", SceneError)
        toml_schema.parse(text, self.path, SceneError)  # with the line of a mistake
        return tomlkit.parse(text)

    def _write(self, document: tomlkit.TOMLDocument) -> None:
        with written_whole(self.path) as beside:
            beside.write_text(tomlkit.dumps(document), encoding="utf-8")


def _without_takes(values: dict[str, Any]) -> dict[str, Any]:
    return {key: each for key, each in values.items() if key != "take"}


def _files(values: dict[str, Any]) -> list[str]:
    """Return the files that tables of a scene name, besides puppets."""
    rows = [row for key in ("take", "sound", "title", "bubble") for row in values.get(key) or ()]
    tables = [*rows, values.get("music") or {}, values.get("background") or {}]
    named = [table.get(key) for table in tables for key in ("file", "picture", "font")]
    return [each for each in named if each is not None and each not in get_args(Typeface)]


def _add(document: tomlkit.TOMLDocument, name: str, widths: dict[str, float]) -> None:
    """Add a character to the right or to the left of the others, where it is nearer to the middle."""
    if "character" not in document:
        document["character"] = tomlkit.aot()
    sides = []
    for each in document["character"]:
        x, half = each.get("position", (0.0, 0.0))[0], widths.get(each["name"], DEFAULT_WIDTH) / 2
        sides.append((x - half, x + half))
    x, half = 0.0, widths.get(name, DEFAULT_WIDTH) / 2
    if sides:
        right, left = max(side[1] for side in sides) + GAP + half, min(side[0] for side in sides) - GAP - half
        x = right if right <= -left else left
    row = CharacterTable(name=name, puppet=f"characters/{name}/live.toml", position=(round(x, 2), 0.0))
    document["character"].append(_table(row))


def _change(document: tomlkit.TOMLDocument, before: FilmScene, scene: FilmScene) -> None:
    """Change the tables of a document in which two scenes differ; characters that it has besides are kept."""
    puppets = {each.name: each.puppet for each in before.character}
    wanted = {each.name: each for each in scene.character}
    for row, old in zip(document.get("character", ()), before.character, strict=False):
        new = wanted.get(old.name, old).model_copy(update={"puppet": puppets[old.name]})
        _update(row, old, new)
    for key in FilmScene.model_fields:
        old, new = getattr(before, key), getattr(scene, key)
        if key == "character" or old == new:
            continue
        if not isinstance(new, tuple):
            if key not in document:
                document[key] = tomlkit.table()
            _update(document[key], old, new)
        else:
            document[key] = tomlkit.aot()
            document[key].extend(_table(each) for each in new)


def _update(table: Any, old: toml_schema.Table, new: toml_schema.Table) -> None:
    """Change the keys of a table that differ; a key with its default value is removed."""
    values = new.model_dump(mode="json", exclude_defaults=True)
    for key in type(new).model_fields:
        if getattr(old, key) == getattr(new, key):
            continue
        if key in values:
            table[key] = values[key]
        else:
            table.pop(key, None)


def _table(values: toml_schema.Table) -> Any:
    table = tomlkit.table()
    table.update(values.model_dump(mode="json", exclude_defaults=True))
    return table
