"""Threads that never end and are used again.

OpenNI2 2.2 remembers every thread that called it, and queries all of them when another thread calls it. On Linux this
can crash if one of them has ended. So no thread ends, although a service may open sensors again for weeks.

At the end of the program, work is asked to stop first, because a program that ends inside a native library may crash.
"""

import atexit
import threading
from collections.abc import Callable
from queue import SimpleQueue

from puppetline import clock

EXIT_SECONDS = 5.0
"""Maximum time that the end of the program waits for work, in seconds."""

_Work = tuple[Callable[[], None], str, threading.Event]
_Stop = Callable[[], None]

_idle: list[SimpleQueue[_Work]] = []  # queues of the threads without work
_running: dict[threading.Event, _Stop] = {}


def start(work: Callable[[], None], name: str, stop: _Stop) -> threading.Event:
    """Run work in an idle thread, or in a new one, and return an event that is set when the work is done.

    Parameters
    ----------
    work : callable
        It must not raise.
    name : str
        Name of the thread during the work.
    stop : callable
        Asks the work to end soon, without waiting for it; called at the end of the program.
    """
    done = threading.Event()
    try:
        tasks = _idle.pop()
    except IndexError:
        tasks = SimpleQueue()
        threading.Thread(target=_run, args=[tasks], daemon=True).start()
    _running[done] = stop
    tasks.put((work, name, done))
    atexit.unregister(_finish)
    atexit.register(_finish)  # registered last, it runs before the exit functions of libraries loaded meanwhile
    return done


def _finish() -> None:
    until = clock.now() + EXIT_SECONDS
    running = dict(_running)
    for stop in running.values():
        stop()
    for done in running:
        done.wait(max(0.0, until - clock.now()))


def _run(tasks: SimpleQueue[_Work]) -> None:
    while True:
        done = _run_one(*tasks.get())
        threading.current_thread().name = "an idle sensor"
        _idle.append(tasks)
        _running.pop(done, None)
        done.set()


def _run_one(work: Callable[[], None], name: str, done: threading.Event) -> threading.Event:
    """Run work; a function of its own, so that an idle thread keeps no reference to it."""
    threading.current_thread().name = name
    work()
    return done
