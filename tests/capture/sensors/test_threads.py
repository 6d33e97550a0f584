import subprocess
import sys
import threading

from capture.sensors.threads import start


def _let():
    """Do not ask the work to stop."""


def test_one_thread_does_work_in_sequence():
    seen = []
    for name in "abc":
        assert start(
            lambda: seen.append((threading.current_thread(), threading.current_thread().name)), name, _let
        ).wait()
    threads, names = zip(*seen, strict=True)
    assert (len(set(threads)), names) == (1, ("a", "b", "c"))
    assert threads[0].is_alive()


def test_simultaneous_work_uses_several_threads_and_work_that_never_ends_delays_no_other():
    together, go_on = threading.Barrier(3), threading.Event()
    stuck = start(lambda: go_on.wait() and None, "stuck", _let)
    for _ in range(2):
        done = [start(together.wait, str(k), _let) for k in range(2)]
        together.wait()
        assert all(each.wait() for each in done)
    assert not stuck.is_set()
    go_on.set()
    assert stuck.wait()


LEFT = """
import sys, threading, time
from capture.sensors.threads import start

told, first = threading.Event(), threading.Event()
start(lambda: told.wait(60) and print("one", flush=True) or first.set(), "work", told.set)
start(lambda: first.wait(60) and time.sleep(0.1) or print("two", flush=True), "more work", lambda: None)
sys.exit("left")
"""


def test_the_end_of_the_program_stops_work_and_waits_for_it():
    result = subprocess.run([sys.executable, "-c", LEFT], capture_output=True, text=True, check=False)
    assert (result.returncode, result.stdout, result.stderr) == (1, "one\ntwo\n", "left\n")
