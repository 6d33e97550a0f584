import ctypes
import signal
import sys
import threading
import time

import pytest

from puppetline.interrupts import REPEAT_SECONDS, repeated_interrupts


@pytest.fixture(autouse=True)
def python_prints_errors_of_callbacks(monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", sys.__unraisablehook__)


def in_a_callback_of_a_c_library(function):
    ctypes.CFUNCTYPE(None)(function)()


def interrupt():
    raise KeyboardInterrupt


def test_an_interrupt_that_a_callback_discards_is_raised_again_and_not_printed(capsys, monkeypatch):
    start, discarded = threading.Thread.start, []

    def start_slowly(thread):
        start(thread)
        time.sleep(5 * REPEAT_SECONDS)  # as on a busy machine: raised now, the interrupt would be lost for good

    monkeypatch.setattr(threading.Thread, "start", start_slowly)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt), repeated_interrupts(lambda: discarded.append(True)):  # noqa: PT012
            in_a_callback_of_a_c_library(interrupt)
            while True:
                threading.Event().wait(0.01)  # another thread's signal does not end a longer one
    finally:
        signal.signal(signal.SIGINT, before)
    assert discarded == [True]
    assert capsys.readouterr().err == ""


def test_other_errors_of_callbacks_are_still_printed_and_the_hook_is_restored(capsys):
    with repeated_interrupts():
        in_a_callback_of_a_c_library(lambda: 1 / 0)
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert sys.unraisablehook is sys.__unraisablehook__
