import subprocess
import sys
import threading

from capture.sensors.threads import start


def _let():
    """Do not ask the work to stop."""


def _work():
    """Return a list, and work that appends its thread and the thread's name to it."""
    seen = []
    return seen, lambda: seen.append((threading.current_thread(), threading.current_thread().name))


def test_one_thread_does_work_in_sequence():
    seen, work = _work()
    for name in "abc":
        assert start(work, name, _let).wait(10)
    assert [name for _, name in seen] == ["a", "b", "c"]
    assert len({thread for thread, _ in seen}) == 1
    assert seen[0][0].is_alive()


def test_simultaneous_work_uses_several_threads():
    together = threading.Barrier(3, timeout=10)
    for _ in range(2):
        done = [start(together.wait, str(k), _let) for k in range(2)]
        together.wait()
        assert all(each.wait(10) for each in done)


def test_work_that_never_ends_does_not_delay_other_work():
    go_on = threading.Event()
    stuck = start(lambda: go_on.wait(10) and None, "stuck", _let)
    assert start(lambda: None, "other", _let).wait(10)
    assert not stuck.is_set()
    go_on.set()
    assert stuck.wait(10)


LEFT = """
import sys, threading, time
from capture.sensors.threads import start

told = threading.Event()
start(lambda: told.wait(60) and time.sleep(0.3) or print("one", flush=True), "work", told.set)
start(lambda: told.wait(60) and time.sleep(0.6) or print("two", flush=True), "more work", lambda: None)
sys.exit("left")
"""


def test_the_end_of_the_program_stops_work_and_waits_for_it():
    result = subprocess.run([sys.executable, "-c", LEFT], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (1, "one\ntwo\n", "left\n")
