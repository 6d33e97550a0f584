"""A batch on worker processes."""

from dataclasses import replace

import pyarrow.parquet as pq
import pytest

from engine_bridge.batch.batch import make_jobs, make_plan, new_run, run
from engine_bridge.batch.conversion import BatchSettings
from engine_bridge.batch.recordings import find_recordings
from engine_bridge.batch.store import Store
from engine_bridge.batch.workers import convert_in_processes
from engine_bridge.performance.settings import Settings
from puppetline.errors import PuppetError, PuppetlineError

from ..refusals import refused
from .conftest import results


@pytest.fixture
def prepared(logs, puppets, tmp_path):
    """A plan for all recordings with one puppet, and its settings."""
    batch = BatchSettings(tmp_path / "out", new_run(), Settings(), "longest")
    found = find_recordings([str(logs)], batch.folder, batch.settings.log).found
    return make_plan(make_jobs(found, puppets[:1], batch, None), batch), batch


def test_results_of_workers_are_those_of_convert(logs, puppets, converted, batch, tmp_path):
    result = batch(logs, "--workers", 2, "--no-report", puppets=puppets)
    assert (result["made"], result["unchanged"], result["failures"]) == (12, 0, [])
    assert results(tmp_path / "out") == converted
    rows = pq.read_table(tmp_path / "out" / "manifest.parquet").to_pylist()
    assert {row["output"]: row["bytes"] for row in rows} == {name: len(content) for name, content in converted.items()}


DEADLY = """
    from capture.formats import read_log
    from engine_bridge.batch import conversion

    def read_or_die(path, options):
        if path.stem == "b" or (path.stem == "c" and not os.path.exists("killed by c")):
            open(f"killed by {path.stem}", "w").close()
            os.kill(os.getpid(), 9)
        return read_log(path, options)

    conversion.read_recording = read_or_die
"""
"""A recording kills each worker that reads it, and another one only the first."""


@pytest.mark.slow
def test_a_recording_that_always_kills_its_worker_fails_and_those_whose_worker_is_killed_once_do_not(
    prepared, walks, in_workers, tmp_path, monkeypatch
):
    plan, batch = prepared
    monkeypatch.chdir(tmp_path)
    in_workers(DEADLY)
    with Store(batch.folder, batch.run).opened():
        outcomes = list(run(plan, batch, 2, lambda: None))
    (failed,) = [outcome for outcome in outcomes if outcome.record.has_failed]
    assert failed.job.log.stem == "b"
    assert results(tmp_path / "out") == {name: each for name, each in walks.items() if name != "walks/b.glb"}


def converted_by_worker(job, batch):
    return list(convert_in_processes([job], batch, 1, lambda: None))


def test_workers_that_cannot_start_end_the_batch_with_a_message(prepared, in_workers):
    plan, batch = prepared
    in_workers("    os._exit(3)\n")
    assert refused(PuppetlineError, converted_by_worker, plan.waiting[0], batch).where == "the workers"


def test_an_error_that_is_not_about_a_recording_is_that_of_the_worker(prepared):
    plan, batch = prepared
    job = replace(plan.waiting[0], identity="of another version")
    assert refused(PuppetError, converted_by_worker, job, batch).where == str(job.puppet)
