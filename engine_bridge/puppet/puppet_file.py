"""Puppet files: reading them with a check of all values, and writing them."""

from pathlib import Path
from typing import Any

import tomlkit

from engine_bridge.character.character import CHARACTER_FILES
from engine_bridge.puppet.puppet import Puppet, RootTable
from puppetline import toml_schema
from puppetline.errors import PuppetError
from puppetline.files import written_whole
from puppetline.toml_schema import Table


def load(path: Path) -> Puppet:
    """Read and check a puppet file.

    Raises
    ------
    PuppetError
        With the line of a syntax error, or the table and key of anything else.
    """
    return loads(read(path), path)


def read(path: Path) -> str:
    """Read the text of a puppet file without parsing it.

    Raises
    ------
    PuppetError
    """
    if path.suffix.lower() in CHARACTER_FILES:
        raise PuppetError(
            path,
            found="a mesh",
            expected="a puppet file",
            fix=f"Create one for the mesh: puppetline new {path} -o PUPPET.toml",
        )
    fix = "Check the path, or create a puppet file: puppetline new MESH -o PUPPET.toml"
    return toml_schema.read_text(path, "a puppet file", fix, PuppetError)


def loads(text: str, where: str | Path) -> Puppet:
    """Parse and check the text of a puppet file.

    Parameters
    ----------
    text : str
    where : str or Path
        Name of the file in error messages.

    Raises
    ------
    PuppetError
        As `load` does.
    """
    return check(toml_schema.parse(text, where, PuppetError), where)


def check(values: dict[str, Any], where: str | Path) -> Puppet:
    """Check a puppet's values.

    Parameters
    ----------
    values : dict
        As parsed from TOML.
    where : str or Path
        Name of the file in error messages.

    Raises
    ------
    PuppetError
        For the first mistake.
    """
    return toml_schema.check(Puppet, values, where, PuppetError)


def dump(puppet: Puppet, path: Path, comment: str = "") -> None:
    """Write a puppet file, completely or not at all; `load` returns an equal puppet.

    Parameters
    ----------
    puppet : Puppet
    path : Path
    comment : str
        First line of the file, if there is one.

    Raises
    ------
    OutputError
    """
    with written_whole(path) as beside:
        beside.write_text((f"# {comment}\n\n" if comment else "") + dumps(puppet), encoding="utf-8")


def dumps(puppet: Puppet) -> str:
    """Return a puppet as TOML, without default values."""
    values = puppet.model_dump(exclude_none=True, exclude_defaults=True)
    document = tomlkit.document()
    document["character"] = values["character"]
    for name in ("limb", "handle", "morph", "channel"):
        if name in values:
            document.add(tomlkit.nl())
            document[name] = tomlkit.aot()
            for each in values[name]:
                table = tomlkit.table()
                table.update({key: as_toml(value) for key, value in each.items()})
                document[name].append(table)
    if puppet.root is not None:
        document["root"] = root_values(puppet.root)
    for name in ("retarget", "smoothing", "solver"):
        if name in values:
            document[name] = values[name]
    if "vrm" in values:
        document["vrm"] = {key: as_toml(value) for key, value in values["vrm"].items()}
    return tomlkit.dumps(document)


def root_values(root: RootTable) -> dict[str, Any]:
    """Return the values of a table [root]. Joint and axes are always written, because the table may not be empty."""
    return {"joint": root.joint, "axes": root.axes} | root.model_dump(exclude_defaults=True)


def as_toml(value: Any) -> Any:
    """Return nested tuples as nested lists, and tables in other tables as inline ones."""
    if isinstance(value, Table):
        value = value.model_dump(exclude_none=True)
    if not isinstance(value, dict):
        return [as_toml(item) for item in value] if isinstance(value, tuple) else value
    table = tomlkit.inline_table()
    table.update(value)
    return table
