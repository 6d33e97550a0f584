"""Threads that stay and do one thing after the other.

OpenNI2 2.2 remembers every thread that called it, and asks the system about each of them when it meets another one. On
Linux that can crash once one of them has ended, so none does: sensors are opened again and again, for weeks.

Nor may the program end while one of them is within a native library, which would crash too.
"""

import atexit
import threading
import time
from collections.abc import Callable
from queue import SimpleQueue

PATIENCE = 5.0
"""Seconds that the end of the program waits for what is being done."""

_Work = tuple[Callable[[], None], str, threading.Event]
_Stop = Callable[[], None]

_idle: list[SimpleQueue[_Work]] = []  # what those threads wait at that have nothing to do
_doing: dict[threading.Event, _Stop] = {}


def start(work: Callable[[], None], name: str, stop: _Stop) -> threading.Event:
    """Do something in a thread that has nothing else to do, and return what is set when it is done.

    Parameters
    ----------
    work : callable
        It must not raise.
    name : str
        Of the thread as long as it does that.
    stop : callable
        Asks the work to end soon, and does not wait for it; called at the end of the program.
    """
    done = threading.Event()
    try:
        tasks = _idle.pop()
    except IndexError:
        tasks = SimpleQueue()
        threading.Thread(target=_stay, args=[tasks], daemon=True).start()
    _doing[done] = stop
    tasks.put((work, name, done))
    atexit.unregister(_finish)
    atexit.register(_finish)  # again, as it is to come before what libraries do that were loaded meanwhile
    return done


def _finish() -> None:
    until = time.monotonic() + PATIENCE
    doing = dict(_doing)
    for stop in doing.values():
        stop()
    for done in doing:
        done.wait(max(0.0, until - time.monotonic()))


def _stay(tasks: SimpleQueue[_Work]) -> None:
    while True:
        done = _do(*tasks.get())
        threading.current_thread().name = "an idle sensor"
        _idle.append(tasks)
        _doing.pop(done, None)
        done.set()


def _do(work: Callable[[], None], name: str, done: threading.Event) -> threading.Event:
    threading.current_thread().name = name
    work()
    return done
