import ctypes
import os
import select
import signal
import sys
import time

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


def test_an_interrupt_that_a_callback_discards_is_raised_again_and_not_printed(capsys, monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    called = []

    @ctypes.CFUNCTYPE(None)
    def callback():
        called.append(True)
        come(signal.SIGINT)

    with Signals() as signals:
        callback()
        assert called
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012 - in whatever is being done then
            for _ in range(6000):
                time.sleep(0.01)
        assert signals.stop
    assert capsys.readouterr().err == ""


def test_other_errors_in_callbacks_are_still_printed(capsys, monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    with Signals():
        ctypes.CFUNCTYPE(None)(lambda: 1 / 0)()
    assert "ZeroDivisionError" in capsys.readouterr().err


@pytest.mark.skipif(not HAS_HANGUP, reason="there is no SIGHUP here")
def test_a_reload_is_asked_for_once_however_often_it_comes():
    with Signals() as signals:
        for _ in range(3):
            come(signal.SIGHUP)
        assert signals.take_reload()
        assert not signals.take_reload()
        assert not select.select([signals], [], [], 0)[0]


def test_everything_is_as_before_afterwards():
    def state():
        return signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT), sys.unraisablehook

    before = state()
    with Signals():
        assert all(now != then for now, then in zip(state(), before, strict=True))
    assert state() == before
    assert signal.set_wakeup_fd(-1) == -1
