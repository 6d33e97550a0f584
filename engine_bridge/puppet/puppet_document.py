"""Editing a puppet file: comments, layout and all values that do not change stay as they are."""

import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import AbstractTable, AoT, InlineTable

from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import MorphTable, Puppet
from engine_bridge.puppet.puppet_file import as_toml, root_values
from puppetline.errors import PuppetError
from puppetline.files import written_whole
from puppetline.toml_schema import Table

SETTINGS = "character", "retarget", "smoothing", "solver"
"""Tables that may be missing in the file, but not in the puppet."""


class PuppetDocument:
    """A puppet file as it was last read or written.

    Parameters
    ----------
    path : Path

    Attributes
    ----------
    path : Path
    puppet : Puppet
        Contents of the file.

    Raises
    ------
    PuppetError
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._text = puppet_file.read(path)
        self.puppet = puppet_file.loads(self._text, path)

    def save(self, puppet: Puppet) -> None:
        """Write a puppet into the file; values that do not change, comments and the layout stay.

        Parameters
        ----------
        puppet : Puppet
            A limb or handle with the name of one in the file replaces it; one with another name replaces one whose name
            the puppet does not have, or is new.

        Raises
        ------
        PuppetError
            The file has changed since it was loaded or saved.
        OutputError
        """
        path = self.path.resolve()
        if not path.is_file() or puppet_file.read(path) != self._text:
            raise PuppetError(
                self.path,
                found="a file that has changed since it was loaded",
                expected="the file as it was last loaded or saved",
                fix="Reload the file, which discards unsaved edits, or restore its previous version.",
            )
        text = with_puppet(self._text, self.puppet, puppet)
        if puppet_file.loads(text, self.path) != puppet:
            raise PuppetError(
                self.path,
                found="a layout that cannot be edited",
                expected="tables as `puppetline new` writes them",
                fix="Edit the file by hand and reload it.",
            )
        with written_whole(path) as beside:
            beside.write_bytes(text.encode())
            shutil.copymode(path, beside)
        self._text, self.puppet = text, puppet


def with_puppet(text: str, before: Puppet, after: Puppet) -> str:
    """Return the text of a puppet file with another puppet.

    Parameters
    ----------
    text : str
        TOML.
    before, after : Puppet
        Contents of the file now and after the edit.
    """
    document = tomlkit.parse(text)
    for name in ("limb", "handle", "morph", "channel"):
        _update_tables(document, name, getattr(before, name), getattr(after, name))
    if after.root is None:
        document.pop("root", None)
    elif before.root is None:
        document["root"] = tomlkit.item(root_values(after.root))
    else:
        _update(document["root"], before.root, after.root)
    for name in SETTINGS:
        was, becomes = getattr(before, name), getattr(after, name)
        if was != becomes and name not in document:
            document[name] = tomlkit.table()
        _update(document.get(name), was, becomes)
    written = tomlkit.dumps(document)
    return re.sub("\r?\n", "\r\n", written) if "\r\n" in text else written


def _update_tables(document: Any, name: str, before: Sequence[Any], after: Sequence[Any]) -> None:
    """Change, add, remove and reorder the tables of a list."""
    were, become = ([_name(each) for each in tables] for tables in (before, after))
    sources = list(range(len(before))) if were == become else _sources(were, become)
    if sources == list(range(len(before))):
        for table, was, becomes in zip(document.get(name, ()), before, after, strict=True):
            _update(table, was, becomes)
        return
    if not after:
        document.pop(name, None)
        return
    if not isinstance(document.get(name), AoT | None):
        return  # an array of inline tables, which `save` then refuses
    present, tables = list(document.get(name, ())), tomlkit.aot()
    for source, becomes in zip(sources, after, strict=True):
        table = tomlkit.table() if source is None else present[source]
        if source is None:
            values = becomes.model_dump(exclude_none=True, exclude_defaults=True)
            table.update({key: as_toml(value) for key, value in values.items()})
            table.add(tomlkit.nl())
        else:
            _update(table, before[source], becomes)
        tables.append(table)
    document[name] = tables


def _name(table: Any) -> str:
    """Return by what a table of a list is known."""
    return f"{table.channel} {table.target}" if isinstance(table, MorphTable) else str(table.name)


def _sources(before: list[str], after: list[str]) -> list[int | None]:
    """Return which table of before each one of after is: of the same name, else one that was renamed, else None."""
    unnamed = [index for index, name in enumerate(before) if name not in after]
    new = [name for name in after if name not in before]
    renamed = dict(zip(new, unnamed, strict=False)) if len(before) == len(after) else {}
    return [before.index(name) if name in before else renamed.get(name) for name in after]


def _update(table: Any, before: Table, after: Table) -> None:
    """Change those keys of a table that differ; existing keys keep their place and comment."""
    for key in type(after).model_fields:
        value = getattr(after, key)
        if value == getattr(before, key):
            continue
        if value is None:
            table.remove(key)
            continue
        value = as_toml(value)
        if key in table:
            table[key] = value
        else:
            _append(table, key, value)


def _append(table: AbstractTable, key: str, value: Any) -> None:
    """Add a key directly after the last one; comments below that belong to the next table."""
    body = table.value.body
    end = 1 + max((index for index, (known, _) in enumerate(body) if known is not None), default=-1)
    rest = [] if isinstance(table, InlineTable) else body[end:]
    del body[len(body) - len(rest) :]
    table[key] = value
    body.extend(rest)
