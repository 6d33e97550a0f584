"""A batch on worker processes, as a user runs it."""

import os

import pyarrow.parquet as pq
import pytest

from engine_bridge.batch.cluster import connected
from engine_bridge.export.convert import convert
from engine_bridge.performance.settings import Settings

from .conftest import NAMES, results


@pytest.fixture(scope="module")
def converted(logs, puppets, tmp_path_factory):
    """What `convert` writes for each recording with each puppet."""
    folder = tmp_path_factory.mktemp("converted")
    for puppet in puppets:
        for name in NAMES:
            output = folder / puppet.stem / f"{name}.glb"
            output.parent.mkdir(parents=True, exist_ok=True)
            convert(logs / f"{name}.log", puppet, output, Settings())
    return results(folder)


def test_results_of_workers_are_those_of_convert(logs, puppets, converted, batch, tmp_path):
    result = batch(logs, "--workers", 2, "--no-report", puppets=puppets)
    assert (result["made"], result["unchanged"], result["failures"]) == (12, 0, [])
    assert results(tmp_path / "out") == converted
    rows = pq.read_table(tmp_path / "out" / "manifest.parquet").to_pylist()
    assert {row["output"]: row["bytes"] for row in rows} == {name: len(content) for name, content in converted.items()}


@pytest.mark.slow
def test_workers_keep_the_memory_that_they_use_again():
    """Dask sets this variable; conversions would take half as long again."""
    with connected(None, 1, 1, dashboard=False) as client:
        client.wait_for_workers(1)
        environments = client.run(lambda: dict(os.environ)).values()
    assert ["MALLOC_TRIM_THRESHOLD_" in each for each in environments] == [False]
    assert [each["OMP_NUM_THREADS"] for each in environments] == ["1"]
