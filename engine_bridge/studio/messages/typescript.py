"""The page's types of what the server sends, which are made from the classes of the messages.

    python -m engine_bridge.studio.messages.typescript

writes them to ``page/src/messages.ts``.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

from pydantic import BaseModel

from engine_bridge.film.scene import TakeTable
from engine_bridge.service.monitoring.status import TimelineStatus
from engine_bridge.studio.messages.characters import PuppetReply
from engine_bridge.studio.messages.connection import Greeting, ServerError
from engine_bridge.studio.messages.film import FilmReply, Install
from engine_bridge.studio.messages.performers import LookReply, SmoothingReply, Sources
from engine_bridge.studio.messages.state import State, UploadKind, UploadReply
from engine_bridge.studio.messages.takes import ExportReply

PATH = Path(__file__).parents[1] / "page" / "src" / "messages.ts"

NAMES: dict[type, str] = {State: "ServerState", TakeTable: "FilmTake", TimelineStatus: "Timeline"}
"""Names of classes in the page, where they are others."""

OMITTED: dict[type, tuple[str, ...]] = {TakeTable: ("user", "loop", "fade", "position", "turn", "sound")}
"""Keys that the page omits where it makes an object: the server then uses their defaults."""

ROOTS: tuple[type, ...] = (
    Greeting,
    State,
    ServerError,
    Sources,
    LookReply,
    SmoothingReply,
    PuppetReply,
    UploadReply,
    ExportReply,
    FilmReply,
)
"""Classes of what is sent; those in them follow."""

HEAD = """/** What the server sends: made from the classes of engine_bridge/studio/messages, which describe it. */

import type {{ Puppet }} from "./model/puppet";

export type UploadKind = {kinds};

export type Extra = {extras};
"""

PLAIN = {str: "string", int: "number", float: "number", bool: "boolean", NoneType: "null", Any: "unknown"}


def text() -> str:
    """Return the file."""
    waiting, made = list[type](ROOTS), dict[type, str]()
    while waiting:
        each = waiting.pop(0)
        if each not in made:
            used: list[type] = []
            omitted = OMITTED.get(each, ())
            keys = "".join(
                f"  readonly {key}{'?' * (key in omitted)}: {_type(kind, used)};\n" for key, kind in _keys(each)
            )
            made[each] = f"\nexport interface {NAMES.get(each, each.__name__)} {{\n{keys}}}\n"
            waiting += used
    kinds, extras = (_type(kind, []) for kind in (UploadKind, get_type_hints(Install)["extra"]))
    return HEAD.format(kinds=kinds, extras=extras) + "".join(made.values())


def _keys(each: type) -> Iterator[tuple[str, Any]]:
    """Yield the keys of a class and their types."""
    hints = get_type_hints(each)
    for key in each.model_fields if issubclass(each, BaseModel) else hints:
        yield key, "Puppet" if (each, key) == (PuppetReply, "puppet") else hints[key]


def _type(kind: Any, used: list[type]) -> str:
    """Return the TypeScript of a type, and add the classes in it to those that are used."""
    if isinstance(kind, str):
        return kind
    if kind in PLAIN:
        return PLAIN[kind]
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _type(arguments[0], used)
    if origin is Literal:
        return " | ".join(f'"{value}"' for value in arguments)
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
        return NAMES.get(kind, kind.__name__)
    raise TypeError(kind)


if __name__ == "__main__":
    PATH.write_text(text(), encoding="utf-8")
