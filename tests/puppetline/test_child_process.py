"""Processes that end with the one that started them."""

import os
import subprocess
import sys

import psutil
import pytest

from puppetline import child_process
from puppetline.child_process import VARIABLE, kept_running

from ..commands import TIMEOUT_SECONDS
from ..waiting import wait_until

CHILD = """
from puppetline import child_process
child_process.END_SECONDS = 0.1
child_process.end_with_parent()
import os, signal, threading
assert child_process.VARIABLE not in os.environ
{prepare}
print("ready", flush=True)
threading.Event().wait()
"""

PARENT = """
import subprocess, sys
from puppetline.child_process import bound_to_parent
child = subprocess.Popen([sys.executable, "-c", sys.argv[1]], **bound_to_parent())
child.wait()
"""


@pytest.mark.parametrize("prepare", ["", "signal.signal(signal.SIGTERM, lambda *_: None)"], ids=["ends", "hangs"])
def test_a_child_ends_when_its_parent_is_killed(prepare):
    command = [sys.executable, "-c", PARENT, CHILD.format(prepare=prepare)]
    parent = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert parent.stdout.readline() == "ready\n"
    children = psutil.Process(parent.pid).children()
    assert len(children) == 1
    parent.kill()
    parent.wait()
    assert not psutil.wait_procs(children, TIMEOUT_SECONDS)[1]


def test_a_child_that_is_kept_running_is_started_again_until_the_end(tmp_path):
    path = tmp_path / "pids"
    program = f"import os, threading; open({str(path)!r}, 'a').write(f'{{os.getpid()}} '); threading.Event().wait()"
    started = []

    def new():
        pids = [int(pid) for pid in path.read_text().split()] if path.exists() else []
        return pids[len(started) :]

    with kept_running([sys.executable, "-c", program]):
        for _ in range(3):
            wait_until(new)
            started.append(psutil.Process(new()[0]))
            if len(started) < 3:
                started[-1].kill()
        assert started[-1].is_running()
    assert not psutil.wait_procs(started, TIMEOUT_SECONDS)[1]
    assert new() == []


def test_a_child_that_cannot_be_started_again_is_tried_until_it_can(tmp_path, caplog):
    program, pids = tmp_path / "program", tmp_path / "pids"
    script = f"import os; open({str(pids)!r}, 'a').write(f'{{os.getpid()}} '); input()"

    def started(count):
        return pids.exists() and len(pids.read_text().split()) == count and pids.read_text().endswith(" ")

    program.symlink_to(sys.executable)
    with kept_running([str(program), "-c", script]):
        wait_until(lambda: started(1))
        program.unlink()
        psutil.Process(int(pids.read_text())).kill()
        wait_until(lambda: "cannot be started" in caplog.text)
        program.symlink_to(sys.executable)
        wait_until(lambda: started(2))


def test_a_child_that_always_ends_is_given_up(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(child_process, "MIN_RETRY_SECONDS", 0.0)
    monkeypatch.setattr(child_process, "MAX_FAILURES", 3)
    path = tmp_path / "started"
    with kept_running([sys.executable, "-c", f"open({str(path)!r}, 'a').write('x')"]):
        wait_until(lambda: "not started again" in caplog.text)
    assert len(path.read_text()) in (3, 4)


def test_a_process_that_nobody_bound_does_not_read_its_input():
    program = "from puppetline.child_process import end_with_parent; end_with_parent(); print(input())"
    free = {name: value for name, value in os.environ.items() if name != VARIABLE}
    done = subprocess.run([sys.executable, "-c", program], input="a line\n", env=free, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "a line\n")
