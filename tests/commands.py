"""Runs commands as processes, without the seconds in which Python loads their libraries."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

TIMEOUT_SECONDS = 180.0
"""Time after which a test fails, in seconds."""

SERVER = Path(__file__).with_name("command_server.py")


class Process:
    """A running command, with the part of `subprocess.Popen` that tests use."""

    def __init__(self, pid, life, stdout, stderr):
        self.pid, self.returncode, self.stdout, self.stderr = pid, None, stdout, stderr
        self._life, self._ended = life, threading.Event()
        threading.Thread(target=self._wait, daemon=True).start()

    def _wait(self):
        with self._life:
            self.returncode = int(self._life.readline() or -signal.SIGKILL)  # empty if the server was killed
        self._ended.set()

    def poll(self):
        """Return the exit code; None while the command runs."""
        return self.returncode

    def wait(self, timeout=TIMEOUT_SECONDS):
        """Wait for the exit code."""
        if not self._ended.wait(timeout):
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
        return self.returncode

    def send_signal(self, number):
        """Send a signal, unless the command has ended."""
        if self.returncode is None:
            os.kill(self.pid, number)

    def terminate(self):
        """Send SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self):
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for stream in (self.stdout, self.stderr):
            if stream is not None:
                stream.close()
        self.wait()


class Commands:
    """Starts commands in processes that `command_server.py` forks."""

    def __init__(self):
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            descriptor = theirs.fileno()
            self._server = subprocess.Popen(
                [sys.executable, "-P", SERVER, str(descriptor)],
                pass_fds=[descriptor],
                stdin=subprocess.DEVNULL,
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},  # a process with threads cannot be forked
            )

    def start(
        self,
        *arguments,
        stdin=None,
        stdout=None,
        stderr=None,
        text=True,
        cwd=None,
        env=None,
        terminal=False,
        prelude="",
    ):
        """Start a command.

        Parameters
        ----------
        *arguments : str or path
        stdin, stdout, stderr : int, optional
            A file descriptor, or ``subprocess.PIPE`` for the last two; the null device by default.
        text : bool
            Whether pipes are opened as text files.
        cwd, env
            As for `subprocess.Popen`.
        terminal : bool
            Whether the standard input becomes the controlling terminal.
        prelude : str
            Python code that the process executes first.
        """
        with Path(os.devnull).open("r+b") as nothing:
            ours, theirs = [], []
            for stream in (stdout, stderr):
                ends = os.pipe() if stream == subprocess.PIPE else None
                ours.append(None if ends is None else os.fdopen(ends[0], "r" if text else "rb"))
                theirs.append(nothing.fileno() if stream is None else stream if ends is None else ends[1])
            told, tell = os.pipe()
            request = {
                "arguments": [str(each) for each in arguments],
                "cwd": str(cwd or Path.cwd()),
                "env": dict(os.environ if env is None else env),
                "terminal": terminal,
                "prelude": prelude,
            }
            streams = [nothing.fileno() if stdin is None else stdin, *theirs]
            socket.send_fds(self._requests, [json.dumps(request).encode()], [*streams, tell])
            for end, stream in zip(theirs, (stdout, stderr), strict=True):
                if stream == subprocess.PIPE:
                    os.close(end)
            os.close(tell)
        life = os.fdopen(told)
        return Process(int(life.readline()), life, *ours)

    def run(self, *arguments, **more):
        """Run a command to its end; return a `subprocess.CompletedProcess` with its output."""
        with self.start(*arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **more) as process:
            errors = []
            reading = threading.Thread(target=lambda: errors.append(process.stderr.read()))
            reading.start()
            output = process.stdout.read()
            reading.join()
            return subprocess.CompletedProcess(arguments, process.wait(), output, *errors)

    def close(self):
        """End the server."""
        self._requests.close()
        self._server.wait(TIMEOUT_SECONDS)
