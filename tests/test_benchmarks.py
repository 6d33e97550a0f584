"""Benchmarks import what there is; what they measure is not tested."""

from importlib import import_module

import pytest

from .conftest import ROOT

NAMES = sorted(path.stem for path in (ROOT / "benchmarks").glob("[!_]*.py"))


@pytest.mark.parametrize("name", NAMES)
def test_a_benchmark_imports_what_there_is(name, monkeypatch):
    monkeypatch.syspath_prepend(ROOT)
    try:
        import_module(f"benchmarks.{name}")
    except ModuleNotFoundError as error:
        if (ROOT / error.name.partition(".")[0]).exists():
            raise
        pytest.skip(f"{error.name} is not here")
