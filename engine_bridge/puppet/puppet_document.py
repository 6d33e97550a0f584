"""Editing the mapping in a puppet file: comments, layout and all other values of the file stay as they are."""

import re
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.items import AbstractTable, InlineTable

from engine_bridge.puppet import puppet_file
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.puppet_file import root_values
from puppetline.errors import PuppetError
from puppetline.files import written_whole
from puppetline.toml_schema import Table

HANDLE_KEYS = "joint", "joints", "axes", "gain"
"""Keys of a handle that belong to the mapping."""

ROOT_KEYS = "joint", "axes", "turns", "feet"
"""Keys of the root that belong to the mapping."""


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
        """Write the mapping of a puppet into the file; all other values and the layout stay.

        Parameters
        ----------
        puppet : Puppet
            The puppet of the file, with other joints, axes and gains of handles, another root or scale.

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
        text = with_mapping(self._text, self.puppet, puppet)
        if puppet_file.loads(text, self.path) != puppet:
            raise PuppetError(
                self.path,
                found="a layout in which the mapping cannot be edited",
                expected="tables as `puppetline new` writes them",
                fix="Edit the file by hand and reload it.",
            )
        with written_whole(path) as beside:
            beside.write_bytes(text.encode())
            shutil.copymode(path, beside)
        self._text, self.puppet = text, puppet


def with_mapping(text: str, before: Puppet, after: Puppet) -> str:
    """Return the text of a puppet file with another mapping.

    Parameters
    ----------
    text : str
        TOML.
    before, after : Puppet
        Contents of the file now and after the edit.
    """
    document = tomlkit.parse(text)
    for table, was, becomes in zip(document.get("handle", ()), before.handle, after.handle, strict=True):
        _update(table, was, becomes, HANDLE_KEYS)
    if after.root is None:
        document.pop("root", None)
    elif before.root is None:
        document["root"] = tomlkit.item(root_values(after.root))
    else:
        _update(document["root"], before.root, after.root, ROOT_KEYS)
    if before.retarget.scale != after.retarget.scale:
        if "retarget" not in document:
            document["retarget"] = tomlkit.table()
        _update(document["retarget"], before.retarget, after.retarget, ("scale",))
    written = tomlkit.dumps(document)
    return re.sub("\r?\n", "\r\n", written) if "\r\n" in text else written


def _update(table: Any, before: Table, after: Table, keys: Iterable[str]) -> None:
    """Change those keys of a table that differ; existing keys keep their place and comment."""
    for key in keys:
        value = getattr(after, key)
        if value == getattr(before, key):
            continue
        if value is None:
            table.remove(key)
            continue
        value = list(value) if isinstance(value, tuple) else value
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
