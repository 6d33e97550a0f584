"""Processes that end with the one that started them."""

import os
import subprocess
import sys

import psutil
import pytest

from puppetline.child_process import VARIABLE

from ..commands import TIMEOUT_SECONDS

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


def test_a_process_that_nobody_bound_does_not_read_its_input():
    program = "from puppetline.child_process import end_with_parent; end_with_parent(); print(input())"
    free = {name: value for name, value in os.environ.items() if name != VARIABLE}
    done = subprocess.run([sys.executable, "-c", program], input="a line\n", env=free, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "a line\n")
