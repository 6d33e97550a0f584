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
from engine_bridge.batch.store import Store

from ...waiting import wait_until
from .conftest import partial, results

TIMEOUT_SECONDS = 600.0
"""Time after which a test fails, in seconds: workers load Python anew."""

HELD = """
    import time
    from engine_bridge.batch import conversion

    def read_or_hold(path, options, read=conversion.read_recording):
        if path.stem == "c":
            open("FOLDER/held", "w").close()
            while not os.path.exists("FOLDER/released"):
                time.sleep(0.01)
        return read(path, options)

    conversion.read_recording = read_or_hold
"""
"""Holds the conversion of a recording, says so by a file, and goes on when there is another file."""


@pytest.fixture
def start(commands, logs, puppets, tmp_path):
    """Start `puppetline batch` for all recordings and one puppet as a process, into the folder "out"."""

    def begin(workers):
        command = ("batch", logs, "--puppet", puppets[0], "-o", tmp_path / "out", "--json", "--no-report")
        pipes = dict.fromkeys(("stdout", "stderr"), subprocess.PIPE)
        return commands.start(*command, "--workers", workers, env=dict(os.environ), **pipes)

    return begin


def assert_whole(folder, expected):
    """Assert that every file under its name is as expected, byte by byte; return how many there are."""
    found = results(folder)
    assert found.keys() <= expected.keys()
    assert {name for name, content in found.items() if content != expected[name]} == set()
    return len(found)


@pytest.fixture
def assert_finished(batch, logs, puppets, walks, tmp_path):
    """Assert that another batch makes only what is missing, and that the manifest agrees with the folder."""

    def check():
        folder = tmp_path / "out"
        assert_whole(folder, walks)
        store = Store(folder, "")
        there = {name for _, record in store.records() if store.is_whole(record) for name in record.files}
        states = {name: FileState.of(folder / name) for name in there}
        result = batch(logs, "--workers", 0, "--no-report", "--retry-failed", puppets=puppets[:1])
        assert (result["made"], result["unchanged"]) == (len(walks) - len(there), len(there))
        assert results(folder) == walks
        assert {name: FileState.of(folder / name) for name in there} == states
        rows = pq.read_table(folder / "manifest.parquet").to_pylist()
        assert {row["output"]: row["bytes"] for row in rows} == {name: len(content) for name, content in walks.items()}

    return check


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "exit_code", "said"),
    [(signal.SIGINT, 1, "puppetline: stopped\n"), (signal.SIGKILL, -signal.SIGKILL, "")],
)
def test_stopped_in_the_middle_it_leaves_whole_results_and_no_process_and_continues(
    start, in_workers, assert_finished, walks, tmp_path, monkeypatch, number, exit_code, said
):
    folder, held = tmp_path / "out", tmp_path / "held"
    in_workers(HELD.replace("FOLDER", str(tmp_path)))
    with start(2) as process:
        wait_until(lambda: held.exists() or process.poll() is not None, TIMEOUT_SECONDS)
        children = psutil.Process(process.pid).children(recursive=True)
        for each in [process, *children] if number == signal.SIGINT else [process]:  # Ctrl-C reaches all of them
            os.kill(each.pid, number)
        assert process.wait() == exit_code
        (tmp_path / "released").touch()
        assert process.stderr.read() == said  # at the end of all processes that could write to it
    assert psutil.wait_procs(children, TIMEOUT_SECONDS)[1] == []
    assert assert_whole(folder, walks) < len(walks)
    assert number != signal.SIGINT or partial(folder) == []
    assert_finished()


@pytest.mark.slow
def test_two_batches_into_one_folder_at_once(start, assert_finished, walks, tmp_path):
    with start(0) as one, start(1) as two:
        assert [json.loads(each.stdout.read())["failures"] for each in (one, two)] == [[], []]
        assert [one.wait(), two.wait()] == [0, 0]
    rows = pq.read_table(tmp_path / "out/manifest.parquet").to_pylist()
    assert {row["output"] for row in rows} == walks.keys()
    assert_finished()


@contextlib.contextmanager
def mounted(folder, options):
    """Mount a file system in memory, or skip the test."""
    if os.name != "posix" or os.geteuid() != 0 or shutil.which("mount") is None:
        pytest.skip("only the superuser can mount a file system")
    folder.mkdir()
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", options, "tmpfs", folder], capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"no file system can be mounted: {done.stderr}")
    try:
        yield
    finally:
        # not at once: the kernel may still be closing the files of processes that were killed
        subprocess.run(["umount", "--lazy", folder], check=True)


@pytest.mark.slow
def test_a_full_disk_ends_the_batch_with_one_message_and_whole_results(
    print_batch, logs, puppets, assert_finished, walks, tmp_path
):
    folder, size = tmp_path / "out", sum(map(len, walks.values()))
    with mounted(folder, f"size={size // 2}"):
        done = print_batch(logs, "--workers", 2, "--no-report", puppets=puppets[:1], code=1)
        assert (done.stdout, done.stderr.count("\n")) == ("", 1)
        assert done.stderr.startswith(f"puppetline: {folder}")
        assert "(No space left on device)" in done.stderr
        assert 0 < assert_whole(folder, walks) < len(walks)
        assert partial(folder) == []
        subprocess.run(["mount", "-o", f"remount,size={4 * size}", folder], check=True)
        assert_finished()
