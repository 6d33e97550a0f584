"""A program that loads Puppetline once, and then forks a process for each command.

Loading takes longer than most commands of tests. Each command is still a process with its own arguments, environment,
folder, standard streams, signals and exit code. The only argument is the file descriptor of a socket. A request on it
is JSON with four file descriptors: the command's standard streams, and a pipe that receives the command's process id
and later its exit code, one per line.
"""

import atexit
import contextlib
import fcntl
import gc
import importlib
import json
import os
import signal
import socket
import sys
import termios
import threading

from numba.core.caching import FunctionCache
from numba.core.dispatcher import Dispatcher

from puppetline.__main__ import run

MODULES = (
    "capture.sources.alignment",
    "capture.sources.take",
    "engine_bridge.inspection.files",
    "engine_bridge.cli.main",
    "engine_bridge.client.listening",
    "engine_bridge.export.bake",
    "engine_bridge.export.convert",
    "engine_bridge.pictures.source_view",
    "engine_bridge.pictures.mesh_picture",
    "engine_bridge.puppet.proposal",
    "engine_bridge.service.commands",
    "engine_bridge.service.service",
    "puppetline.examples.performances",
    "scipy.interpolate",
    "scipy.linalg",
    "scipy.sparse.linalg",
    "scipy.spatial.transform",
)


def compiled_functions() -> list[Dispatcher]:
    """Return all functions that Numba compiles and stores for other processes."""
    functions = (each for each in gc.get_objects() if issubclass(type(each), Dispatcher))
    return [function for function in functions if isinstance(function._cache, FunctionCache)]


def load_compiled(functions: list[Dispatcher]) -> None:
    """Load the code that other processes have compiled so far; loading takes longer than running it."""
    for function in functions:
        for signature, *_ in function._cache._cache_file._load_index():
            function.compile(signature)


def main(requests: socket.socket) -> None:
    """Answer requests until the socket is closed; return in each forked process, which then runs its command."""
    functions = compiled_functions()
    while True:
        load_compiled(functions)
        gc.freeze()  # or garbage collection in a command would touch all of it, and so copy it
        message, descriptors, _, _ = socket.recv_fds(requests, 2**20, 4)
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        if not message:
            os._exit(0)
        if os.fork() == 0:
            requests.close()
            if _is_command(descriptors):
                _become(json.loads(message), descriptors)
                return
        for descriptor in descriptors:
            os.close(descriptor)


def _is_command(descriptors: list[int]) -> bool:
    """Fork a process for the command, in which this returns True; in this one, report its exit code and exit."""
    *streams, told = descriptors
    command = os.fork()
    if command == 0:
        os.close(told)
        return True
    for stream in (0, 1, 2, *streams):
        os.close(stream)
    os.write(told, f"{command}\n".encode())
    code = os.waitstatus_to_exitcode(os.waitpid(command, 0)[1])
    with contextlib.suppress(BrokenPipeError):
        os.write(told, f"{code}\n".encode())
    os._exit(0)


def _become(request: dict, descriptors: list[int]) -> None:
    """Set up arguments, environment, folder, streams and signals as in a new process."""
    for number, descriptor in enumerate(descriptors[:3]):
        os.dup2(descriptor, number)
        os.close(descriptor)
    if request["terminal"]:
        os.setsid()
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)  # so that Ctrl-C sends a signal
    os.chdir(request["cwd"])
    os.environ.clear()
    os.environ.update(request["env"])
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.stdin = sys.__stdin__ = os.fdopen(0, closefd=False)
    sys.stdout = sys.__stdout__ = os.fdopen(1, "w", buffering=1 if os.isatty(1) else -1, closefd=False)
    sys.stderr = sys.__stderr__ = os.fdopen(2, "w", buffering=1, errors="backslashreplace", closefd=False)
    sys.argv = ["puppetline", *request["arguments"]]
    exec(request["prelude"], {})


def _end(code: int) -> None:
    """End the process as Python does, but free nothing first, which takes longer than most commands.

    Return where output cannot be written, which Python reports in its own way.
    """
    threading._shutdown()  # waits for threads
    atexit._run_exitfuncs()
    with contextlib.suppress(OSError):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the tests, and they close the socket
    for name in MODULES:
        importlib.import_module(name)
    main(socket.socket(fileno=int(sys.argv[1])))
    try:
        run()
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            _end(end.code or 0)
        raise
