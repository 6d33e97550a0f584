"""Converts a puppet to values of JSON's types, with all keys, for the page, and back."""

import math
from pathlib import PurePath
from typing import Any

from engine_bridge.puppet.puppet import Puppet
from engine_bridge.puppet.puppet_file import check

WHERE = "the puppet"


def values_of(puppet: Puppet) -> dict[str, Any]:
    """Return all values of a puppet in JSON's types; an infinite deviation is None, and the mesh is a name."""
    values = puppet.model_dump(mode="json")
    values["character"]["mesh"] = PurePath(puppet.character.mesh).name
    if math.isinf(puppet.smoothing.max_deviation):
        values["smoothing"]["max_deviation"] = None
    return values


def puppet_of(values: dict[str, Any], mesh: str) -> Puppet:
    """Return the puppet with values from the page; its mesh is `mesh`, whatever the page has sent.

    Raises
    ------
    PuppetError
        The first error in the values.
    """
    given = dict(values)
    character, smoothing = given.get("character"), given.get("smoothing")
    given["character"] = (character if isinstance(character, dict) else {}) | {"mesh": mesh}
    if isinstance(smoothing, dict) and smoothing.get("max_deviation", 0) is None:
        given["smoothing"] = smoothing | {"max_deviation": math.inf}
    return check(given, WHERE)


def merged(values: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """Return values with changes; tables are merged key by key, and lists are replaced as a whole (RFC 7396)."""
    tables = {
        key: merged(values[key], change)
        for key, change in changes.items()
        if isinstance(change, dict) and isinstance(values.get(key), dict)
    }
    return values | changes | tables
