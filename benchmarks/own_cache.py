"""A cache of reduced models for one measurement."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from engine_bridge.inspection.benchmark import CACHE_VARIABLES


@contextmanager
def own_cache(folder: Path) -> Iterator[None]:
    """Use an empty cache of reduced models in a folder, for this process and those that it starts."""
    cache = str(folder.resolve() / "cache")
    before = {name: os.environ.get(name) for name in CACHE_VARIABLES}
    os.environ.update(dict.fromkeys(CACHE_VARIABLES, cache))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
