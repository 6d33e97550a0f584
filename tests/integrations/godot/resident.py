"""Processes of Godot that run test scripts one after another; resident.gd is their part in Godot."""

import json
import os
import re
import signal
import socket
import struct
import subprocess
import threading
from contextlib import suppress

import pytest

TIMEOUT_SECONDS = 60.0
"""Time after which a test fails, in seconds; others run at the same time."""

WRONG = re.compile(
    r"SCRIPT ERROR|Parse Error|^\s*ERROR:|instances? (were |was )?leaked|leaked at exit|still in use at exit"
)
"""Output that a correct script never prints."""

HARMLESS = re.compile(r"Cannot get class|ALSA|PulseAudio|XDG_RUNTIME_DIR|without fontconfig")
"""Messages of Godot on a machine without sound, display or fonts."""


class Godot:
    """A process of Godot, and what it prints outside of scripts."""

    def __init__(self, *command):
        self.lines, self.script = [], None
        self.printed = threading.Condition()
        """Notified when a line has been printed, and when the process has ended."""
        self.process = subprocess.Popen(
            list(map(str, command)),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
        )
        self._reading = threading.Thread(target=self._read)
        self._reading.start()

    def _read(self):
        for line in self.process.stdout:
            with self.printed:
                self._take(line.rstrip("\n"))
                self.printed.notify_all()
        with self.printed:
            if self.script is not None:
                self.lines += self.script.lines
                self._end_script()
            self.printed.notify_all()

    def _take(self, line):
        if self.script is None:
            self.lines.append(line)
        elif line == "DONE":
            self._end_script()
        else:
            self.script.take(line)

    def _end_script(self):
        self.script.is_done = True
        self.script = None

    def finish(self, timeout=TIMEOUT_SECONDS, allow=()):
        """Wait for the end of the process; fail if it printed an error."""
        try:
            code = self.process.wait(timeout)
        except subprocess.TimeoutExpired:
            self.kill()
            pytest.fail(f"no end after {timeout} s:\n{end_of(self.lines)}", pytrace=False)
        self._reading.join()
        assert_correct(self.lines, allow, code)

    def kill(self):
        """End the process at once."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self._reading.join()
        self.process.stdout.close()


class Resident(Godot):
    """A process of Godot that runs test scripts; on a screen it draws with OpenGL, or with another renderer."""

    def __init__(self, godot, *place, screen=(), renderer="gl_compatibility"):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.settimeout(0.1)
        self._connection = None
        command = [godot, *place, "-s", "res://tests/resident.gd"]
        if screen:
            command = [*screen, *command, "--rendering-method", renderer, "--audio-driver", "Dummy"]
        else:
            command.append("--headless")
        super().__init__(*command, "--", self._listener.getsockname()[1])

    @property
    def is_idle(self):
        return self.script is None and self.process.poll() is None

    def start(self, name, *arguments, clock=None):
        """Start a script of the project; connections get their time from a file with a number of seconds."""
        while self._connection is None:
            assert self.process.poll() is None, end_of(self.lines)
            with suppress(TimeoutError):
                self._connection = self._listener.accept()[0]
        script = self.script = Script(self)
        more = {} if clock is None else {"clock": str(clock)}
        self.send({"script": f"res://tests/{name}", "arguments": [*map(str, arguments)], **more})
        return script

    def send(self, request):
        """Send a request to resident.gd."""
        body = json.dumps(request).encode()
        with suppress(ConnectionError):  # the process has ended, which whoever waits for the script notices
            self._connection.sendall(struct.pack("<I", len(body)) + body)

    def close(self):
        """Let the process end; fail if it printed an error outside of scripts, such as of what leaked."""
        self._listener.close()
        if self._connection is not None:
            self._connection.close()
        self.finish()


class Script:
    """A script that runs in Godot."""

    def __init__(self, resident):
        self._resident = resident
        self.process = resident.process
        self.lines, self.is_done = [], False
        self.results = []
        """The results so far."""

    def take(self, line):
        """Take a line that it has printed."""
        self.lines.append(line)
        if line.startswith("RESULT "):
            self.results.append(json.loads(line.removeprefix("RESULT "), strict=False))

    def until(self, wanted, timeout=TIMEOUT_SECONDS):
        """Wait for a result that satisfies a condition, and return it."""
        found, tried = [], 0

        def is_found():
            nonlocal tried
            new, tried = self.results[tried:], len(self.results)
            found.extend(filter(wanted, new))
            return found or self.is_done

        with self._resident.printed:
            self._resident.printed.wait_for(is_found, timeout)
        if not found:
            pytest.fail(f"it has not said what was wanted:\n{end_of(self.lines)}", pytrace=False)
        return found[0]

    def end(self, allow=()):
        """Tell a script that asks `is_over()` that it is, and return all results."""
        self._resident.send("over")
        return self.finish(allow=allow)

    def finish(self, timeout=TIMEOUT_SECONDS, allow=()):
        """Wait for its end and return all results; fail if it printed an error."""
        with self._resident.printed:
            ended = self._resident.printed.wait_for(lambda: self.is_done, timeout)
        if not ended:
            self._resident.kill()
            pytest.fail(f"no end after {timeout} s:\n{end_of(self.lines)}", pytrace=False)
        assert self.process.poll() is None, end_of(self.lines)
        assert_correct(self.lines, allow)
        return self.results

    def kill(self):
        """End its process, unless the script has ended."""
        if not self.is_done:
            self._resident.kill()


def end_of(lines):
    """Return the end of an output."""
    return "\n".join(line[:400] for line in lines[-60:])


def assert_correct(lines, allow, code=0):
    """Fail after another exit code than 0, or if lines contain an error that is not among the texts of `allow`."""
    wrong = [
        line
        for line in lines
        if WRONG.search(line) and not HARMLESS.search(line) and not any(text in line for text in allow)
    ]
    if code or wrong:
        message = [f"exit code {code}, {len(wrong)} errors:", *wrong, "", end_of(lines)]
        pytest.fail("\n".join(message), pytrace=False)
