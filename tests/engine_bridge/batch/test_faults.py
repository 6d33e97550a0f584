"""Batches whose processes are stopped or that cannot write; every result under its name is complete afterwards.

`test_store` kills a process at each step of writing, and `test_workers` has workers killed.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess

import psutil
import pyarrow.parquet as pq
import pytest

from engine_bridge.batch.identity import FileState
from engine_bridge.batch.store import OWN_FOLDER, PARTIAL_FOLDER, Store

from ...waiting import wait_until
from .conftest import NAMES, results

TIMEOUT_SECONDS = 600.0
"""Time after which a test fails, in seconds: workers load Python anew."""

COUNT = 2 * len(NAMES)
"""Number of results: of each recording with both puppets."""

HELD = """
import time
from pathlib import Path
from engine_bridge.batch import conversion

def read_or_hold(path, options, read=conversion.read_log):
    if path.stem == "c":
        Path("FOLDER/held").touch()
        while not Path("FOLDER/released").exists():
            time.sleep(0.01)
    return read(path, options)

conversion.read_log = read_or_hold
"""
"""Holds the conversion of a recording, says so by a file, and goes on when there is another file."""


@pytest.fixture(scope="module")
def start(commands, logs, puppets):
    """Start `puppetline batch` for these recordings and both puppets."""

    def begin(folder, *arguments, **more):
        chosen = [each for puppet in puppets for each in ("--puppet", puppet)]
        command = ("batch", logs, *chosen, "-o", folder, "--json", "--no-report", *arguments)
        return commands.start(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **more)

    return begin


@pytest.fixture(scope="module")
def finished(start):
    """Run a batch to its end and return its result."""

    def run(folder, *arguments):
        with start(folder, "--workers", 0, *arguments) as process:
            output, errors = process.stdout.read(), process.stderr.read()
            assert (process.wait(), errors) == (0, "")
        return json.loads(output)

    return run


@pytest.fixture(scope="module")
def expected(finished, tmp_path_factory):
    """All results of a batch that nothing has disturbed, by name."""
    folder = tmp_path_factory.mktemp("expected")
    assert finished(folder)["made"] == COUNT
    return results(folder)


def assert_whole(folder, expected):
    """Assert that every file under its name is as expected, byte by byte; return how many there are."""
    found = results(folder)
    assert found.keys() <= expected.keys()
    assert {name for name, content in found.items() if content != expected[name]} == set()
    return len(found)


def assert_finished(folder, expected, finished):
    """Assert that another batch makes only what is missing, and that the manifest agrees with the folder."""
    assert_whole(folder, expected)
    store = Store(folder, "")
    there = {name for _, record in store.records() if store.is_whole(record) for name in record.files}
    states = {name: FileState.of(folder / name) for name in there}
    result = finished(folder, "--retry-failed")
    assert (result["made"], result["unchanged"], result["failures"]) == (COUNT - len(there), len(there), [])
    assert results(folder) == expected
    assert {name: FileState.of(folder / name) for name in there} == states
    rows = pq.read_table(folder / "manifest.parquet").to_pylist()
    assert {row["output"]: row["bytes"] for row in rows} == {name: len(content) for name, content in expected.items()}


def partial(folder):
    return list((folder / OWN_FOLDER / PARTIAL_FOLDER).iterdir())


STOPS = {
    signal.SIGINT: (1, "puppetline: stopped\n"),
    signal.SIGTERM: (-signal.SIGTERM, ""),
    signal.SIGKILL: (-signal.SIGKILL, ""),
}
"""Exit code and output after each signal."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "workers"), [(signal.SIGINT, 0), (signal.SIGINT, 2), (signal.SIGTERM, 2), (signal.SIGKILL, 2)]
)
def test_stopped_in_the_middle_it_leaves_whole_results_and_no_process_and_continues(
    start, finished, expected, tmp_path, number, workers
):
    folder, held = tmp_path / "out", tmp_path / "held"
    code = HELD.replace("FOLDER", str(tmp_path))
    (tmp_path / "sitecustomize.py").write_text(f"import sys\nif '--multiprocessing-fork' in sys.argv: exec({code!r})")
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    with start(folder, "--workers", workers, prelude="" if workers else code, env=environment) as process:
        wait_until(lambda: held.exists() or process.poll() is not None, TIMEOUT_SECONDS)
        children = psutil.Process(process.pid).children(recursive=True)
        for each in [process, *children] if number == signal.SIGINT else [process]:  # Ctrl-C reaches all of them
            os.kill(each.pid, number)
        exit_code, said = STOPS[number]
        assert process.wait() == exit_code
        (tmp_path / "released").touch()
        assert process.stderr.read() == said  # at the end of all processes that could write to it
    assert psutil.wait_procs(children, TIMEOUT_SECONDS)[1] == []
    assert assert_whole(folder, expected) < COUNT
    assert number != signal.SIGINT or partial(folder) == []
    assert_finished(folder, expected, finished)


@pytest.mark.slow
def test_two_batches_into_one_folder_at_once(start, finished, expected, tmp_path):
    with start(tmp_path, "--workers", 0) as one, start(tmp_path, "--workers", 1) as two:
        assert [json.loads(each.stdout.read())["failures"] for each in (one, two)] == [[], []]
        assert [one.wait(), two.wait()] == [0, 0]
    assert results(tmp_path) == expected
    rows = pq.read_table(tmp_path / "manifest.parquet").to_pylist()
    assert {row["output"] for row in rows} == expected.keys()
    assert_finished(tmp_path, expected, finished)


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
    size = sum(map(len, expected.values()))
    with mounted(tmp_path, f"size={size // 3}"):
        with start(tmp_path, "--workers", workers) as process:
            output, errors = process.stdout.read(), process.stderr.read()
            assert (process.wait(), output, errors.count("\n")) == (1, "", 1)
        assert errors.startswith(f"puppetline: {tmp_path}")
        assert "(No space left on device)" in errors
        assert 0 < assert_whole(tmp_path, expected) < COUNT
        assert partial(tmp_path) == []
        subprocess.run(["mount", "-o", f"remount,size={2 * size}", tmp_path], check=True)
        assert_finished(tmp_path, expected, finished)


def test_a_folder_without_rights_is_one_message_before_the_work(start, tmp_path):
    with mounted(tmp_path, "ro"), start(tmp_path) as process:
        errors = process.stderr.read()
        assert (process.wait(), errors.count("\n")) == (1, 1)
        assert errors.startswith(f"puppetline: {tmp_path}: ")
        assert "(Read-only file system)" in errors
