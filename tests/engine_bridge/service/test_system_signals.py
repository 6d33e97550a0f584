import ctypes
import os
import select
import signal
import sys
import time

import pytest

from engine_bridge.service.system_signals import Signals

HAS_HANGUP = hasattr(signal, "SIGHUP")


def send(number):
    os.kill(os.getpid(), number)


def test_a_stop_is_noted_and_makes_the_descriptor_readable_while_the_program_waits():
    with Signals() as signals:
        signals.waiting = True
        assert not signals.stop
        send(signal.SIGTERM)
        assert signals.stop
        assert select.select([signals], [], [], 10)[0]
        send(signal.SIGINT)  # a second one does nothing


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_stop_during_the_start_raises_keyboard_interrupt_once(number):
    with Signals() as signals:
        with pytest.raises(KeyboardInterrupt):
            send(number)
        send(number)  # does not interrupt the cleaning up
        assert signals.stop


def test_an_interrupt_that_a_callback_discards_is_raised_again_and_not_printed(capsys, monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)
    called = []

    @ctypes.CFUNCTYPE(None)
    def callback():
        called.append(True)
        send(signal.SIGINT)

    with Signals() as signals:
        callback()
        assert called
        with pytest.raises(KeyboardInterrupt):  # noqa: PT012 - the interrupt falls between two statements
            for _ in range(6000):
                time.sleep(0.01)
        assert signals.stop
    assert capsys.readouterr().err == ""


@pytest.mark.skipif(not HAS_HANGUP, reason="no SIGHUP on this system")
def test_several_reload_signals_are_one_reload():
    with Signals() as signals:
        for _ in range(3):
            send(signal.SIGHUP)
        assert signals.take_reload()
        assert not signals.take_reload()
        assert not select.select([signals], [], [], 0)[0]


def test_handlers_and_hooks_are_restored():
    def state():
        return signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT), sys.unraisablehook

    before = state()
    with Signals():
        assert all(now != then for now, then in zip(state(), before, strict=True))
    assert state() == before
    assert signal.set_wakeup_fd(-1) == -1
