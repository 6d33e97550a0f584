"""`puppetline inspect`: what a file contains."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from engine_bridge.cli import options
from engine_bridge.cli.options import FILE

IDENTIFIERS = ("revision",)
"""Keys of whole numbers that identify something, and are written without commas."""


@click.command()
@click.argument("file", type=FILE)
@options.as_json
def inspect(file: Path, as_json: bool) -> None:
    """Describe a mesh, a recording, a puppet file or a .glb."""
    from engine_bridge.inspection import files

    facts = files.inspect(file)
    options.show(facts, as_json, *_outline(facts))


def _outline(value: Any, depth: int = 0) -> Iterator[str]:
    """Return nested values as indented lines."""
    for key, item in value.items() if isinstance(value, dict) else enumerate(value, 1):
        label = f"{'  ' * depth}{str(key).replace('_', ' ')}"
        if isinstance(item, (dict, list)) and item and isinstance(next(iter(item)), (dict, str, list)):
            yield f"{label}:"
            yield from _outline(item, depth + 1)
        elif isinstance(item, list):
            yield f"{label}: {', '.join(map(_plain, item)) or 'none'}"
        else:
            yield f"{label}: {item if key in IDENTIFIERS else _plain(item)}"


def _plain(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    return f"{value:.5g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)
