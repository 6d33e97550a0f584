import threading

from capture.sensors.threads import start


def _let():
    """Do not ask the work to stop."""


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
