import os
import select
import signal

import pytest

from engine_bridge.service.signals import Signals

HAS_HANGUP = hasattr(signal, "SIGHUP")


def come(number):
    os.kill(os.getpid(), number)


def test_the_end_is_noted_where_somebody_waits_for_it_and_wakes_them():
    with Signals() as signals:
        signals.waiting = True
        assert not signals.stop
        come(signal.SIGTERM)
        assert signals.stop
        assert select.select([signals], [], [], 10)[0]
        come(signal.SIGINT)  # and once more does no harm


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_the_end_interrupts_whatever_is_being_done_before(number):
    with Signals() as signals:
        with pytest.raises(KeyboardInterrupt):
            come(number)
        come(number)  # not what is done about it
        assert signals.stop


@pytest.mark.skipif(not HAS_HANGUP, reason="there is no SIGHUP here")
def test_a_reload_is_asked_for_once_however_often_it_comes():
    with Signals() as signals:
        for _ in range(3):
            come(signal.SIGHUP)
        assert signals.take_reload()
        assert not signals.take_reload()
        assert not select.select([signals], [], [], 0)[0]


def test_everything_is_as_before_afterwards():
    before = signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)
    with Signals():
        assert signal.getsignal(signal.SIGTERM) != before[0]
    assert (signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)) == before
    assert signal.set_wakeup_fd(-1) == -1
