"""Batches whose processes are killed, or that cannot write; every result under its name is complete afterwards."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import time

import numpy as np
import psutil
import pyarrow.parquet as pq
import pytest

from engine_bridge.batch.identity import FileState
from engine_bridge.batch.store import OWN_FOLDER, PARTIAL_FOLDER, Store

from ...effort import EFFORT
from ...waiting import wait_until
from .conftest import results

KILLS = 10 if EFFORT >= 1 else 1
"""Number of times that a process is killed; each time costs a whole batch."""

LOGS = 12

REMOVED = 6
"""Number of results that are removed before each batch, so that there is work."""

TIMEOUT_SECONDS = 300.0
"""Time after which a test fails, in seconds."""


@pytest.fixture(scope="module")
def many(record, dance, tmp_path_factory):
    """A folder of 12 recordings of half a second to two seconds."""
    folder = tmp_path_factory.mktemp("many")
    for index in range(LOGS):
        record(folder / f"{index:02}.log", dance(15 + 4 * index))
    return folder


@pytest.fixture(scope="module")
def start(commands, many, puppets):
    """Start `puppetline batch` for these recordings and both puppets, or those of some names."""

    def begin(folder, *arguments, names=("walks", "stands")):
        chosen = [each for puppet in puppets if puppet.stem in names for each in ("--puppet", puppet)]
        return commands.start(
            "batch", many, *chosen, "-o", folder, "--json", *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )

    return begin


@pytest.fixture(scope="module")
def finished(start):
    """Run a batch to its end and return its result."""

    def run(folder, *arguments, code=0, **more):
        with start(folder, *arguments, **more) as process:
            output, errors = process.stdout.read(), process.stderr.read()
            assert process.wait(TIMEOUT_SECONDS) == code, errors
        assert errors == ""
        return json.loads(output)

    return run


@pytest.fixture(scope="module")
def expected(finished, tmp_path_factory):
    """All results of a batch that nothing has disturbed, by name, and the seconds that it took."""
    folder = tmp_path_factory.mktemp("expected")
    finished(
        tmp_path_factory.mktemp("compiled"), "--workers", 0, "--no-report", "--shard", "1/10"
    )  # not in the seconds
    begin = time.monotonic()
    assert finished(folder, "--workers", 0, "--no-report")["made"] == 2 * LOGS
    return results(folder), time.monotonic() - begin


@pytest.fixture
def random():
    return np.random.default_rng(5)


def assert_whole(folder, expected):
    """Assert that every file under its name is as expected, byte by byte; return how many there are."""
    found = results(folder)
    assert found.keys() <= expected.keys()
    assert {name for name, content in found.items() if content != expected[name]} == set()
    return len(found)


def recorded(folder):
    """Names of the results that are there with a record."""
    store = Store(folder, "")
    return {name for _, record in store.records() if store.is_whole(record) for name in record.files}


def assert_finished(folder, expected, finished):
    """Assert that another batch makes only what is missing, and that the manifest agrees with the folder."""
    assert_whole(folder, expected)
    there = recorded(folder)
    states = {name: FileState.of(folder / name) for name in there}
    result = finished(folder, "--workers", 0, "--no-report", "--retry-failed")
    assert result["failures"] == []
    assert (result["made"], result["unchanged"]) == (2 * LOGS - len(there), len(there))
    assert results(folder) == expected
    assert {name: FileState.of(folder / name) for name in there} == states
    rows = pq.read_table(folder / "manifest.parquet").to_pylist()
    assert {row["output"]: row["bytes"] for row in rows} == {name: len(content) for name, content in expected.items()}


def remove_some(folder, random):
    """Remove results, of which some records are left without a result."""
    for name in random.permutation(sorted(results(folder)))[:REMOVED]:
        (folder / name).unlink()


def worker_processes(process):
    """Worker processes of a batch."""
    with contextlib.suppress(psutil.NoSuchProcess):
        return [
            child
            for child in psutil.Process(process.pid).children(recursive=True)
            if any("spawn_main" in part for part in child.cmdline())
        ]
    return []


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "starting"), [(0, 0), (2, 5)])
def test_a_client_that_is_killed_leaves_whole_results_and_no_process(
    start, finished, expected, random, tmp_path, workers, starting
):
    wanted, seconds = expected
    for _ in range(KILLS):
        remove_some(tmp_path, random)
        with start(tmp_path, "--workers", workers, "--no-report") as process:
            time.sleep(random.uniform(0, seconds + starting))
            left = worker_processes(process)
            process.kill()
            process.wait()
        psutil.wait_procs(left, timeout=TIMEOUT_SECONDS)
        assert [worker for worker in left if worker.is_running()] == []
        assert_whole(tmp_path, wanted)
    assert_finished(tmp_path, wanted, finished)


@pytest.mark.slow
def test_workers_that_are_killed_do_not_end_the_batch(start, finished, expected, random, tmp_path):
    wanted, _ = expected
    kills = 0
    while kills < KILLS:
        remove_some(tmp_path, random)
        with start(tmp_path, "--workers", 2, "--no-report") as process:
            while process.poll() is None:
                time.sleep(random.uniform(0, 4))
                workers = worker_processes(process)
                if workers and kills < KILLS:
                    with contextlib.suppress(psutil.NoSuchProcess):
                        random.choice(workers).kill()
                        kills += 1
            assert process.returncode == 0, process.stderr.read()
            assert json.loads(process.stdout.read())["failures"] == []
        assert_whole(tmp_path, wanted)
        assert list((tmp_path / OWN_FOLDER / PARTIAL_FOLDER).iterdir()) == []
    assert_finished(tmp_path, wanted, finished)


@pytest.mark.slow
def test_two_batches_into_one_folder_at_once(start, finished, expected, tmp_path):
    wanted, _ = expected
    with start(tmp_path, "--workers", 0, "--no-report") as one, start(tmp_path, "--workers", 1, "--no-report") as two:
        assert [one.wait(TIMEOUT_SECONDS), two.wait(TIMEOUT_SECONDS)] == [0, 0]
        assert [json.loads(each.stdout.read())["failures"] for each in (one, two)] == [[], []]
    assert results(tmp_path) == wanted
    rows = pq.read_table(tmp_path / "manifest.parquet").to_pylist()
    assert {row["output"] for row in rows} == wanted.keys()
    assert_finished(tmp_path, wanted, finished)


@contextlib.contextmanager
def mounted(folder, options):
    """Mount a file system in memory, or skip the test."""
    if os.name != "posix" or os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("only the superuser can mount a file system")
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no file system can be mounted: {done.stderr}")
    try:
        yield
    finally:
        # not at once: the kernel may still be closing the files of processes that were killed
        subprocess.run(["umount", "--lazy", folder], check=True)


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_a_full_disk_ends_the_batch_with_one_message_and_whole_results(start, finished, expected, tmp_path, workers):
    wanted, _ = expected
    size = sum(map(len, wanted.values()))
    with mounted(tmp_path, f"size={size // 3}"):
        with start(tmp_path, "--workers", workers, "--no-report") as process:
            assert process.wait(TIMEOUT_SECONDS) == 1
            assert process.stdout.read() == ""
            errors = process.stderr.read()
        assert errors.startswith(f"puppetline: {tmp_path}")
        assert "found a file that cannot be written (No space left on device)" in errors
        assert errors.count("\n") == 1
        assert 0 < assert_whole(tmp_path, wanted) < 2 * LOGS
        assert list((tmp_path / OWN_FOLDER / PARTIAL_FOLDER).iterdir()) == []
        subprocess.run(["mount", "-o", f"remount,size={2 * size}", tmp_path], check=True)
        assert_finished(tmp_path, wanted, finished)


def test_a_folder_without_rights_is_one_message_before_the_work(start, tmp_path):
    with mounted(tmp_path, "ro"), start(tmp_path) as process:
        assert process.wait(TIMEOUT_SECONDS) == 1
        assert process.stderr.read() == (
            f"puppetline: {tmp_path}: found a file that cannot be written (Read-only file system); expected a folder "
            "with write permission and free space. Choose another folder, free disk space, or change the folder's "
            "permissions.\n"
        )


@pytest.mark.parametrize("workers", [0, pytest.param(2, marks=pytest.mark.slow)])
def test_ctrl_c_ends_the_batch_quietly_and_it_continues(start, finished, expected, tmp_path, workers):
    wanted, _ = expected
    with start(tmp_path, "--workers", workers, "--no-report") as process:
        wait_until(lambda: len(worker_processes(process)) == workers, TIMEOUT_SECONDS)
        for each in worker_processes(process):  # which have only begun to start
            os.kill(each.pid, signal.SIGINT)
        wait_until(lambda: len(results(tmp_path)) >= 3, TIMEOUT_SECONDS)
        started = worker_processes(process)
        for each in [process, *started]:  # as a terminal does
            os.kill(each.pid, signal.SIGINT)
        assert process.wait(TIMEOUT_SECONDS) == 1
        assert (process.stdout.read(), process.stderr.read()) == ("", "puppetline: stopped\n")
        assert [worker for worker in started if worker.is_running()] == []
    assert 3 <= assert_whole(tmp_path, wanted) < 2 * LOGS
    assert list((tmp_path / OWN_FOLDER / PARTIAL_FOLDER).iterdir()) == []
    assert_finished(tmp_path, wanted, finished)


@pytest.mark.slow
def test_sigterm_ends_the_batch_and_its_workers_without_a_word(start, tmp_path):
    with start(tmp_path, "--workers", 2, "--no-report") as process:
        wait_until(lambda: results(tmp_path), TIMEOUT_SECONDS)
        process.terminate()
        assert process.wait(TIMEOUT_SECONDS) == -signal.SIGTERM
        assert process.stderr.read() == ""  # at the end of all processes that could write to it
