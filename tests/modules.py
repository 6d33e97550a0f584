"""Modules that belong to no package: the example clients, and the script that has recorded tests/vectors."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from .conftest import ROOT


def load(path):
    """Return the module of a file, whose path begins at the root of the repository."""
    spec = spec_from_file_location(Path(path).stem, ROOT / path)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
