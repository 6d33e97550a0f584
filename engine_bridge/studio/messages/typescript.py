"""The page's types of what the server sends, which are made from the classes of the messages.

    python -m engine_bridge.studio.messages.typescript

writes them to ``page/src/messages.ts``, and those of puppet and scene files to ``page/src/tables.ts``.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from types import ModuleType, NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel

from engine_bridge.film import scene
from engine_bridge.puppet import puppet
from engine_bridge.service.monitoring.status import Status, TimelineStatus
from engine_bridge.studio.messages.characters import PuppetReply
from engine_bridge.studio.messages.connection import Greeting, ServerError
from engine_bridge.studio.messages.film import FilmReply, Install, ShareReply
from engine_bridge.studio.messages.film_plan import FilmPlan
from engine_bridge.studio.messages.performers import LookReply, SmoothingReply, Sources
from engine_bridge.studio.messages.screen import ScreenSettings
from engine_bridge.studio.messages.state import State, UploadKind, UploadReply
from engine_bridge.studio.messages.takes import ExportReply


def _tables(module: ModuleType) -> list[type[BaseModel]]:
    """Return the tables that a module defines."""
    defined = [each for each in vars(module).values() if isinstance(each, type) and each.__module__ == module.__name__]
    return [each for each in defined if issubclass(each, BaseModel)]


def _optional(table: type[BaseModel]) -> list[str]:
    return [key for key, field in table.model_fields.items() if not field.is_required()]


FOLDER = Path(__file__).parents[1] / "page" / "src"

PUPPET = {each: each.__name__.removesuffix("Table") for each in _tables(puppet)}
"""Classes of a puppet's tables."""

SCENE = {each: f"Film{each.__name__.removesuffix('Table')}" for each in _tables(scene)}
"""Classes of a scene file's tables."""

TABLES = PUPPET.keys() | SCENE.keys()

NAMES: dict[type, str] = {
    State: "ServerState",
    **SCENE,
    scene.FilmTable: "FilmFormat",
    TimelineStatus: "Timeline",
    Status: "ServiceReport",
    **PUPPET,
    puppet.CharacterTable: "PuppetCharacter",
    puppet.ChannelTable: "Range",
}
"""Names of classes in the page, where they are others."""

OMITTED: dict[type, Collection[str]] = {
    **{each: _optional(each) for each in (*PUPPET, *SCENE)},
    scene.TakeTable: ("user", "loop", "fade", "position", "turn", "sound"),
    puppet.CharacterTable: puppet.CharacterTable.model_fields,
}
"""Keys that the page omits where it makes an object: the server then uses their defaults."""

OTHERS: dict[tuple[type, str], str] = {
    (PuppetReply, "puppet"): "Puppet",
    (puppet.SmoothingTable, "max_deviation"): "number | null",
}
"""Types of keys that JSON has no type for: null is an infinite deviation."""

MAX_NAMES = 20
"""Maximum number of names in a type; a longer list, such as that of all channels, is any text."""

ROOTS: tuple[type, ...] = (
    Greeting,
    State,
    ServerError,
    Sources,
    LookReply,
    SmoothingReply,
    PuppetReply,
    puppet.Puppet,
    UploadReply,
    ExportReply,
    FilmReply,
    FilmPlan,
    ShareReply,
    ScreenSettings,
    Status,
)
"""Classes of what is sent; those in them follow."""

HEADS = {
    "tables.ts": """/** Tables of puppet and scene files, made from the classes of engine_bridge. */

import type { Joint } from "./model/skeleton";
""",
    "messages.ts": """/** What the server sends, made from the classes of engine_bridge/studio/messages. */

import type { %s } from "./tables";

export type * from "./tables";
""",
}
"""Beginning of each file."""

ALIASES: dict[str, Any] = {
    "UploadKind": UploadKind,
    "Extra": get_type_hints(Install)["extra"],
    "Direction": puppet.Direction,
    "AxisSet": puppet.AxisSet,
}
"""Types that have a name."""

NAMED: dict[Any, str] = {
    str: "string",
    int: "number",
    float: "number",
    bool: "boolean",
    NoneType: "null",
    Any: "unknown",
    puppet.JointName: "Joint",
    **{alias: name for name, alias in ALIASES.items()},
}
"""Types in the page, by those here."""


def files() -> dict[str, str]:
    """Return the text of each file by its name."""
    waiting, bodies = list[type](ROOTS), dict[type, str]()
    while waiting:
        each = waiting.pop(0)
        if each not in bodies:
            used: list[type] = []
            omitted = OMITTED.get(each, ())
            keys = "".join(
                f"  readonly {key}{'?' * (key in omitted)}: {_type(kind, used)};\n" for key, kind in _keys(each)
            )
            bodies[each] = f"\nexport interface {_name(each)} {{\n{keys}}}\n"
            waiting += used
    aliases = {name: f"\nexport type {name} = {_union(alias)};\n" for name, alias in ALIASES.items()}
    tables = "".join([aliases.pop("Direction"), aliases.pop("AxisSet"), *_of(bodies, TABLES)])
    others = "".join([*aliases.values(), *_of(bodies, bodies.keys() - TABLES)])
    imported = [name for each in bodies.keys() & TABLES if re.search(rf"\b{(name := _name(each))}\b", others)]
    return {
        "tables.ts": HEADS["tables.ts"] + tables,
        "messages.ts": HEADS["messages.ts"] % ", ".join(sorted(imported)) + others,
    }


def _of(bodies: Mapping[type, str], chosen: Collection[type]) -> list[str]:
    return [body for each, body in bodies.items() if each in chosen]


def _name(each: type) -> str:
    return NAMES.get(each, each.__name__)


def _keys(each: type) -> Iterator[tuple[str, Any]]:
    """Yield the keys of a class and their types."""
    hints = get_type_hints(each, include_extras=True)
    for key in each.model_fields if issubclass(each, BaseModel) else hints:
        yield key, OTHERS.get((each, key), hints[key])


def _type(kind: Any, used: list[type]) -> str:
    """Return the TypeScript of a type, and add the classes in it to those that are used."""
    if isinstance(kind, str):
        return kind
    if kind in NAMED:
        return NAMED[kind]
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _type(arguments[0], used)
    if origin is Literal:
        return _union(kind) if len(arguments) <= MAX_NAMES else "string"
    if origin in (Union, UnionType):
        return " | ".join(dict.fromkeys(_type(each, used) for each in arguments))
    if origin in (dict, Mapping):
        return f"Readonly<Record<string, {_type(arguments[1], used)}>>"
    if origin is tuple and arguments[-1] is not ...:
        return f"readonly [{', '.join(_type(each, used) for each in arguments)}]"
    if origin in (list, tuple, Sequence):
        item = _type(arguments[0], used)
        return f"readonly ({item})[]" if " " in item else f"readonly {item}[]"
    if is_dataclass(kind) or issubclass(kind, BaseModel):
        used.append(kind)
        return _name(kind)
    raise TypeError(kind)


def _union(names: Any) -> str:
    return " | ".join(f'"{name}"' for name in get_args(names))


if __name__ == "__main__":
    for name, text in files().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
