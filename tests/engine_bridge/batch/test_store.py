import itertools
import os
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from engine_bridge.batch.identity import FileState
from engine_bridge.batch.row import Row
from engine_bridge.batch.store import OWN_FOLDER, PARTIAL_FOLDER, STALE_SECONDS, Job, Record, Store
from puppetline.errors import OutputError

from ..refusals import refused
from .conftest import partial


@pytest.fixture
def store(tmp_path):
    store = Store(tmp_path / "out", "run")
    with store.opened():
        yield store


@pytest.fixture
def job(tmp_path):
    (tmp_path / "a.log").write_bytes(b"recording")
    return Job("p/x/a", tmp_path / "a.log", tmp_path / "p.toml", "identity")


@pytest.fixture
def write(store, job):
    """Write results with their record, as a conversion does."""

    def make(job=job, **results):
        for name, content in results.items():
            with store.written(f"p/x/{name}.glb") as path:
                path.write_bytes(content)
        files = {f"p/x/{name}.glb": FileState.of(store.folder / f"p/x/{name}.glb") for name in results}
        row = Row("done", "p/x/a.glb", str(job.log), str(job.puppet), "own", 1, "morph", notes=("é", "b"), error=0.5)
        record = Record(job.identity, store.run, FileState.of(job.log), (row,), files)
        store.save(job, record)
        return record

    return make


def test_a_record_is_read_as_it_was_written(store, job, write):
    record = write(a=b"result")
    assert store.load(job.name) == record
    assert store.is_current(record, job)
    assert [each for _, each in store.records()] == [record]
    assert partial(store.folder) == []


@pytest.mark.parametrize("content", [b"", b"{", b'{"identity": "x"}', b"[]", b"\xff"])
def test_a_damaged_record_is_none(store, job, write, content):
    write(a=b"result")
    path = Path(next(iter(store.records()))[0])
    path.write_bytes(content)
    assert store.load(job.name) is None
    assert list(store.records()) == []


def test_a_result_is_out_of_date_if_anything_that_made_it_has_changed(store, job, write):
    record = write(a=b"result")
    assert not store.is_current(record, replace(job, identity="other"))
    job.log.write_bytes(b"recordinG")
    assert not store.is_current(record, job)
    job.log.write_bytes(b"recording")  # with another time, but the same content
    assert store.is_current(record, job)
    job.log.unlink()
    assert not store.is_current(record, job)


@pytest.mark.parametrize("content", [None, b"", b"resul", b"resulT"])
def test_a_result_that_is_absent_or_other_than_recorded_is_not_whole(store, write, content):
    record, path = write(a=b"result"), store.folder / "p/x/a.glb"
    path.unlink()
    if content is not None:
        path.write_bytes(content)
        os.utime(path, ns=(0, record.files["p/x/a.glb"].modified + 1))
    assert not store.is_whole(record)


def test_results_that_are_not_made_any_more_are_deleted(store, write):
    write(a=b"1", b=b"2")
    write(b=b"3")
    assert [path.name for path in store.folder.rglob("*.glb")] == ["b.glb"]


def test_an_error_leaves_the_former_result_and_no_partial_file(store, job, write):
    write(a=b"former")
    with pytest.raises(ZeroDivisionError), store.written("p/x/a.glb") as path:  # noqa: PT012
        path.write_bytes(b"half")
        raise ZeroDivisionError
    assert (store.folder / "p/x/a.glb").read_bytes() == b"former"
    assert partial(store.folder) == []


def test_starts_are_counted_within_a_batch_until_a_record_is_written(store, job, write):
    assert [store.start(job) for _ in range(3)] == [0, 1, 2]
    assert Store(store.folder, "other").start(job) == 0
    assert store.start(job) == 3
    write(a=b"result")
    assert store.start(job) == 0


def test_old_partial_files_and_those_of_this_batch_are_deleted(tmp_path):
    folder = tmp_path / OWN_FOLDER / PARTIAL_FOLDER
    folder.mkdir(parents=True)
    for name in ("old", "new", ".run-1.77.glb"):
        (folder / name).touch()
    os.utime(folder / "old", (time.time() - STALE_SECONDS - 1,) * 2)
    with Store(tmp_path, "run").opened():
        assert sorted(path.name for path in folder.iterdir()) == [".run-1.77.glb", "new"]
    assert [path.name for path in folder.iterdir()] == ["new"]


def test_a_folder_that_cannot_be_created_is_an_error(tmp_path):
    (tmp_path / "out").touch()
    error = refused(OutputError, Store(tmp_path / "out", "run").opened().__enter__)
    assert error.where == str(tmp_path / "out")


def killed_at(step, work):
    """Do some work in a process that is killed when it opens, renames or deletes a file for the nth time.

    Returns
    -------
    bool
        Whether the work was done before.
    """
    child = os.fork()
    if child == 0:
        steps = itertools.count()

        def count(event, _arguments):
            if event in ("open", "os.rename", "os.remove") and next(steps) == step:
                os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        work()
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are killed as on POSIX")
def test_killed_at_any_step_a_conversion_leaves_whole_results_and_a_record_of_none_that_is_not(store, job, write):
    former, steps = write(a=b"former"), 0
    new = replace(job, identity="new")
    while not killed_at(steps, lambda: write(new, a=b"result", b=b"other")):
        steps += 1
        found = {path.name: path.read_bytes() for path in store.folder.glob("p/x/*.glb")}
        assert found.keys() <= {"a.glb", "b.glb"}
        assert found["a.glb"] in (b"former", b"result")
        assert found.get("b.glb") in (None, b"other")
        record = store.load(job.name)
        assert record == former or (record.identity == "new" and store.is_whole(record))
    assert steps > 8
    assert store.is_current(store.load(job.name), new)
