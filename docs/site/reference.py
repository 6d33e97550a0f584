"""A Sphinx extension that writes the references of commands, TOML files and Python modules into their pages.

A page says where with a comment such as ``<!-- reference: commands -->``, which a reader of the Markdown does not see.
"""

import re
from collections.abc import Iterator
from typing import Any

import click
from pydantic import BaseModel
from sphinx.application import Sphinx

from engine_bridge.cli.main import COMMANDS, main
from engine_bridge.film.scene import Scene
from engine_bridge.puppet.puppet import Puppet
from engine_bridge.service.loading.service_file import ServiceFile

MODULES = {
    "Programs and notebooks": (
        "puppetline.recordings",
        "puppetline.characters",
        "puppetline.player",
        "engine_bridge.performance.character_motion",
        "engine_bridge.client.client",
    ),
    "Skeletons": (
        "capture.skeleton",
        "capture.formats",
        "capture.clip",
        "capture.timeline",
        "capture.smoothing",
        "capture.recording",
        "capture.sources.registry",
    ),
    "Meshes and motion": (
        "solver.surface.mesh",
        "solver.anatomy.limb_finding",
        "solver.model.reduced_model",
        "solver.model.binding",
        "solver.motion.limbs",
        "solver.motion.retarget",
        "solver.motion.deformer",
        "solver.skinning.weights",
    ),
    "Characters and files": (
        "engine_bridge.character.character",
        "engine_bridge.puppet.puppet_file",
        "engine_bridge.performance.prepared_character",
        "engine_bridge.performance.settings",
        "engine_bridge.performance.clip",
        "engine_bridge.performance.motion",
        "engine_bridge.performance.pose",
        "engine_bridge.export.convert",
        "engine_bridge.film.film",
        "engine_bridge.client.listening",
        "puppetline.errors",
    ),
}
"""Modules of the Python reference, by heading."""


def commands() -> Iterator[str]:
    """Yield the reference of all commands, from click."""
    parent = click.Context(main, info_name="puppetline")
    for name in COMMANDS:
        command = main.get_command(parent, name)
        if command is None:
            continue
        context = click.Context(command, info_name=name, parent=parent)
        yield f"## {name}\n\n```text\n{command.get_usage(context).removeprefix('Usage: ')}\n```\n"
        yield _text(command.help or "") + "\n"
        records = (each.get_help_record(context) for each in command.get_params(context))
        yield "| option | effect |\n| --- | --- |"
        rows = ((record[0].replace("|", "\\|"), _text(record[1])) for record in records if record)
        yield from (f"| `{option}` | {effect} |" for option, effect in rows if effect)
        yield ""


def puppet_file() -> Iterator[str]:
    """Yield the reference of puppet files, from their schema."""
    return _tables(Puppet)


def service_file() -> Iterator[str]:
    """Yield the reference of service files, from their schema."""
    return _tables(ServiceFile)


def scene_file() -> Iterator[str]:
    """Yield the reference of scene files, from their schema."""
    return _tables(Scene)


def python() -> Iterator[str]:
    """Yield directives that document the modules of `MODULES`."""
    for heading, modules in MODULES.items():
        yield f"## {heading}\n"
        for module in modules:
            yield f"### {module}\n\n```{{eval-rst}}\n.. automodule:: {module}\n   :members:\n```\n"


def _tables(file: type[BaseModel]) -> Iterator[str]:
    """Yield a table of keys for the file, and for each table in it."""
    schema = file.model_json_schema()
    tables = {"": schema} | schema["$defs"]
    for name, table in tables.items():
        if name:
            title, _, rest = _first_line(table).partition(": ")
            yield f"### `{title}`\n\n{_text(rest[:1].upper() + rest[1:])}\n"
        yield "| key | value | default |\n| --- | --- | --- |"
        for key, value in table["properties"].items():
            default = value.get("default")
            shown = "–" if default is None or isinstance(default, dict) else f"`{_toml(default)}`"
            yield f"| `{key}` | {_value(value, tables)} | {'required' if key in table.get('required', ()) else shown} |"
        yield ""


def _value(schema: dict[str, Any], tables: dict[str, Any]) -> str:
    """Return what a key accepts, in words."""
    if "$ref" in schema:
        return f"table `{_first_line(tables[schema['$ref'].rpartition('/')[2]]).partition(': ')[0]}`"
    if "anyOf" in schema:
        return " or ".join(_value(each, tables) for each in schema["anyOf"] if each.get("type") != "null")
    if "enum" in schema or "const" in schema:
        return ", ".join(f"`{_toml(each)}`" for each in schema.get("enum", [schema.get("const")]))
    if schema.get("type") == "array":
        items = schema.get("prefixItems", [])
        if items:
            return f"list of {len(items)}: {_value(items[0], tables)}"
        return f"list: {_value(schema['items'], tables)}"
    kind = {"boolean": "`true` or `false`", "string": "text"}.get(schema.get("type", ""), schema.get("type", "any"))
    limits = [
        f"{sign} {schema[key]:g}"
        for key, sign in (("minimum", "≥"), ("exclusiveMinimum", ">"), ("maximum", "≤"), ("exclusiveMaximum", "<"))
        if key in schema and abs(schema[key]) < 1e9
    ]
    return " ".join([kind, ", ".join(limits)]).strip()


def _first_line(table: dict[str, Any]) -> str:
    """Return the first line of a table's description, without what only readers of the code can follow."""
    return re.sub(r"[;,]? see `.*", ".", str(table["description"]).partition("\n")[0])


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


def _text(text: str) -> str:
    """Return paragraphs of click, or of a docstring, as Markdown."""
    paragraphs = (" ".join(paragraph.split()) for paragraph in text.replace("\b", "").split("\n\n"))
    return re.sub(r"([|<>*_\\\[\]])", r"\\\1", "\n\n".join(paragraphs))


def _insert(_app: Sphinx, _name: str, source: list[str]) -> None:
    makers = {
        "commands": commands,
        "puppet": puppet_file,
        "service": service_file,
        "scene": scene_file,
        "python": python,
    }
    source[0] = re.sub(r"<!-- reference: (\w+) -->", lambda match: "\n".join(makers[match[1]]()), source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.connect("source-read", _insert)
    return {"parallel_read_safe": True}
